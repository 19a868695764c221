//! Problems of a lens calibration.

use super::estimate::NoEstimate;
use penumbra_fiducials::Family;
use thiserror::Error;

/// A problem of a calibration. Each message names the problem and the remedy.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Finding {
    /// There is no lens at all.
    #[error(transparent)]
    NoLens(#[from] NoEstimate),
    /// No picture shows the board.
    #[error("none of {pictures} pictures shows the board; check --board, light and focus")]
    BoardNotSeen {
        /// Pictures looked at.
        pictures: usize,
    },
    /// The board has another number of corners than was said.
    #[error(
        "the board in the pictures has {columns}×{rows} inner corners, not as said; give its true size with --board"
    )]
    OtherBoard {
        /// Seen in a row.
        columns: u32,
        /// Rows seen.
        rows: u32,
    },
    /// Tags of another family.
    #[error(
        "the tags in the pictures are of {seen}, the board was said to be of {said}; give its true dictionary with --board"
    )]
    OtherFamily {
        /// In the pictures.
        seen: Family,
        /// Of the board as it was said.
        said: Family,
    },
    /// The tags lie as on another board.
    #[error(
        "the tags do not lie as on the board that was said{}; give its true columns and rows with --board", like(*columns)
    )]
    OtherLayout {
        /// In how many columns they do lie, where that can be told.
        columns: Option<u32>,
    },
    /// Tags of the board's family that the board does not have.
    #[error(
        "{pictures} pictures show tags that the board said does not have; has it more rows, or is there another board?"
    )]
    TagsBeside {
        /// Pictures.
        pictures: usize,
    },
    /// The lens is the one that the rig has for the other camera.
    #[error(
        "size or focal length are those of the {seen} camera in rig.json, not of the {said} camera; are the cameras swapped?"
    )]
    OtherCamera {
        /// Whose lens it was said to be.
        said: &'static str,
        /// Whose it is like.
        seen: &'static str,
    },
    /// Pictures of another size than the rig's.
    #[error(
        "rig.json's pictures of this camera are {width}×{height}: the rig cannot use this lens; calibrate in the mode that is used"
    )]
    OtherMode {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Another kind of lens than the rig's.
    #[error("rig.json says another kind of lens; calibrate with --model {model}")]
    OtherModel {
        /// As `--model` has it.
        model: &'static str,
    },
    /// A fisheye's rim was not seen.
    #[error(
        "corners were seen up to {seen:.0}° from the axis, light comes from up to {lit:.0}°, the lens is known to {known:.0}°; hold the board closer, at the rim of the picture"
    )]
    RimUnseen {
        /// Degrees.
        seen: f64,
        /// Degrees.
        lit: f64,
        /// Degrees.
        known: f64,
    },
    /// Pictures of several cameras, or of one in several modes.
    #[error("the pictures have several sizes; give those of one camera in one mode")]
    SizesDiffer,
    /// Too few views for a sure result.
    #[error("{used} views were used; take 15 or more")]
    FewViews {
        /// That agree.
        used: usize,
    },
    /// Many views contradict the others.
    #[error(
        "{rejected} of {views} views contradict the others: motion blur, a bent board, or two cameras mixed"
    )]
    ViewsDisagree {
        /// Left out.
        rejected: usize,
        /// Of so many.
        views: usize,
    },
    /// The board was held parallel to the picture.
    #[error("the board was tilted by {degrees:.0}° at most; tilt it by 20° to 45° to all sides")]
    NoTilt {
        /// The largest angle.
        degrees: f64,
    },
    /// Parts of the picture without corners.
    #[error("corners cover {percent:.0} % of the picture; hold the board into every part of it")]
    PoorCoverage {
        /// Of the picture's cells.
        percent: f64,
    },
    /// Corners are not where the lens puts them.
    #[error(
        "reprojection error is {pixels:.2} px; a flat board, sharp pictures and no motion give 0.1 to 0.4 px"
    )]
    LargeResiduals {
        /// Root mean square.
        pixels: f64,
    },
    /// The focal length is not sure.
    #[error(
        "the focal length is known to {percent:.2} % only; tilt the board more, and fill the picture with it"
    )]
    FocalUncertain {
        /// 1σ.
        percent: f64,
    },
    /// Somewhere in the picture the lens is not sure.
    #[error(
        "somewhere in the picture the lens is known to {pixels:.1} px only; show the board there"
    )]
    ProjectionUncertain {
        /// 1σ at the worst place.
        pixels: f64,
    },
    /// A lens that no camera has.
    #[error("the lens found is no camera's ({what}); check the board's size, and take more views")]
    Implausible {
        /// What is wrong with it.
        what: &'static str,
    },
}

fn like(columns: Option<u32>) -> String {
    columns.map_or_else(String::new, |n| format!(" but as on one with {n} in a row"))
}
