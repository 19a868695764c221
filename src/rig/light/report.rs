//! Reports the light of a session: `penumbra light SESSION`.

use crate::damage::log;
use crate::error::RigError;
use crate::feed::Feed;
use crate::light::{
    bracket_response::ExposureAgreement,
    estimator::LightEstimator,
    view::{SceneView, SphereAt},
};
use crate::setup::RigSetup;
use crate::source::Source;
use glam::{DMat3, DVec3, Mat3};
use penumbra_capture::Next;
use penumbra_config::Config;
use penumbra_interface::RigidTransform;
use penumbra_lighting::{LightReport, Lighting};
use penumbra_picture::{Picture, decode_within};
use penumbra_session::{Session, SessionError};
use penumbra_white_balance::MatchStatus;
use std::sync::Arc;

/// Returns the light of the first instant at which the complete environment was seen, estimated as
/// in a replay. Calls `progress` with the share of the time that has passed, 0 to 1, after each stage that takes
/// long.
///
/// # Errors
/// The calibration is invalid, a picture cannot be read, or the session has no such instant.
pub fn light_of_session(
    session: &Session,
    config: &Config,
    progress: impl Fn(f64),
) -> Result<LightReport, RigError> {
    let source = Source::Recorded(session.clone());
    let setup = RigSetup::read(&source, config)?;
    let files = |name: &str| session.attachment(name);
    let mut light = LightEstimator::without_indirect_light(&setup, config, &files)?;
    progress(TABLES);
    let pairing = crate::settings::pairing_config(&setup.calibration).with_full_windows();
    let mut feed = Feed::new(&source, &setup.calibration, pairing, false);
    let none = || RigError::NoLight {
        path: session.path().to_owned(),
    };
    let mut picture = Picture::default();
    let mut damaged = 0;
    let mut warn = |error: &SessionError| {
        log(error, damaged);
        damaged += 1;
    };
    session.damage().iter().for_each(&mut warn);
    while let Next::Item(item) = feed.next_picture(None) {
        feed.take_damage().iter().for_each(&mut warn);
        let frame = item.frame;
        let (max_pixels, yuv) = (setup.max_scene_pixels(), config.input.encoding());
        if decode_within(max_pixels, &frame.scene, &yuv, &mut picture).is_err() {
            continue;
        }
        let pose = setup.world_from_camera(&frame);
        let view = SceneView {
            sphere: SphereAt::Calibrated,
            picture: &picture,
            world_from_camera: pose,
            camera: &setup.calibration.scene_camera.camera,
            captured_at: frame.captured_at,
            exposure: frame.scene.exposure,
        };
        let set = frame.environment.as_ref().map(|e| e.set.as_ref());
        if let Some(lighting) = light.update(set, &view)? {
            progress(ESTIMATE);
            if let Some(warning) = light.exposures().and_then(ExposureAgreement::warning) {
                tracing::warn!("{warning}");
            }
            return report(&setup, &mut light, lighting, pose)?.ok_or_else(none);
        }
    }
    Err(none())
}

/// Shares of the time that have passed when the tables are made, and when the light is estimated; the rest is
/// the report. As measured on the bundled sessions; pictures are read in no time.
const TABLES: f64 = 0.8;
const ESTIMATE: f64 = 0.93;

/// Creates the report; `None` if the rig has no view of the environment.
fn report(
    setup: &RigSetup,
    light: &mut LightEstimator,
    lighting: Arc<Lighting>,
    pose: Option<RigidTransform>,
) -> Result<Option<LightReport>, RigError> {
    let gains = gains(&light.match_status());
    let rig = &setup.calibration;
    let Some(estimator) = light.estimator() else {
        return Ok(None);
    };
    let Some(environment) = &rig.environment else {
        // The light is stated by a map.
        return Ok(Some(LightReport::of_map(estimator, lighting)));
    };
    let scene = pose.map(|pose| (pose, &rig.scene_camera.camera));
    let report = LightReport::from_estimator(estimator, lighting, &environment.view, scene, gains)?;
    Ok(Some(report))
}

/// Returns the matrix from the environment camera's linear values to the scene camera's.
fn gains(status: &MatchStatus) -> Mat3 {
    let diagonal = DMat3::from_diagonal(DVec3::from(status.gains));
    let matrix = status
        .matrix
        .map(|rows| DMat3::from_cols_array_2d(&rows).transpose());
    matrix
        .map_or(diagonal, |m| m * status.exposure_factor)
        .as_mat3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::path::Path;

    #[test]
    fn progress_rises_with_each_stage_and_leaves_the_report() {
        let desk =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/sessions/desk.mcap");
        let session = Session::open(&desk).unwrap();
        let told = RefCell::new(vec![0.0]);
        light_of_session(&session, &Config::default(), |share| {
            told.borrow_mut().push(share)
        })
        .unwrap();
        let told = told.into_inner();
        assert!(told.len() > 2, "{told:?}");
        assert!(told.windows(2).all(|pair| pair[0] < pair[1]), "{told:?}");
        assert!(told.last().is_some_and(|last| *last < 1.0), "{told:?}");
    }
}
