//! Compares the ball in the photograph with the same ball put back virtually: the photograph with
//! the ball is the truth for the one without.

use crate::photograph::reduced;
use crate::shadow::{mean_light, nine};
use crate::{Analysis, BallPicture};
use glam::{DVec2, IVec2};
use penumbra_camera::Response;
use penumbra_lighting::Circle;
use penumbra_picture::Picture;

/// Minimum darkening of a pixel that is shadow, relative.
const MIN_DEPTH: f64 = 0.04;
/// Smallest code that may be clipped.
const CLIPPED: u8 = 253;
/// Distance up to which shadows are compared, radii from the ball's centre.
const REACH: f64 = 5.0;

/// How the ball's real and virtual shadows agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowCheck {
    /// Mean darkening of the photograph in the shadow, relative to the picture without the ball.
    pub real: f64,
    /// Mean darkening of the composite at the same pixels.
    pub composite: f64,
    /// Root mean square difference of both there.
    pub difference: f64,
    /// Number of pixels compared.
    pub pixels: usize,
}

/// Minimum light of a pixel in which a shadow is measured; 1 is white.
const MIN_LIGHT: f64 = 0.01;

impl Analysis {
    /// Compares the shadow of the ball with that in `composite`: the picture without the ball, with
    /// a virtual ball put in its place. `None` if the ball throws no shadow that can be measured.
    #[must_use]
    pub fn check(&self, composite: &Picture) -> Option<ShadowCheck> {
        let real = self.balls.first()?;
        let factor = self.camera.width / composite.width.max(1);
        if factor == 0 {
            return None;
        }
        let empty = reduced(&self.empty.picture, factor);
        let with = reduced(&real.photograph.picture, factor);
        let shift = (real.shift.as_dvec2() / f64::from(factor)).round();
        let circle = crate::session::reduced_circle(&self.ball, f64::from(factor));
        let response = &self.tone.response;
        let gain = real.ev.exp2();
        let (mut n, mut sums, mut squares) = (0usize, [0.0; 2], 0.0);
        for y in 0..i64::from(composite.height) {
            for x in 0..i64::from(composite.width) {
                let distance = DVec2::new(x as f64, y as f64).distance(circle.centre);
                if !(1.08 * circle.radius..REACH * circle.radius).contains(&distance) {
                    continue;
                }
                let there = (x + shift.x as i64, y + shift.y as i64);
                let (Some(e), Some(r), Some(c)) = (
                    light(&empty, response, x, y),
                    light(&with, response, there.0, there.1),
                    light(composite, response, x, y),
                ) else {
                    continue;
                };
                // Where nothing is to be darkened, nothing is compared.
                if e < MIN_LIGHT {
                    continue;
                }
                let (real, virtual_) = (1.0 - r / (gain * e), 1.0 - c / e);
                if real.max(virtual_) > MIN_DEPTH && real.min(virtual_) > -0.5 {
                    n += 1;
                    sums[0] += real;
                    sums[1] += virtual_;
                    squares += (real - virtual_).powi(2);
                }
            }
        }
        let count = n as f64;
        (n >= 50).then(|| ShadowCheck {
            real: sums[0] / count,
            composite: sums[1] / count,
            difference: (squares / count).sqrt(),
            pixels: n,
        })
    }

    /// Returns the number of pixels of the ball that are white in its darkest picture: lamps whose
    /// brightness is not known.
    #[must_use]
    pub fn clipped(&self) -> usize {
        let Some(darkest) = self.by_exposure().pop() else {
            return 0;
        };
        let Circle { centre, radius } = darkest.circle;
        let picture = &darkest.photograph.picture;
        let range = |centre: f64, size: u32| {
            let low = (centre - radius).max(0.0) as u32;
            low..((centre + radius).max(0.0) as u32).min(size)
        };
        let is_white = |x: u32, y: u32| {
            let at = DVec2::new(f64::from(x), f64::from(y));
            let codes = picture.rgb(x, y);
            at.distance(centre) < radius && codes.iter().max() >= Some(&CLIPPED)
        };
        range(centre.y, picture.height)
            .flat_map(|y| range(centre.x, picture.width).map(move |x| (x, y)))
            .filter(|&(x, y)| is_white(x, y))
            .count()
    }

    /// Returns the pictures of the ball from the longest to the shortest exposure.
    #[must_use]
    pub fn by_exposure(&self) -> Vec<&BallPicture> {
        let mut balls: Vec<&BallPicture> = self.balls.iter().collect();
        balls.sort_by(|a, b| b.ev.total_cmp(&a.ev));
        balls
    }
}

/// Returns the mean light around a pixel; `None` at the picture's border and outside.
fn light(picture: &Picture, response: &Response, x: i64, y: i64) -> Option<f64> {
    let at = IVec2::new(i32::try_from(x).ok()?, i32::try_from(y).ok()?);
    let mean = mean_light(&nine(picture, at)?, response);
    Some(f64::from(mean.element_sum() / 3.0))
}
