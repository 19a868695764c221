//! From photographs of a place, one without and one or more with a mirrored ball, to a session that
//! can be composited: what a person with a phone can do without a rig.
//!
//! The picture without the ball is the scene; the ball shows the light at the very place where the
//! virtual objects will stand. EXIF gives exposures and the lens, the ball's outline its place, and a
//! printed tag or the user the direction of the ground. Several exposures of
//! the ball are merged, and tell the camera's tone curve.

mod align;
mod ball;
mod check;
mod draw;
mod error;
mod photograph;
mod placement;
mod session;
mod tone;

pub use align::{Shift, shift};
pub use ball::FoundBall;
pub use check::ShadowCheck;
pub use error::PhotoError;
pub use photograph::Photograph;
pub use placement::{ASSUMED_TILT_DEGREES, GroundFrom, Placement, PrintedTag};
pub use tone::Tone;

use glam::{DVec2, IVec2};
use penumbra_camera::PinholeCamera;
use penumbra_lighting::Circle;

/// Field of view along the longer side if nothing tells the lens: that of a phone's main camera, degrees.
pub const ASSUMED_FIELD_OF_VIEW_DEGREES: f64 = 66.0;
/// Reflectance of a silvered glass ball.
pub const ASSUMED_REFLECTANCE: f32 = 0.85;
/// Share of pixels that may differ between aligned pictures: the ball, its shadow and people.
const MAX_DIFFERING: f64 = 0.3;
/// What the user states.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoOptions {
    /// The ball's radius, metres.
    pub ball_radius: f64,
    /// Linear reflectance of the ball.
    pub reflectance: [f32; 3],
    /// The ball's circle in the first picture that shows it, if it shall not be searched; pixels.
    pub circle: Option<Circle>,
    /// Field of view along the longer side in place of EXIF's, degrees.
    pub field_of_view_degrees: Option<f64>,
    /// How far the camera looked down, degrees.
    pub tilt_degrees: Option<f64>,
    /// A printed tag on the ground, in the picture without the ball.
    pub tag: Option<PrintedTag>,
    /// Exposures in stops of all pictures, the one without the ball first, in place of EXIF's.
    pub exposures: Option<Vec<f64>>,
}

/// A picture that shows the ball.
#[derive(Clone, Debug)]
pub struct BallPicture {
    /// The photograph.
    pub photograph: Photograph,
    /// Its shift against the picture without the ball, pixels.
    pub shift: IVec2,
    /// Its exposure relative to the picture without the ball, stops.
    pub ev: f64,
    /// The ball's circle in it, pixels.
    pub circle: Circle,
}

/// Everything that the photographs tell.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// The picture without the ball.
    pub empty: Photograph,
    /// The pictures that show the ball at the place where the light is measured.
    pub balls: Vec<BallPicture>,
    /// The lens.
    pub camera: PinholeCamera,
    /// Whether the lens is assumed: neither EXIF nor the user tells it.
    pub is_lens_assumed: bool,
    /// Whether all exposures are EXIF's or stated; otherwise they are estimated from the pictures.
    pub are_exposures_known: bool,
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
}

impl Analysis {
    /// Analyses the photographs.
    ///
    /// # Errors
    /// The pictures differ in size or place, or ball or tag are not found.
    pub fn new(
        empty: Photograph,
        balls: Vec<Photograph>,
        options: &PhotoOptions,
    ) -> Result<Self, PhotoError> {
        let (camera, is_lens_assumed) = lens(&empty, options.field_of_view_degrees);
        let (stops, are_exposures_known) = stops(&empty, &balls, options);
        let mut pictures = Vec::new();
        for (photograph, ev) in balls.into_iter().zip(stops) {
            let shift = aligned(&empty, &photograph)?;
            pictures.push(Shifted {
                photograph,
                shift,
                ev,
            });
        }
        let balls = with_ball(&empty, pictures, options.circle)?;
        let best = best_exposed(&balls);
        let ball = fitted(best, &empty, &camera, options.circle.is_some())?;
        let series: Vec<_> = balls
            .iter()
            .map(|b| (&b.photograph.picture, b.ev, b.shift))
            .collect();
        let tone = tone::tone(&series);
        let placement = place(&empty, &camera, &tone, &ball, options)?;
        Ok(Self {
            empty,
            camera,
            is_lens_assumed,
            are_exposures_known,
            ball,
            placement,
            tone,
            ball_radius: options.ball_radius,
            reflectance: options.reflectance,
            balls,
        })
    }
}

/// Returns the lens, and whether it is assumed.
fn lens(empty: &Photograph, field_of_view: Option<f64>) -> (PinholeCamera, bool) {
    let (width, height) = (empty.picture.width, empty.picture.height);
    let half = f64::from(width.max(height)) / 2.0;
    let by_angle = |degrees: f64| half / (degrees / 2.0).to_radians().tan();
    let stated = field_of_view.map(by_angle).or(empty.focal);
    let focal = stated.unwrap_or_else(|| by_angle(ASSUMED_FIELD_OF_VIEW_DEGREES));
    let camera = PinholeCamera {
        width,
        height,
        focal: DVec2::splat(focal),
        centre: empty.middle(),
        distortion: [0.0; 5],
    };
    (camera, stated.is_none())
}

