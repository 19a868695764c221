//! Colour differences between the scene camera and the environment camera on surfaces that both
//! see.

use super::Known;
use crate::step::PictureInput;
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_numerics::median;
use penumbra_picture::Picture;
use penumbra_white_balance::chart::Photograph;
use penumbra_white_balance::colour::delta_e_linear;
use penumbra_white_balance::gather::{GatherOptions, Overlap, PhotometricPair, gather_pairs};
use penumbra_white_balance::overlap::estimate_overlap;
use penumbra_white_balance::{Provenance, WhiteBalanceMatch};

/// Maximum age of the environment camera's picture at the scene camera's, seconds.
const TOGETHER: f64 = 0.2;
/// Interval between two comparisons, seconds.
const SPACING: f64 = 0.5;
/// Minimum number of surfaces in a comparison.
const LEAST_PAIRS: usize = 12;

/// Result of the colour comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colours {
    /// Median colour difference over all surfaces, CIEDE2000.
    pub delta_e: f64,
    /// 90th percentile of the colour difference, CIEDE2000.
    pub ninth: f64,
    /// Number of surfaces and of moments.
    pub counts: (usize, usize),
    /// Origin of the gains between the cameras.
    pub by: Provenance,
}

/// Compares pictures of both cameras as they arrive.
#[derive(Debug)]
pub struct Comparison {
    photometry: WhiteBalanceMatch,
    last: Option<(Picture, MonotonicTime, Option<f64>)>,
    due: f64,
    moments: usize,
    differences: Vec<f64>,
    by: Provenance,
}

impl Comparison {
    /// Creates a comparison that starts from a known white balance match.
    #[must_use]
    pub const fn new(photometry: WhiteBalanceMatch) -> Self {
        Self {
            photometry,
            last: None,
            due: f64::MIN,
            moments: 0,
            differences: Vec::new(),
            by: Provenance::Unknown,
        }
    }

    /// Keeps the environment camera's latest picture.
    pub fn environment(&mut self, shown: &PictureInput) {
        if shown.seconds >= self.due {
            self.last = Some((shown.picture.clone(), shown.captured_at, shown.exposure));
        }
    }

    /// Compares a scene camera's picture, taken from `pose`, with the latest environment picture.
    pub fn scene(&mut self, known: &Known, shown: &PictureInput, pose: RigidTransform) {
        let Some((_, at, _)) = &self.last else {
            return;
        };
        let environment = known.rig.calibration.environment.as_ref();
        let (Some(caster), Some(environment)) = (&known.caster, environment) else {
            return;
        };
        let apart = shown.captured_at.seconds_since(*at).abs();
        if shown.seconds < self.due || apart > TOGETHER {
            return;
        }
        let Some((picture, at, exposure)) = self.last.take() else {
            return;
        };
        self.due = shown.seconds + SPACING;
        let scene_camera = &known.rig.calibration.scene_camera;
        let overlap = Overlap {
            scene: Photograph {
                picture: shown.picture,
                response: &scene_camera.response,
            },
            scene_camera: &scene_camera.camera,
            world_from_scene_camera: pose,
            environment: Photograph {
                picture: &picture,
                response: &environment.response,
            },
            environment_view: &environment.view,
            vignetting: [scene_camera.vignetting, environment.vignetting],
        };
        let pairs = gather_pairs(&overlap, caster, &GatherOptions::default());
        self.photometry
            .set_exposures(reported(shown.exposure), reported(exposure));
        self.compare(&pairs);
        let answer = estimate_overlap(&pairs);
        self.photometry
            .update_overlap(answer, shown.captured_at, at);
    }

    /// Compares with the gains that were active before these pairs were observed.
    fn compare(&mut self, pairs: &[PhotometricPair]) {
        let by = self.photometry.in_force().0;
        if matches!(by, Provenance::Unknown | Provenance::GreyWorld) || pairs.len() < LEAST_PAIRS {
            return;
        }
        let scene_from_environment = self.photometry.scene_from_environment();
        let clear = pairs.iter().filter(|p| p.variance.is_finite());
        let off = clear.map(|p| delta_e_linear(p.scene, scene_from_environment * p.environment));
        self.differences.extend(off);
        self.moments += 1;
        self.by = by;
    }

    /// Summarises all comparisons; `None` if there are none.
    #[must_use]
    pub fn colours(&self) -> Option<Colours> {
        let mut sorted = self.differences.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        Some(Colours {
            delta_e: median(sorted.iter().copied())?,
            ninth: sorted[sorted.len() * 9 / 10],
            counts: (sorted.len(), self.moments),
            by: self.by,
        })
    }
}

/// Returns the exposure; shutter time and gain are only known as a product.
fn reported(seconds: Option<f64>) -> Option<Exposure> {
    seconds.map(|seconds| Exposure {
        exposure_micros: 1e6 * seconds,
        gain: 1.0,
    })
}
