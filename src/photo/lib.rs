//! From photographs of a place, one without and one or more with a mirrored ball, to a session that
//! can be composited: what a person with a phone can do without a rig.
//!
//! The picture without the ball is the scene; the ball shows the light at the very place where the
//! virtual objects will stand. EXIF gives exposures and the lens, the ball's outline its place, and a
//! printed tag, a rectangle or the user the direction of the ground. Several exposures of
//! the ball are merged, and tell the camera's tone curve.

mod align;
mod ball;
mod check;
mod draw;
mod energy;
mod error;
mod photograph;
mod photographs;
mod placement;
mod rectangle;
mod session;
mod shadow;
mod tone;
mod turn;

pub use align::{Shift, shift};
pub use ball::FoundBall;
pub use check::ShadowCheck;
pub use draw::Line;
pub use energy::RaisedLamp;
pub use error::PhotoError;
pub use photograph::Photograph;
pub use photographs::Photographs;
pub use placement::{ASSUMED_TILT_DEGREES, GroundFrom, Placement, PrintedTag};
pub use rectangle::RectangleError;
pub use session::png;
pub use tone::{ExposuresFrom, Tone};

use ball::Sight;
use glam::{DVec2, IVec2};
use penumbra_camera::PinholeCamera;
use penumbra_lighting::{Circle, is_matt};
use photographs::Shifted;
use std::sync::Arc;

/// Field of view along the longer side if nothing tells the lens: that of a phone's main camera, degrees.
pub const ASSUMED_FIELD_OF_VIEW_DEGREES: f64 = 66.0;
/// Reflectance of a silvered glass ball.
pub const ASSUMED_REFLECTANCE: f32 = 0.85;
/// Space between a ball that is found and the picture's border, radii: the outline of a ball that is cut
/// off is found somewhere within it.
const SPACE: f64 = 0.25;

/// What the user states.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoOptions {
    /// The ball's radius, metres.
    pub ball_radius: f64,
    /// Linear reflectance of the ball.
    pub reflectance: [f32; 3],
    /// The ball's circle, if it shall not be searched; pixels of the picture with the ball whose exposure
    /// is the most similar to that of the picture without it.
    pub circle: Option<Circle>,
    /// Field of view along the longer side in place of EXIF's, degrees.
    pub field_of_view_degrees: Option<f64>,
    /// How far the camera looked down, degrees.
    pub tilt_degrees: Option<f64>,
    /// A printed tag on the ground, in the picture without the ball. It comes before a rectangle and the tilt.
    pub tag: Option<PrintedTag>,
    /// Corners of a rectangle on the ground, in order round it; pixels of the same picture as `circle`. It
    /// comes before the tilt.
    pub rectangle: Option<[DVec2; 4]>,
    /// Exposures in stops of all pictures, the one without the ball first, in place of EXIF's.
    pub exposures: Option<Vec<f64>>,
}

/// A picture that shows the ball.
#[derive(Clone, Debug)]
pub struct BallPicture {
    /// The photograph.
    pub photograph: Arc<Photograph>,
    /// Its shift against the picture without the ball, pixels.
    pub shift: IVec2,
    /// By how much the camera was turned about its axis against the picture without the ball, degrees, if it was.
    pub turned_degrees: Option<f64>,
    /// Its exposure relative to the picture without the ball, stops.
    pub ev: f64,
    /// The ball's circle in it, pixels.
    pub circle: Circle,
}

/// Everything that the photographs tell. Copies share the pictures.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// The picture without the ball.
    pub empty: Arc<Photograph>,
    /// The pictures that show the ball, at least one, those of the most similar exposures first.
    pub balls: Vec<BallPicture>,
    /// The lens.
    pub camera: PinholeCamera,
    /// Whether the lens is assumed: neither EXIF nor the user tells it.
    pub is_lens_assumed: bool,
    /// What tells the exposures.
    pub exposures_from: ExposuresFrom,
    /// The ball.
    pub ball: FoundBall,
    /// Camera, ground and ball.
    pub placement: Placement,
    /// The tone curve.
    pub tone: Tone,
    /// The ball's radius, metres.
    pub ball_radius: f64,
    /// Linear reflectance of the ball.
    pub reflectance: [f32; 3],
    /// Lamps that are brighter than the pictures show.
    pub raised: Vec<RaisedLamp>,
}

