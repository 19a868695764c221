//! Colour differences between the scene camera and the environment camera on surfaces that both
//! see.

use super::CheckedRig;
use crate::step::PictureInput;
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_numerics::median;
use penumbra_picture::Picture;
use penumbra_white_balance::chart::Photograph;
use penumbra_white_balance::colour::delta_e_linear;
use penumbra_white_balance::gather::{GatherOptions, Overlap, PhotometricPair, gather_pairs};
use penumbra_white_balance::overlap::estimate_overlap;
use penumbra_white_balance::{Provenance, WhiteBalanceMatch};

/// Maximum time between the two cameras' pictures of a comparison, seconds.
const MAX_GAP: f64 = 0.2;
/// Minimum interval between two comparisons, seconds.
const SPACING: f64 = 0.5;
/// Minimum number of surfaces in a comparison.
const MIN_PAIRS: usize = 12;

/// Result of the colour comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colours {
    /// Median colour difference over all surfaces, CIEDE2000.
    pub delta_e: f64,
    /// 90th percentile of the colour difference, CIEDE2000.
    pub percentile_90: f64,
    /// Number of surfaces and of comparisons.
    pub counts: (usize, usize),
    /// Origin of the gains between the cameras.
    pub provenance: Provenance,
}

/// Compares pictures of both cameras as they arrive.
#[derive(Debug)]
pub struct Comparison {
    white_balance: WhiteBalanceMatch,
    last: Option<(Picture, MonotonicTime, Option<f64>)>,
    /// Time of the next comparison, seconds.
    due: f64,
    comparisons: usize,
    differences: Vec<f64>,
    provenance: Provenance,
}

impl Comparison {
    /// Creates a comparison that starts from a known white balance match.
    #[must_use]
    pub const fn new(white_balance: WhiteBalanceMatch) -> Self {
        Self {
            white_balance,
            last: None,
            due: f64::MIN,
            comparisons: 0,
            differences: Vec::new(),
            provenance: Provenance::Unknown,
        }
    }

    /// Keeps the environment camera's latest picture.
    pub fn observe_environment(&mut self, input: &PictureInput) {
        if input.seconds >= self.due {
            self.last = Some((input.picture.clone(), input.captured_at, input.exposure));
        }
    }

    /// Compares a scene camera's picture, taken from `pose`, with the latest environment picture.
    pub fn observe_scene(
        &mut self,
        known: &CheckedRig,
        input: &PictureInput,
        pose: RigidTransform,
    ) {
        let Some((_, at, _)) = &self.last else {
            return;
        };
        let environment = known.rig.calibration.environment.as_ref();
        let (Some(caster), Some(environment)) = (&known.caster, environment) else {
            return;
        };
        let apart = input.captured_at.seconds_since(*at).abs();
        if input.seconds < self.due || apart > MAX_GAP {
            return;
        }
        let Some((picture, at, exposure)) = self.last.take() else {
            return;
        };
        self.due = input.seconds + SPACING;
        let scene_camera = &known.rig.calibration.scene_camera;
        let overlap = Overlap {
            scene: Photograph {
                picture: input.picture,
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
        self.white_balance.set_exposures(
            unit_gain_exposure(input.exposure),
            unit_gain_exposure(exposure),
        );
        self.compare(&pairs);
        let estimate = estimate_overlap(&pairs);
        self.white_balance
            .update_overlap(estimate, input.captured_at, at);
    }

    /// Compares with the gains that were active before these pairs were observed.
    fn compare(&mut self, pairs: &[PhotometricPair]) {
        let provenance = self.white_balance.in_force().0;
        if matches!(provenance, Provenance::Unknown | Provenance::GreyWorld)
            || pairs.len() < MIN_PAIRS
        {
            return;
        }
        let scene_from_environment = self.white_balance.scene_from_environment();
        let clear = pairs.iter().filter(|p| p.variance.is_finite());
        let differences =
            clear.map(|p| delta_e_linear(p.scene, scene_from_environment * p.environment));
        self.differences.extend(differences);
        self.comparisons += 1;
        self.provenance = provenance;
    }

    /// Summarises all comparisons; `None` if there are none.
    #[must_use]
    pub fn colours(&self) -> Option<Colours> {
        let mut sorted = self.differences.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        Some(Colours {
            delta_e: median(sorted.iter().copied())?,
            percentile_90: sorted[sorted.len() * 9 / 10],
            counts: (sorted.len(), self.comparisons),
            provenance: self.provenance,
        })
    }
}

/// Returns the exposure with gain 1, because only the product of exposure time and gain is known.
fn unit_gain_exposure(seconds: Option<f64>) -> Option<Exposure> {
    seconds.map(|seconds| Exposure {
        exposure_micros: 1e6 * seconds,
        gain: 1.0,
    })
}
