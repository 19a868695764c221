//! The interface of a calibration step, the same for recordings, live rigs and the dashboard.
//!
//! A step receives pictures and poses in the order of their arrival. At any time it reports its
//! progress and what to do next; at the end its result and the result's grade.

use glam::DVec2;
use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_picture::Picture;
use penumbra_rig_model::DeviceRecord;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::VERSION;

/// Role of a camera in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraRole {
    /// The camera whose picture is augmented.
    Scene,
    /// The camera that records the light of the surroundings.
    Environment,
}

impl CameraRole {
    /// Returns the name in files and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Environment => "environment",
        }
    }
}

/// The inputs that a step needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepInputs {
    /// Pictures of the scene camera.
    pub scene: bool,
    /// Pictures of the environment camera.
    pub environment: bool,
    /// Bracketed exposures of the environment camera.
    pub brackets: bool,
    /// Readings of the tracker.
    pub poses: bool,
    /// Minimum interval between two pictures of one camera and bracket, seconds; pictures that
    /// follow sooner may be skipped.
    pub spacing: f64,
}

/// A decoded picture.
#[derive(Clone, Copy, Debug)]
pub struct PictureInput<'a> {
    /// The camera that took it.
    pub camera: CameraRole,
    /// The picture, encoded as the camera sent it.
    pub picture: &'a Picture,
    /// The driver's time stamp; the calibrated latency is not subtracted.
    pub captured_at: MonotonicTime,
    /// Stops relative to the base exposure.
    pub bracket_ev: f64,
    /// Exposure time × gain as the camera reports it, seconds.
    pub exposure: Option<f64>,
    /// Seconds since the first picture of the recording.
    pub seconds: f64,
}

/// One item given to a step.
#[derive(Clone, Copy, Debug)]
pub enum StepInput<'a> {
    /// A picture.
    Picture(PictureInput<'a>),
    /// A reading of the tracker; its time of arrival is not corrected for latency.
    Pose(&'a PoseSample),
}

/// Progress of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Share of the needed data that has been gathered, 0 to 1.
    pub share: f64,
    /// The data gathered so far: "14 views, 731 corners".
    pub message: String,
    /// What to do next: "tilt the board to the left"; empty when there is enough data.
    pub hint: String,
    /// Overlay points: what was found in the last picture, pixels.
    pub overlay_points: Vec<DVec2>,
    /// The camera to whose picture the overlay points belong.
    pub camera: Option<CameraRole>,
}

/// The result of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Finished {
    /// Grade of the result.
    pub grade: Grade,
    /// Figures with their uncertainty, one line each.
    pub lines: Vec<String>,
    /// Problems and their remedies, worst first.
    pub findings: Vec<(Grade, String)>,
    /// Suggestions that would improve the result.
    pub hints: Vec<String>,
    /// The report: a complete HTML page without external resources.
    pub report: String,
    /// The calibration file, JSON; `None` if the calibration was refused.
    pub file: Option<String>,
}

impl Finished {
    /// Returns the header of the calibration file that `step` writes.
    #[must_use]
    pub fn header(&self, step: &str, provenance: &CalibrationProvenance) -> Header {
        Header {
            penumbra_calibration: VERSION,
            step: step.to_owned(),
            date: provenance.date.clone(),
            source: provenance.source.clone(),
            device: provenance.device.as_ref().map(|name| DeviceRecord {
                name: name.clone(),
                serial: provenance.serial.clone(),
            }),
            verdict: self.grade.name().to_owned(),
            findings: self.findings.iter().map(|f| f.1.clone()).collect(),
        }
    }
}

/// Date, source and device of a calibration, for its file and report.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CalibrationProvenance {
    /// UTC, ISO 8601.
    pub date: String,
    /// Name of the session, or "live".
    pub source: String,
    /// Name of the device, if known.
    pub device: Option<String>,
    /// Serial number of the device, if known.
    pub serial: Option<String>,
}

/// A calibration step.
pub trait Step: Send {
    /// Returns its name on the command line.
    fn name(&self) -> &'static str;

    /// Returns the inputs that it needs.
    fn inputs(&self) -> StepInputs;

    /// Processes one input.
    fn observe(&mut self, input: &StepInput);

    /// Returns its progress.
    fn progress(&self) -> Progress;

    /// Computes the result from all inputs so far.
    fn finish(&mut self, provenance: &CalibrationProvenance) -> Finished;
}
