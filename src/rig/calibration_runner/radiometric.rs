//! What the radiometric step may build on.

use super::steps::{Known, ParameterError, Parameters, StepKind};
use penumbra_calibration::radiometric::step::{Options, Radiometric};
use penumbra_calibration::step::Step;
use penumbra_camera::EnvironmentView;
use penumbra_config::Config;
use penumbra_rig_model::RigCalibration;

/// As the dashboard shows it.
pub(super) const KIND: StepKind = StepKind {
    name: "radiometric",
    title: "Colour and brightness",
    about: "Lock exposure and white balance of both cameras. Hold a ColorChecker where both see it, \
            nothing moving, for ten seconds.",
    parameters: &[],
    make,
};

fn make(_: &Parameters, known: &Known) -> Result<Box<dyn Step>, ParameterError> {
    let options = radiometric_options(Some(&known.document.calibration), &known.config);
    Ok(Box::new(Radiometric::new(options)))
}

/// What is known of the cameras: the rig's word, the configuration's over it.
#[must_use]
pub fn radiometric_options(rig: Option<&RigCalibration>, config: &Config) -> Options {
    let mut options = rig.map_or_else(Options::default, of_rig);
    let curves = [&config.scene_camera.response, &config.environment.response];
    for (response, curve) in options.responses.iter_mut().zip(curves) {
        if let Some(curve) = curve {
            *response = curve.response();
        }
    }
    options
}

fn of_rig(rig: &RigCalibration) -> Options {
    let mut options = Options::default();
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
