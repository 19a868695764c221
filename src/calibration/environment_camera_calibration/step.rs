//! The calibration step `environment`: gathers pictures and poses, and reports the progress.

use super::super::step::{
    CalibrationProvenance, CameraRole, Finished, PictureInput, Progress, Step, StepInput,
    StepInputs,
};
use super::bright_pixels::BrightPixels;
use super::gathered::SceneView;
use super::inputs::{EnvironmentOptions, Inputs, KnownRig, NotReady};
use super::solve;
use glam::DVec2;
use penumbra_fiducials::{Detector, Registrar, RegistrationMethod};
use penumbra_rig_model::environment_file::STEP;

/// Number of pictures of the environment camera that suffices.
const ENOUGH_PICTURES: f64 = 10.0;
/// Number of pictures of the scene camera that suffices.
const ENOUGH_VIEWS: usize = 10;

/// The step.
pub struct EnvironmentStep {
    inputs: Inputs,
    registrar: Registrar,
    detector: Detector,
    overlay_points: Vec<DVec2>,
}

impl EnvironmentStep {
    /// Creates the step for a rig.
    ///
    /// # Errors
    /// For a mirrored sphere, the camera's lens or the sphere's radius is unknown; a marker has an
    /// unknown family or a duplicate number.
    pub fn new(known: KnownRig, asked: EnvironmentOptions) -> Result<Self, NotReady> {
        let inputs = Inputs::new(known, asked)?;
        let response = &inputs.known.rig.calibration.scene_camera.response;
        Ok(Self {
            detector: Detector::new(&inputs.families, response),
            registrar: Registrar::new(inputs.map.clone()),
            inputs,
            overlay_points: Vec::new(),
        })
    }

    fn add_scene_picture(&mut self, shown: &PictureInput) {
        let camera = &self.inputs.known.rig.calibration.scene_camera;
        let fits = (shown.picture.width, shown.picture.height)
            == (camera.camera.width, camera.camera.height);
        if !fits {
            return;
        }
        let at = shown
            .captured_at
            .offset_nanos(camera.latency_nanos.saturating_neg());
        let tags = if self.inputs.families.is_empty() {
            Vec::new()
        } else {
            self.detector
                .detect(shown.picture, Some(&camera.camera))
                .to_vec()
        };
        self.overlay_points = tags.iter().flat_map(|t| t.corners).collect();
        let found = self.registrar.register(&camera.camera, &tags, at);
        let unambiguous = found.filter(|f| f.method != RegistrationMethod::TagGuessed);
        self.inputs.gathered.add_scene_view(SceneView {
            at,
            seconds: shown.seconds,
            bright: BrightPixels::new(shown.picture, &camera.response),
            tags,
            by_markers: unambiguous.map(|f| f.map_from_camera),
        });
    }
}

impl Step for EnvironmentStep {
    fn name(&self) -> &'static str {
        STEP
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: true,
            environment: true,
            brackets: false,
            poses: true,
            spacing: 0.06,
        }
    }

    fn observe(&mut self, shown: &StepInput) {
        match shown {
            StepInput::Picture(shown) if shown.camera == CameraRole::Environment => {
                let response = self.inputs.response();
                self.inputs
                    .gathered
                    .add_environment_picture(shown.picture, &response);
            }
            StepInput::Picture(shown) => self.add_scene_picture(shown),
            StepInput::Pose(sample) => {
                let tracker = self.inputs.known.rig.calibration.tracker.as_ref();
                if let Some(tracker) = tracker.filter(|_| sample.station == 1) {
                    let at = tracker.measured_at(sample.arrived_at);
                    let poses = &mut self.inputs.gathered.poses;
                    poses.push(at, sample.transmitter_from_sensor);
                }
            }
        }
    }

    fn progress(&self) -> Progress {
        let gathered = &self.inputs.gathered;
        let environment = f64::from(gathered.mean.count);
        let with_markers = gathered.views.iter().filter(|v| v.by_markers.is_some());
        let hint = match gathered.views.len() {
            _ if environment == 0.0 => "turn on the environment camera",
            0 => "turn on the scene camera",
            n if n < ENOUGH_VIEWS => "continue; point the scene camera at the lights",
            _ => "",
        };
        Progress {
            share: (environment / ENOUGH_PICTURES).min(1.0),
            message: format!(
                "{environment} pictures of the environment camera, {} of the scene camera, {} with markers",
                gathered.views.len(),
                with_markers.count()
            ),
            hint: hint.to_owned(),
            overlay_points: self.overlay_points.clone(),
            camera: Some(CameraRole::Scene),
        }
    }

    fn finish(&mut self, made: &CalibrationProvenance) -> Finished {
        solve::finish(&self.inputs, made)
    }
}
