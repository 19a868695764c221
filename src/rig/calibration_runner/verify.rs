//! Definition of the verification step: the check of a complete rig.

use super::definition::{ParameterError, Parameters, RigContext, StepDefinition, station};
use crate::error::RigError;
use crate::light::chart::ChartPictures;
use crate::markers;
use penumbra_calibration::step::Step;
use penumbra_calibration::verify::{CheckedRig, Verify};
use penumbra_camera::EnvironmentView;
use penumbra_config::Config;
use penumbra_rig_model::Attachments;
use penumbra_rig_model::RigDocument;
use penumbra_scene::RayCaster;
use penumbra_white_balance::{WhiteBalanceMatch, WhiteBalanceSettings};

/// The definition of the step.
pub(super) const STEP: StepDefinition = StepDefinition {
    name: "verify",
    title: "Check of the rig",
    about: "Turn the rig briskly to and fro for a minute with its markers in view, and let both \
            cameras see the same bright, matt surfaces.",
    parameters: &[],
    make,
};

fn make(_: &Parameters, rig: &RigContext) -> Result<Box<dyn Step>, ParameterError> {
    let files = |name: &str| rig.files.get(name);
    let step = verify_step(rig.document.clone(), &files, &rig.config);
    step.map(|step| Box::new(step) as Box<dyn Step>)
        .map_err(|error| ParameterError::RigNotReady {
            reason: error.to_string(),
        })
}

/// Creates the verification step of the rig that `document` and `files` describe.
///
/// # Errors
/// The rig has no markers or markers of an unknown family; a phantom or a picture of a chart
/// cannot be read.
pub fn verify_step(
    document: RigDocument,
    files: &Attachments,
    config: &Config,
) -> Result<Verify, RigError> {
    let rig = &document.calibration;
    if document.markers.is_empty() {
        return Err(RigError::NoMarkersToVerify);
    }
    let map = markers::tag_map(&document.markers)?;
    let scene = document.phantom_scene(files)?;
    let same_camera = rig
        .environment
        .as_ref()
        .is_some_and(|e| matches!(e.view, EnvironmentView::SphereInScene { .. }));
    let mut white_balance = WhiteBalanceMatch::new(WhiteBalanceSettings::default(), same_camera);
    if !same_camera
        && let Some(chart) = ChartPictures::read(rig, files, false)?
        && let Some(chart) = chart.matched(rig)
    {
        white_balance.set_chart(chart);
    }
    if let Some(gains) = rig.gains.filter(|_| !same_camera) {
        white_balance.set_calibrated(gains);
    }
    let known = CheckedRig {
        caster: Some(RayCaster::from_phantoms(&scene)),
        map,
        station: station(config),
        rig: document,
    };
    Ok(Verify::new(known, white_balance))
}
