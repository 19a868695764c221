//! Errors of photographs.

use crate::rectangle::RectangleError;
use penumbra_lighting::Circle;
use penumbra_lighting::photograph::PhotographError;
use penumbra_session::SessionError;
use std::path::PathBuf;

/// Why photographs cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PhotoError {
    /// A file could not be read, or is not a picture.
    #[error(transparent)]
    File(#[from] PhotographError),
    /// The pictures differ in size.
    #[error(
        "{path} has {} × {} pixels, {first} has {} × {}: use the same camera in the same position, \
         and do not crop", size.0, size.1, first_size.0, first_size.1
    )]
    Size {
        /// The picture.
        path: PathBuf,
        /// Its width and height.
        size: (u32, u32),
        /// The picture without the ball.
        first: PathBuf,
        /// Its width and height.
        first_size: (u32, u32),
    },
    /// The pictures show different places.
    #[error(
        "{path} does not show the same place as {first} ({percent:.0} % of the picture differs): put \
         the camera on something that stands still"
    )]
    Unaligned {
        /// The picture.
        path: PathBuf,
        /// The picture without the ball.
        first: PathBuf,
        /// Share of pixels that differ, percent.
        percent: f64,
    },
    /// There is no ball.
    #[error(
        "no ball found in {path}: its outline must be visible against what is behind it; or state it: \
         --ball X,Y,RADIUS in pixels of the picture"
    )]
    NoBall {
        /// The picture.
        path: PathBuf,
    },
    /// What was put into the picture mirrors nothing.
    #[error(
        "what is round in {path}, with its centre at ({:.0}, {:.0}) and a radius of {:.0} pixels, is shaded \
         like something matt: use a mirrored ball; if it is one, state it: --ball X,Y,RADIUS",
        circle.centre.x, circle.centre.y, circle.radius
    )]
    MattBall {
        /// The picture.
        path: PathBuf,
        /// The outline.
        circle: Circle,
    },
    /// The ball's outline leaves the picture.
    #[error(
        "the ball in {path}, with its centre at ({:.0}, {:.0}), reaches the border of the picture: it must \
         be whole, with some space around it; or state it: --ball X,Y,RADIUS",
        circle.centre.x, circle.centre.y
    )]
    BallAtBorder {
        /// The picture.
        path: PathBuf,
        /// The outline.
        circle: Circle,
    },
    /// The ball's circle is impossible.
    #[error("--ball {x},{y},{radius} is not inside {path}, which has {} × {} pixels", size.0, size.1)]
    BallOutside {
        /// Centre and radius.
        x: f64,
        /// Centre.
        y: f64,
        /// Radius.
        radius: f64,
        /// The picture.
        path: PathBuf,
        /// Its width and height.
        size: (u32, u32),
    },
    /// The tag was not found.
    #[error(
        "no tag of the family {family} found in {path}: it must lie flat, sharp and whole in the \
         picture without the ball; or leave --tag out"
    )]
    NoTag {
        /// The family.
        family: String,
        /// The picture.
        path: PathBuf,
    },
    /// A tag and a ball contradict each other.
    #[error(
        "the ball's centre is {height_mm:.0} mm above the tag's plane, its radius is {radius_mm:.0} mm: \
         tag and ball must stand on one surface; check --ball-diameter and --tag"
    )]
    BallAndTag {
        /// Height of the ball's centre, millimetres.
        height_mm: f64,
        /// Radius, millimetres.
        radius_mm: f64,
    },
    /// The camera does not look at the ground.
    #[error(
        "the ball seems to hang {degrees:.0}° above the camera's horizon; state how far the camera \
         looked down: --tilt DEGREES"
    )]
    AboveHorizon {
        /// Elevation, degrees.
        degrees: f64,
    },
    /// The corners are not those of a rectangle on the ground.
    #[error(transparent)]
    Rectangle(#[from] RectangleError),
    /// The ball is not on the ground of the rectangle.
    #[error(
        "--ground: the ball seems to hang {degrees:.0}° above the horizon of the rectangle's plane; check its \
         corners, and the ball's outline (--ball)"
    )]
    AboveRectangle {
        /// Elevation, degrees.
        degrees: f64,
    },
    /// The session cannot be written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Encode(#[from] image::ImageError),
}
