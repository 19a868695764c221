//! How far the colours that the environment camera's light predicts are from the scene
//! camera's, on what both see.

use super::Known;
use crate::step::ShownPicture;
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_numerics::median;
use penumbra_picture::Picture;
use penumbra_white_balance::chart::Photograph;
use penumbra_white_balance::colour::delta_e_linear;
use penumbra_white_balance::gather::{GatherOptions, Overlap, PhotometricPair, gather_pairs};
use penumbra_white_balance::overlap::estimate_overlap;
use penumbra_white_balance::{Provenance, WhiteBalanceMatch};

/// The environment's picture may be so much older than the scene's, seconds.
const TOGETHER: f64 = 0.2;
/// Between two comparisons, seconds.
const SPACING: f64 = 0.5;
/// Fewest surfaces of a comparison.
const LEAST_PAIRS: usize = 12;

/// What was compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colours {
    /// Median CIEDE2000 over surfaces.
    pub delta_e: f64,
    /// Nine of ten are nearer.
    pub ninth: f64,
    /// Surfaces, and moments.
    pub counts: (usize, usize),
    /// Where the gains between the cameras come from.
    pub by: Provenance,
}

/// Compares pictures of both cameras as they come.
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
    /// With what is known of the match so far.
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

    /// The environment camera's picture.
    pub fn environment(&mut self, shown: &ShownPicture) {
        if shown.seconds >= self.due {
            self.last = Some((shown.picture.clone(), shown.captured_at, shown.exposure));
        }
    }

    /// The scene camera's, and where it was taken from.
    pub fn scene(&mut self, known: &Known, shown: &ShownPicture, pose: RigidTransform) {
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

    /// By the gains that were in force before these pairs were seen.
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

    /// What all comparisons say; `None` without any.
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

/// Shutter and gain are known as a product only.
fn reported(seconds: Option<f64>) -> Option<Exposure> {
    seconds.map(|seconds| Exposure {
        exposure_micros: 1e6 * seconds,
        gain: 1.0,
    })
}
