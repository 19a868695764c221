//! Results of the step for one camera, and the choice of its tone curve.

use crate::radiometric::curve::{Curve, NoCurve};
use crate::radiometric::noise::Noise;
use crate::radiometric::vignetting::VignettingFit;
use crate::step::CameraRole;
use penumbra_camera::{NoiseTexture, Response};

/// Maximum relative standard error of a measured curve that replaces the known one.
const MAX_CURVE_SIGMA: f64 = 0.12;
/// Maximum difference of a curve from the measured one to be consistent with it, standard errors.
const MAX_DIFFERENCE_SIGMAS: f64 = 3.0;
/// Maximum RMS difference of a curve from the measured one to be consistent with it, relative.
const MAX_DIFFERENCE: f64 = 0.03;

/// The cameras in the order of all arrays of two.
pub(super) const CAMERAS: [CameraRole; 2] = [CameraRole::Scene, CameraRole::Environment];

/// Results for one camera.
#[derive(Clone, Debug, Default)]
pub(super) struct CameraResult {
    pub curve: Option<Result<Curve, NoCurve>>,
    /// The active curve and its description.
    pub response: Option<(Response, String)>,
    /// Whether the active curve replaces the one in `rig.json`.
    pub replaces: bool,
    pub noise: Option<Noise>,
    /// Correlation of the noise.
    pub noise_texture: Option<NoiseTexture>,
    /// Vignetting, and whether it is from pictures of a uniform surface: only then it is used.
    pub vignetting: Option<(VignettingFit, bool)>,
    pub size: (u32, u32),
}

impl CameraResult {
    /// Returns whether there is a result: a tone curve that is used or confirmed, noise, or
    /// vignetting of a uniform surface.
    pub fn has_result(&self) -> bool {
        let known = self.response.as_ref().map_or("", |r| &r.1);
        let has_curve = matches!(self.curve, Some(Ok(_))) && (self.replaces || known == CONFIRMED);
        has_curve || self.noise.is_some() || self.vignetting.as_ref().is_some_and(|v| v.1)
    }
}

/// Description of the known tone curve if an exposure series is consistent with it.
pub(super) const CONFIRMED: &str = "of rig.json, confirmed";

/// Chooses the active tone curve: the known one if it is consistent with the series, else a named one
/// that is, else the measured one. Returns it with its description, and whether it replaces the known
/// one.
pub(super) fn choose_response(
    curve: Option<&Result<Curve, NoCurve>>,
    known: &Response,
) -> ((Response, String), bool) {
    let Some(Ok(curve)) = curve else {
        return ((known.clone(), "of rig.json".to_owned()), false);
    };
    let is_consistent = |other: &Response| {
        let (difference, sigmas) = curve.difference(other);
        sigmas < MAX_DIFFERENCE_SIGMAS && difference < MAX_DIFFERENCE
    };
    if is_consistent(known) {
        return ((known.clone(), CONFIRMED.to_owned()), false);
    }
    if curve.largest_sigma() > MAX_CURVE_SIGMA {
        return ((known.clone(), "of rig.json".to_owned()), false);
    }
    let named = [
        (Response::srgb(), "sRGB"),
        (Response::linear(), "linear"),
        (Response::gamma(2.2), "gamma 2.2"),
    ];
    for (named, name) in named {
        if is_consistent(&named) {
            return ((named, name.to_owned()), true);
        }
    }
    ((curve.response.clone(), "measured".to_owned()), true)
}

/// Returns whether vignetting is significant: half a per cent at the edge, and three standard errors.
pub(super) fn is_significant(fit: &VignettingFit) -> bool {
    let edge = (fit.edge_brightness() - 1.0).abs();
    edge > 0.005 && edge > 3.0 * fit.edge_sigma
}
