//! What an adjustment gives: to be drawn over the photograph.

use crate::{Adjustment, PhotoPage};
use penumbra_photo::{GroundFrom, Line, PhotoError};
use serde::Serialize;

/// Ball and ground as the page shows them; pixels of the photograph.
#[derive(Debug, Serialize)]
pub struct View {
    ball: BallView,
    ground: Option<GroundView>,
    /// Why there is no ground.
    trouble: Option<String>,
}

#[derive(Debug, Serialize)]
struct BallView {
    outline: Line,
    /// Share of the outline that is visible, 0 to 1.
    seen: f64,
    /// Whether the outline was fitted to what is visible; otherwise it is the circle's.
    is_fitted: bool,
    distance_m: f64,
}

#[derive(Debug, Serialize)]
struct GroundView {
    grid: Vec<Line>,
    /// Corners of a square on it, to start from.
    square: Option<[[f64; 2]; 4]>,
    tilt_deg: f64,
    roll_deg: f64,
    /// Error of its direction if a rectangle tells it.
    sigma_deg: Option<f64>,
}

impl PhotoPage {
    /// Returns what an adjustment gives.
    ///
    /// # Errors
    /// The circle is not in the picture. A ground that is refused is no error.
    pub fn view(&self, adjustment: &Adjustment) -> Result<View, PhotoError> {
        let options = self.options(adjustment);
        let photographs = self.photographs();
        let (_, ball) = photographs.ball(options.circle)?;
        let radius = options.ball_radius;
        let (ground, trouble) = match photographs.placement(&ball, &options) {
            Ok(placement) => {
                let sigma_deg = match placement.ground {
                    GroundFrom::Rectangle { sigma_degrees } => Some(sigma_degrees),
                    _ => None,
                };
                let ground = GroundView {
                    grid: photographs.grid(&placement, radius),
                    square: photographs.square(&placement, radius),
                    tilt_deg: placement.tilt_degrees,
                    roll_deg: placement.roll_degrees,
                    sigma_deg,
                };
                (Some(ground), None)
            }
            Err(error) => (None, Some(error.to_string())),
        };
        Ok(View {
            ball: BallView {
                outline: photographs.outline(&ball),
                seen: ball.support,
                is_fitted: ball.is_fitted,
                distance_m: ball.centre(radius).length(),
            },
            ground,
            trouble,
        })
    }

    /// Returns why an adjustment cannot be composed, in one line.
    pub(crate) fn trouble(&self, adjustment: &Adjustment) -> Option<String> {
        if adjustment.is_by_tag() && !self.start.has_tag {
            return Some("ground: no tag is stated (--tag)".to_owned());
        }
        match self.view(adjustment) {
            Ok(view) => view.trouble,
            Err(error) => Some(error.to_string()),
        }
    }
}