/// Returns the exposures of the pictures with the ball relative to the one without, and whether they
/// are known.
fn stops(empty: &Photograph, balls: &[Photograph], options: &PhotoOptions) -> (Vec<f64>, bool) {
    if let Some(stated) = &options.exposures {
        let relative = stated.iter().map(|ev| ev - stated[0]);
        return (relative.skip(1).collect(), true);
    }
    let all: Vec<&Photograph> = std::iter::once(empty).chain(balls).collect();
    let (stops, are_known) = tone::exposures(&all);
    (stops.into_iter().skip(1).collect(), are_known)
}

/// Returns the shift of a picture to the one without the ball.
fn aligned(empty: &Photograph, photograph: &Photograph) -> Result<IVec2, PhotoError> {
    let size = |p: &Photograph| (p.picture.width, p.picture.height);
    if size(photograph) != size(empty) {
        return Err(PhotoError::Size {
            path: photograph.path.clone(),
            size: size(photograph),
            first: empty.path.clone(),
            first_size: size(empty),
        });
    }
    let Some(found) = shift(&empty.picture, &photograph.picture) else {
        return Ok(IVec2::ZERO);
    };
    if found.differing > MAX_DIFFERING {
        return Err(PhotoError::Unaligned {
            path: photograph.path.clone(),
            first: empty.path.clone(),
            percent: 100.0 * found.differing,
        });
    }
    Ok(found.pixels)
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

/// A picture that shows the ball somewhere.
struct Shifted {
    photograph: Photograph,
    shift: IVec2,
    ev: f64,
}

impl Shifted {
    fn with(self, circle: Circle) -> BallPicture {
        BallPicture {
            photograph: self.photograph,
            shift: self.shift,
            ev: self.ev,
            circle,
        }
    }

    /// Returns the ball's circle, moved by the picture's shift from that of another picture.
    fn moved(&self, circle: Circle, shift: IVec2) -> Circle {
        Circle {
            centre: circle.centre + (self.shift - shift).as_dvec2(),
            ..circle
        }
    }
}

/// Finds the ball in the picture whose exposure is closest to that of the picture without it. The others
/// show it at the same place.
fn with_ball(
    empty: &Photograph,
    mut pictures: Vec<Shifted>,
    stated: Option<Circle>,
) -> Result<Vec<BallPicture>, PhotoError> {
    // Of equal exposures the first given.
    let reference = (0..pictures.len()).min_by(|&a, &b| {
        let stops = |i: usize| (8.0 * pictures[i].ev.abs()).round();
        stops(a).total_cmp(&stops(b))
    });
    let Some(reference) = reference else {
        return Ok(Vec::new());
    };
    let stated = stated
        .map(|circle| inside(circle, &pictures[0].photograph))
        .transpose()?
        .map(|circle| pictures[reference].moved(circle, pictures[0].shift));
    let reference = pictures.remove(reference);
    let picture = &reference.photograph.picture;
    let circle = stated
        .or_else(|| ball::find(picture, &empty.picture, reference.shift))
        .ok_or_else(|| no_ball(&reference.photograph))?;
    let shift = reference.shift;
    let mut balls = vec![reference.with(circle)];
    for picture in pictures {
        let here = picture.moved(circle, shift);
        balls.push(picture.with(here));
    }
    Ok(balls)
}

/// Returns the picture whose exposure is closest to that of the picture without the ball.
fn best_exposed(balls: &[BallPicture]) -> Option<&BallPicture> {
    balls
        .iter()
        .min_by(|a, b| a.ev.abs().total_cmp(&b.ev.abs()))
}

/// Fits the ball's outline. A stated circle of which nothing is visible is believed.
fn fitted(
    picture: Option<&BallPicture>,
    empty: &Photograph,
    camera: &PinholeCamera,
    is_stated: bool,
) -> Result<FoundBall, PhotoError> {
    let Some(BallPicture {
        photograph,
        shift,
        circle,
        ..
    }) = picture
    else {
        return Err(PhotoError::NoBall {
            path: std::path::PathBuf::new(),
        });
    };
    let found = ball::cone(
        [&photograph.picture, &empty.picture],
        camera,
        *circle,
        *shift,
    );
    match found {
        Some(found) => Ok(found),
        None if is_stated => {
            let centre = circle.centre - shift.as_dvec2();
            Ok(ball::stated(camera, Circle { centre, ..*circle }))
        }
        None => Err(no_ball(photograph)),
    }
}

fn place(
    empty: &Photograph,
    camera: &PinholeCamera,
    tone: &Tone,
    ball: &FoundBall,
    options: &PhotoOptions,
) -> Result<Placement, PhotoError> {
    let radius = options.ball_radius;
    if let Some(tag) = options.tag {
        return placement::by_tag(empty, camera, &tone.response, tag, ball, radius);
    }
    if let Some(tilt) = options.tilt_degrees {
        return placement::by_tilt(ball, radius, tilt, GroundFrom::Stated);
    }
    placement::by_tilt(ball, radius, ASSUMED_TILT_DEGREES, GroundFrom::Assumed)
}
