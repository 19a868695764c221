//! Photographs that lie on one another: all that does not depend on where ball and ground are.

use crate::align::shift;
use crate::ball;
use crate::error::PhotoError;
use crate::photograph::Photograph;
use crate::tone::{self, ExposuresFrom, Tone};
use crate::turn::turn;
use crate::{ASSUMED_FIELD_OF_VIEW_DEGREES, BallPicture, PhotoOptions};
use glam::{DVec2, IVec2};
use penumbra_camera::PinholeCamera;
use penumbra_lighting::Circle;
use std::sync::Arc;

/// Share of pixels that may differ between aligned pictures: the ball, its shadow and people.
const MAX_DIFFERING: f64 = 0.3;
/// Difference of exposures beyond which a picture may show too little to be aligned, stops.
const DARKER: f64 = 2.0;

/// The photographs, aligned, with lens, exposures and tone curve. Ball and ground may be sought in them
/// several times.
#[derive(Clone, Debug)]
pub struct Photographs {
    pub(crate) empty: Arc<Photograph>,
    pub(crate) with_ball: Vec<Shifted>,
    /// Factor from the codes of the picture without the ball to those of the first with it.
    pub(crate) gain: Option<f64>,
    pub(crate) camera: PinholeCamera,
    pub(crate) is_lens_assumed: bool,
    pub(crate) exposures_from: ExposuresFrom,
    pub(crate) tone: Tone,
}

/// A picture that shows the ball somewhere.
#[derive(Clone, Debug)]
pub(crate) struct Shifted {
    pub photograph: Arc<Photograph>,
    pub shift: IVec2,
    /// By how much the camera was turned about its axis against the picture without the ball, degrees, if it was.
    pub turned_degrees: Option<f64>,
    pub ev: f64,
}

impl Photographs {
    /// Aligns the photographs, and measures the tone curve. Of `options`, lens and exposures count.
    ///
    /// # Errors
    /// The pictures differ in size or place.
    pub fn new(
        empty: Photograph,
        balls: Vec<Photograph>,
        options: &PhotoOptions,
    ) -> Result<Self, PhotoError> {
        let (camera, is_lens_assumed) = lens(&empty, options.field_of_view_degrees);
        let (stops, exposures_from) = stops(&empty, &balls, options);
        let with_ball = aligned(&empty, balls.into_iter().zip(stops).collect())?;
        let series: Vec<_> = with_ball
            .iter()
            .map(|b| (&b.photograph.picture, b.ev, b.shift))
            .collect();
        let first = with_ball.first();
        Ok(Self {
            tone: tone::tone(&series),
            gain: first.and_then(|b| ball::gain(&empty.picture, &b.photograph.picture)),
            empty: Arc::new(empty),
            with_ball,
            camera,
            is_lens_assumed,
            exposures_from,
        })
    }

    /// Returns the picture with the ball whose exposure is the most similar to that of the picture without it;
    /// stated circles and corners are in its pixels.
    #[must_use]
    pub fn first(&self) -> &Photograph {
        self.with_ball
            .first()
            .map_or(&self.empty, |b| &b.photograph)
    }

    /// Shift of that picture against the one without the ball, pixels.
    pub(crate) fn shift(&self) -> DVec2 {
        let first = self.with_ball.first();
        first.map_or(DVec2::ZERO, |b| b.shift.as_dvec2())
    }

    /// Returns the pictures with the ball, which is at `circle` in the first.
    pub(crate) fn balls(&self, circle: Circle) -> Vec<BallPicture> {
        let first = self.shift();
        let with = |picture: &Shifted| BallPicture {
            circle: Circle {
                centre: circle.centre + picture.shift.as_dvec2() - first,
                ..circle
            },
            photograph: Arc::clone(&picture.photograph),
            shift: picture.shift,
            turned_degrees: picture.turned_degrees,
            ev: picture.ev,
        };
        self.with_ball.iter().map(with).collect()
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

/// Returns the exposures of the pictures with the ball relative to the one without, and what tells
/// them.
fn stops(
    empty: &Photograph,
    balls: &[Photograph],
    options: &PhotoOptions,
) -> (Vec<f64>, ExposuresFrom) {
    if let Some(stated) = &options.exposures {
        let relative = stated.iter().map(|ev| ev - stated[0]);
        return (relative.skip(1).collect(), ExposuresFrom::Stated);
    }
    let all: Vec<&Photograph> = std::iter::once(empty).chain(balls).collect();
    let (stops, from) = tone::exposures(&all);
    (stops.into_iter().skip(1).collect(), from)
}

/// Aligns the pictures to the one without the ball, those of the most similar exposures first. A much
/// darker one shows too little to be compared: it has the shift of the one before it.
fn aligned(
    empty: &Photograph,
    mut balls: Vec<(Photograph, f64)>,
) -> Result<Vec<Shifted>, PhotoError> {
    let size = |p: &Photograph| (p.picture.width, p.picture.height);
    // Stable: of equal exposures the first given.
    balls.sort_by(|a, b| {
        (8.0 * a.1.abs())
            .round()
            .total_cmp(&(8.0 * b.1.abs()).round())
    });
    let mut pictures: Vec<Shifted> = Vec::new();
    for (photograph, ev) in balls {
        if size(&photograph) != size(empty) {
            return Err(PhotoError::Size {
                path: photograph.path.clone(),
                size: size(&photograph),
                first: empty.path.clone(),
                first_size: size(empty),
            });
        }
        let before = pictures.last().map_or(IVec2::ZERO, |p| p.shift);
        let pixels = match shift(&empty.picture, &photograph.picture) {
            Some(found) if found.differing <= MAX_DIFFERING => found.pixels,
            Some(found) if ev.abs() < DARKER => {
                return Err(PhotoError::Unaligned {
                    path: photograph.path.clone(),
                    first: empty.path.clone(),
                    percent: 100.0 * found.differing,
                });
            }
            _ => before,
        };
        let turned = turn(&empty.picture, &photograph.picture, pixels);
        pictures.push(Shifted {
            photograph: Arc::new(photograph),
            shift: pixels,
            turned_degrees: turned.map(f64::to_degrees),
            ev,
        });
    }
    Ok(pictures)
}