impl Analysis {
    /// Analyses the photographs.
    ///
    /// # Errors
    /// The pictures differ in size or place, or ball, tag or rectangle are not found.
    pub fn new(
        empty: Photograph,
        balls: Vec<Photograph>,
        options: &PhotoOptions,
    ) -> Result<Self, PhotoError> {
        Photographs::new(empty, balls, options)?.analyse(options)
    }
}

impl Photographs {
    /// Finds ball and ground.
    ///
    /// # Errors
    /// Ball, tag or rectangle are not found.
    pub fn analyse(&self, options: &PhotoOptions) -> Result<Analysis, PhotoError> {
        let (circle, ball) = self.ball(options.circle)?;
        let placement = self.placement(&ball, options)?;
        Ok(Analysis {
            empty: Arc::clone(&self.empty),
            balls: self.balls(circle),
            camera: self.camera.clone(),
            is_lens_assumed: self.is_lens_assumed,
            exposures_from: self.exposures_from,
            ball,
            placement,
            tone: self.tone.clone(),
            ball_radius: options.ball_radius,
            reflectance: options.reflectance,
            raised: Vec::new(),
        })
    }

    /// Returns the ball's circle in the [first](Self::first) picture, searched or near the `stated` one, and its
    /// outline. A stated circle of which too little is visible is believed.
    ///
    /// # Errors
    /// No ball is found, or the stated circle is outside the picture.
    pub fn ball(&self, stated: Option<Circle>) -> Result<(Circle, FoundBall), PhotoError> {
        let first = self.with_ball.first().ok_or_else(|| no_ball(&self.empty))?;
        let sight = Sight {
            with: &first.photograph.picture,
            without: &self.empty.picture,
            shift: first.shift,
            gain: self.gain,
            camera: &self.camera,
        };
        let ball = match stated {
            Some(circle) => sight.cone_by_eye(inside(circle, &first.photograph)?),
            None => sight.outermost(sight.cone(found(&self.empty, first)?)),
        };
        if stated.is_none() && !ball.is_fitted {
            return Err(no_ball(&first.photograph));
        }
        let circle = Circle {
            centre: ball.circle.centre + self.shift(),
            ..ball.circle
        };
        Ok((circle, ball))
    }

    /// Places camera and ground by what `options` state.
    ///
    /// # Errors
    /// The tag is not found, the corners are not those of a rectangle, or the ball is not on the ground.
    pub fn placement(
        &self,
        ball: &FoundBall,
        options: &PhotoOptions,
    ) -> Result<Placement, PhotoError> {
        let radius = options.ball_radius;
        if let Some(tag) = options.tag {
            let response = &self.tone.response;
            return placement::by_tag(&self.empty, &self.camera, response, tag, ball, radius);
        }
        if let Some(corners) = options.rectangle {
            let corners = corners.map(|corner| corner - self.shift());
            return placement::by_rectangle(ball, radius, &corners, &self.camera);
        }
        match options.tilt_degrees {
            Some(tilt) => placement::by_tilt(ball, radius, tilt, GroundFrom::Stated),
            None => placement::by_tilt(ball, radius, ASSUMED_TILT_DEGREES, GroundFrom::Assumed),
        }
    }
}

fn inside(circle: Circle, photograph: &Photograph) -> Result<Circle, PhotoError> {
    let size = (photograph.picture.width, photograph.picture.height);
    let (w, h) = (f64::from(size.0), f64::from(size.1));
    let (x, y, radius) = (circle.centre.x, circle.centre.y, circle.radius);
    let is_inside = (0.0..w).contains(&x) && (0.0..h).contains(&y);
    if is_inside && radius >= 4.0 && radius <= w.max(h) / 2.0 {
        return Ok(circle);
    }
    Err(PhotoError::BallOutside {
        x,
        y,
        radius,
        path: photograph.path.clone(),
        size,
    })
}

