//! What a recording of the live rig tells viewers: lenses, frame tree, and the tracker's unit of length.

use crate::source::RecordingContents;
use glam::DVec2;
use penumbra_camera::{EnvironmentView, PinholeCamera};
use penumbra_config::{TrackerSource, TrackerUnits};
use penumbra_interface::RigidTransform;
use penumbra_rig_model::lens_files::SCENE_LENS;
use penumbra_rig_model::{EnvironmentCamera, RigCalibration, TrackerCalibration};
use penumbra_session::{Attachment, Camera, Distortion, ViewedLens, ViewedRig, sensor_frame};
use std::sync::{Arc, Mutex, PoisonError};

/// The newest lens of the scene camera that was found while the rig runs.
#[derive(Debug, Default)]
pub struct RefinedLens(Mutex<Option<Arc<FoundLens>>>);

/// A lens of the scene camera that was found while the rig runs.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundLens {
    /// The lens.
    pub camera: PinholeCamera,
    /// Its calibration file.
    pub file: String,
}

impl RefinedLens {
    /// States a new lens.
    pub fn set(&self, lens: FoundLens) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(lens));
    }

    /// Returns the newest lens; `None` while the calibrated one is in use.
    pub(crate) fn newest(&self) -> Option<Arc<FoundLens>> {
        let newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        newest.clone()
    }
}

impl RecordingContents {
    /// Returns the files of a recording that starts while `lens` is in use.
    pub(crate) fn files_with(&self, lens: Option<&FoundLens>) -> Vec<Attachment> {
        let mut files = self.files.all().to_vec();
        if let Some(lens) = lens {
            files.retain(|file| file.name != SCENE_LENS);
            files.push(Attachment {
                name: SCENE_LENS.to_owned(),
                media_type: "application/json".to_owned(),
                data: lens.file.clone().into_bytes().into(),
            });
        }
        files
    }

    /// Returns what viewers are told by a recording that starts while `lens` is in use.
    pub(crate) fn viewed_with(&self, lens: Option<&FoundLens>) -> ViewedRig {
        let mut rig = (*self.viewed).clone();
        if let Some(lens) = lens {
            rig.lenses.retain(|lens| lens.camera != Camera::Scene);
            rig.lenses.push(pinhole(Camera::Scene, &lens.camera));
        }
        rig
    }
}

/// Returns what viewers are told of a rig; `lens_known`: the scene camera's lens is not merely assumed.
pub(crate) fn viewed_rig(
    rig: &RigCalibration,
    lens_known: bool,
    tracker: Option<&TrackerSource>,
) -> ViewedRig {
    let station = match tracker {
        Some(TrackerSource::System(config)) => config.station,
        _ => 1,
    };
    let scene = lens_known.then(|| pinhole(Camera::Scene, &rig.scene_camera.camera));
    let environment = rig.environment.as_ref().and_then(environment);
    let (lens, pose) = environment.unzip();
    let pose = pose.map(|pose| (("world".to_owned(), "environment_camera".to_owned()), pose));
    let mounted = rig.tracker.as_ref().map(|t| mounted(t, station));
    ViewedRig {
        lenses: scene.into_iter().chain(lens).collect(),
        fixed: mounted.into_iter().flatten().chain(pose).collect(),
        metres_per_unit: metres_per_unit(rig.tracker.as_ref(), tracker),
    }
}

/// Returns the lens of a camera without a fisheye.
pub(crate) fn pinhole(camera: Camera, lens: &PinholeCamera) -> ViewedLens {
    ViewedLens {
        camera,
        size: (lens.width, lens.height),
        intrinsics: intrinsics(lens.focal, lens.centre),
        distortion: Distortion::Brown(lens.distortion),
    }
}

const fn intrinsics(focal: DVec2, centre: DVec2) -> [f64; 4] {
    [focal.x, focal.y, centre.x, centre.y]
}

