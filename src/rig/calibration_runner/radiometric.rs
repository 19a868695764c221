//! Definition of the radiometric step: tone curves, vignetting, noise and gains of both cameras.

use super::definition::{ParameterError, Parameters, RigContext, StepDefinition};
use penumbra_calibration::radiometric::step::{Radiometric, RadiometricOptions};
use penumbra_calibration::step::Step;
use penumbra_camera::EnvironmentView;
use penumbra_config::Config;
use penumbra_rig_model::RigCalibration;

/// The definition of the step.
pub(super) const STEP: StepDefinition = StepDefinition {
    name: "radiometric",
    title: "Colour and brightness",
    about: "Lock exposure and white balance of both cameras. Hold a ColorChecker still for ten \
            seconds where both see it; nothing else may move.",
    parameters: &[],
    make,
};

fn make(_: &Parameters, rig: &RigContext) -> Result<Box<dyn Step>, ParameterError> {
    let options = radiometric_options(Some(&rig.document.calibration), &rig.config);
    Ok(Box::new(Radiometric::new(options)))
}

/// Returns the known properties of both cameras (response, picture size in pixels, principal
/// point in pixels): the rig's, with the responses of the configuration in preference.
#[must_use]
pub fn radiometric_options(rig: Option<&RigCalibration>, config: &Config) -> RadiometricOptions {
    let mut options = rig.map_or_else(RadiometricOptions::default, rig_options);
    let curves = [&config.scene_camera.response, &config.environment.response];
    for (response, curve) in options.responses.iter_mut().zip(curves) {
        if let Some(curve) = curve {
            *response = curve.response();
        }
    }
    options
}

fn rig_options(rig: &RigCalibration) -> RadiometricOptions {
    let mut options = RadiometricOptions::default();
    let scene = &rig.scene_camera;
    options.responses[0] = scene.response.clone();
    options.sizes[0] = Some((scene.camera.width, scene.camera.height));
    options.centres[0] = Some(scene.camera.centre);
    if let Some(environment) = &rig.environment {
        options.responses[1] = environment.response.clone();
        let (size, centre) = match &environment.view {
            EnvironmentView::Fisheye { lens, .. } => ((lens.width, lens.height), lens.centre),
            EnvironmentView::Sphere { camera, .. } => {
                ((camera.width, camera.height), camera.centre)
            }
            EnvironmentView::SphereInScene { .. } => return options,
        };
        (options.sizes[1], options.centres[1]) = (Some(size), Some(centre));
    }
    options
}