fn no_ball(photograph: &Photograph) -> PhotoError {
    PhotoError::NoBall {
        path: photograph.path.clone(),
    }
}

/// Searches the ball.
fn found(empty: &Photograph, with: &Shifted) -> Result<Circle, PhotoError> {
    let Photograph { path, picture, .. } = &*with.photograph;
    let circle =
        ball::find(picture, &empty.picture, with.shift).ok_or_else(|| no_ball(&with.photograph))?;
    let size = DVec2::new(f64::from(picture.width), f64::from(picture.height));
    let reach = (1.0 + SPACE) * circle.radius;
    let space = circle.centre.min(size - 1.0 - circle.centre);
    if space.min_element() < reach {
        let path = path.clone();
        return Err(PhotoError::BallAtBorder { path, circle });
    }
    if is_matt(picture, circle) {
        let path = path.clone();
        return Err(PhotoError::MattBall { path, circle });
    }
    Ok(circle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_picture::Picture;
    use std::path::Path;

    fn photograph(name: &str) -> Photograph {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/photo");
        Photograph::read(&folder.join(name)).unwrap()
    }

    fn options(exposures: &[f64]) -> PhotoOptions {
        PhotoOptions {
            ball_radius: 0.04,
            reflectance: [0.85; 3],
            circle: None,
            field_of_view_degrees: None,
            tilt_degrees: Some(28.0),
            tag: None,
            rectangle: None,
            exposures: Some(exposures.to_vec()),
        }
    }

    fn black(like: &Photograph) -> Photograph {
        let Picture { width, height, .. } = like.picture;
        let codes = (0..width * height).map(|i| ((i.wrapping_mul(2_654_435_761) >> 13) % 3) as u8);
        let rgba = codes.flat_map(|code| [code, code, code, 255]).collect();
        Photograph {
            picture: Picture {
                width,
                height,
                rgba,
            },
            ..like.clone()
        }
    }

    #[test]
    fn pictures_are_used_in_any_order_and_dark_ones_are_not_refused() {
        let empty = photograph("empty.jpg");
        let dark = black(&empty);
        let balls = vec![dark, photograph("ball2.jpg"), photograph("ball1.jpg")];
        let found = Analysis::new(empty, balls, &options(&[0.0, -12.0, -3.0, 0.0])).unwrap();
        let stops: Vec<f64> = found.balls.iter().map(|b| b.ev).collect();
        assert_eq!(stops, [0.0, -3.0, -12.0]);
        assert!(found.balls.iter().all(|b| b.shift == IVec2::ZERO));
        let centre = found.ball.circle.centre;
        assert!(centre.distance(DVec2::new(220.0, 179.0)) < 2.0, "{centre}");
    }

    #[test]
    fn ball_that_mirrors_the_table_is_found_whole() {
        let pictures = [photograph("steep_empty.jpg"), photograph("steep_ball.jpg")];
        let [empty, with] = pictures;
        let found = Analysis::new(empty, vec![with], &options(&[0.0, 0.0])).unwrap();
        // By the renderer's own geometry; the round edge of the table in the ball has a radius of 16.
        let Circle { centre, radius } = found.ball.circle;
        assert!(centre.distance(DVec2::new(222.4, 179.5)) < 1.5, "{centre}");
        assert!((radius - 22.8).abs() < 2.0, "{radius}");
    }

    /// A photograph of four times the size that is no sharper.
    fn enlarged(photograph: &Photograph) -> Photograph {
        let Picture {
            width,
            height,
            ref rgba,
        } = photograph.picture;
        let image = image::RgbaImage::from_raw(width, height, rgba.clone()).unwrap();
        let filter = image::imageops::FilterType::CatmullRom;
        let large = image::imageops::resize(&image, 4 * width, 4 * height, filter);
        Photograph {
            picture: Picture {
                width: 4 * width,
                height: 4 * height,
                rgba: large.into_raw(),
            },
            focal: photograph.focal.map(|focal| 4.0 * focal),
            ..photograph.clone()
        }
    }

    #[test]
    fn ball_is_found_in_large_pictures_that_are_not_sharp() {
        let pairs = [
            ("empty.jpg", "ball1.jpg", DVec2::new(220.0, 179.0), 25.8),
            (
                "steep_empty.jpg",
                "steep_ball.jpg",
                DVec2::new(222.4, 179.5),
                22.8,
            ),
        ];
        for (empty, with, centre, radius) in pairs {
            let [empty, with] = [empty, with].map(|name| enlarged(&photograph(name)));
            let found = Analysis::new(empty, vec![with], &options(&[0.0, 0.0])).unwrap();
            let found = found.ball.circle;
            assert!(found.centre.distance(4.0 * centre) < 8.0, "{found:?}");
            assert!(
                (found.radius / (4.0 * radius) - 1.0).abs() < 0.1,
                "{found:?}"
            );
        }
    }

    /// The picture with its columns from `left` on, and `paint` over it.
    fn changed(
        photograph: &Photograph,
        left: u32,
        paint: impl Fn(u32, u32) -> Option<u8>,
    ) -> Photograph {
        let Picture { width, height, .. } = photograph.picture;
        let pixels = (0..height).flat_map(|y| (left..width).map(move |x| (x, y)));
        let rgba = pixels.flat_map(|(x, y)| {
            let shown = photograph.picture.rgb(x, y);
            let [r, g, b] = paint(x, y).map_or(shown, |code| [code; 3]);
            [r, g, b, 255]
        });
        Photograph {
            picture: Picture {
                width: width - left,
                height,
                rgba: rgba.collect(),
            },
            ..photograph.clone()
        }
    }

    #[test]
    fn matt_things_boxes_and_balls_that_are_cut_off_are_refused() {
        let empty = photograph("empty.jpg");
        let refused = |empty: Photograph, with: Photograph| {
            let found = Analysis::new(empty, vec![with], &options(&[0.0, 0.0]));
            found.map(|_| ()).unwrap_err().to_string()
        };
        let matt = changed(&empty, 0, |x, y| {
            let at = (DVec2::new(f64::from(x), f64::from(y)) - DVec2::new(230.0, 190.0)) / 28.0;
            let z = 1.0 - at.length_squared();
            (z > 0.0).then(|| (40.0 + 60.0 * (z.sqrt() - at.x).max(0.0)) as u8)
        });
        let message = refused(empty.clone(), matt);
        assert!(message.contains("shaded like something matt"), "{message}");
        let boxed = changed(&empty, 0, |x, y| {
            ((190..270).contains(&x) && (140..200).contains(&y)).then_some(30)
        });
        let message = refused(empty.clone(), boxed);
        assert!(message.contains("no ball found"), "{message}");
        let as_it_is = |_, _| None;
        let cut_off = |left| {
            let with = changed(&photograph("ball1.jpg"), left, as_it_is);
            refused(changed(&empty, left, as_it_is), with)
        };
        let (half, third) = (cut_off(220), cut_off(208));
        assert!(half.contains("no ball found"), "{half}");
        assert!(third.contains("reaches the border"), "{third}");
    }

    #[test]
    fn pictures_of_another_place_are_refused() {
        let empty = photograph("empty.jpg");
        let mut elsewhere = empty.clone();
        let row = 4 * empty.picture.width as usize;
        let upside_down = empty.picture.rgba.chunks(row).rev().flatten();
        elsewhere.picture.rgba = upside_down.copied().collect();
        let refused = Analysis::new(empty, vec![elsewhere], &options(&[0.0, 0.0])).unwrap_err();
        let message = refused.to_string();
        assert!(
            message.contains("does not show the same place"),
            "{message}"
        );
    }
}