/// Returns the lens and the pose of an environment camera of its own.
fn environment(environment: &EnvironmentCamera) -> Option<(ViewedLens, RigidTransform)> {
    match &environment.view {
        EnvironmentView::Fisheye {
            lens,
            world_from_camera,
        } => {
            let lens = ViewedLens {
                camera: Camera::Environment,
                size: (lens.width, lens.height),
                intrinsics: intrinsics(DVec2::splat(lens.focal), lens.centre),
                distortion: Distortion::KannalaBrandt(lens.distortion),
            };
            Some((lens, *world_from_camera))
        }
        EnvironmentView::Sphere {
            camera,
            world_from_camera,
            ..
        } => Some((pinhole(Camera::Environment, camera), *world_from_camera)),
        EnvironmentView::SphereInScene { .. } => None,
    }
}

fn mounted(tracker: &TrackerCalibration, station: u8) -> [((String, String), RigidTransform); 2] {
    let frames = |parent: String, child: &str| (parent, child.to_owned());
    [
        (
            frames("world".to_owned(), "tracker"),
            tracker.world_from_transmitter,
        ),
        (
            frames(sensor_frame(station), "scene_camera"),
            tracker.sensor_from_scene_camera,
        ),
    ]
}

/// Returns the unit of length of the tracker's bytes: the calibration's, else the one that a device is
/// set to.
fn metres_per_unit(
    calibration: Option<&TrackerCalibration>,
    source: Option<&TrackerSource>,
) -> Option<f64> {
    let configured = || match source? {
        TrackerSource::System(config) => {
            Some(config.units.unwrap_or(TrackerUnits::Centimetres).metres())
        }
        _ => None,
    };
    calibration.map(|t| t.metres_per_unit).or_else(configured)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::RigFiles;
    use penumbra_config::Config;
    use std::path::Path;

    #[test]
    fn bundled_rig_is_told_as_its_rig_json_states_it() {
        let desk =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/sessions/desk.mcap");
        let files = RigFiles::at(&desk).unwrap();
        let document = files.document(&Config::default()).unwrap();
        let json = serde_json::from_slice(files.get("rig.json").unwrap()).unwrap();
        let stated = ViewedRig::from_rig_json(&json);
        assert!(stated.lenses.len() == 2 && stated.fixed.len() == 3);
        let told = viewed_rig(&document.calibration, true, None);
        // The bundled session has no calibration files, which would take precedence.
        assert_eq!(told.lenses, stated.lenses);
        assert_eq!(told.metres_per_unit, stated.metres_per_unit);
        let frames = |rig: &ViewedRig| {
            rig.fixed
                .iter()
                .map(|(frames, _)| frames.clone())
                .collect::<Vec<_>>()
        };
        assert_eq!(frames(&told), frames(&stated));
        for ((_, told), (_, stated)) in told.fixed.iter().zip(&stated.fixed) {
            assert!(told.translation.abs_diff_eq(stated.translation, 1e-9));
        }
    }

    #[test]
    fn an_assumed_lens_is_not_told_and_a_device_is_read_in_its_unit() {
        let document = RigFiles::default().document(&Config::default()).unwrap();
        let config = penumbra_config::TrackerConfig {
            station: 3,
            ..penumbra_config::TrackerConfig::default()
        };
        let source = TrackerSource::System(Box::new(config));
        let told = viewed_rig(&document.calibration, false, Some(&source));
        let unit = Some(0.01);
        assert_eq!(
            told,
            ViewedRig {
                metres_per_unit: unit,
                ..ViewedRig::default()
            }
        );
        let tracker = TrackerCalibration {
            world_from_transmitter: RigidTransform::IDENTITY,
            sensor_from_scene_camera: RigidTransform::IDENTITY,
            latency_nanos: 0,
            metres_per_unit: 0.0254,
            field: None,
        };
        let rig = RigCalibration {
            tracker: Some(tracker),
            ..document.calibration
        };
        let told = viewed_rig(&rig, false, Some(&source));
        assert_eq!(told.metres_per_unit, Some(0.0254));
        assert_eq!(told.fixed[1].0.0, "sensor_3");
    }
}
