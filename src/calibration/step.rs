//! A step of calibration, whoever shows it what it asks for: a recording, a live rig, the
//! dashboard. It is shown pictures and poses in the order of their arrival, says at any time
//! how far it is and what to do next, and in the end what was found and whether that is good
//! enough.

use glam::DVec2;
use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_picture::Picture;
use penumbra_rig_model::DeviceRecord;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::VERSION;

/// Which camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eye {
    /// The one whose picture is augmented.
    Scene,
    /// The one that sees the light.
    Environment,
}

impl Eye {
    /// In a word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Environment => "environment",
        }
    }
}

/// What a step has to be shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wants {
    /// Pictures of the scene camera.
    pub scene: bool,
    /// Pictures of the environment camera.
    pub environment: bool,
    /// Its bracketed exposures too.
    pub brackets: bool,
    /// What the tracker reads.
    pub poses: bool,
    /// Pictures of one camera (and bracket) that are nearer in time need not be shown, seconds.
    pub spacing: f64,
}

/// One picture, decoded.
#[derive(Clone, Copy, Debug)]
pub struct ShownPicture<'a> {
    /// Whose.
    pub eye: Eye,
    /// The picture, encoded as the camera sent it.
    pub picture: &'a Picture,
    /// The driver's stamp; the calibration's latency is not taken off.
    pub captured_at: MonotonicTime,
    /// Stops relative to the base exposure.
    pub bracket_ev: f64,
    /// Exposure time × gain as the camera reports it, seconds.
    pub exposure: Option<f64>,
    /// Seconds since the first of all.
    pub seconds: f64,
}

/// What a step is shown.
#[derive(Clone, Copy, Debug)]
pub enum Shown<'a> {
    /// A picture.
    Picture(ShownPicture<'a>),
    /// A reading of the tracker; its arrival is uncorrected too.
    Pose(&'a PoseSample),
}

/// How far a step is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Of what it needs, 0 to 1.
    pub share: f64,
    /// What it has, in a few words: "14 views, 731 corners".
    pub message: String,
    /// What to do next: "tilt the board to the left"; empty when there is enough.
    pub hint: String,
    /// What it found in the last picture, pixels; to be drawn over it.
    pub marks: Vec<DVec2>,
    /// In whose picture.
    pub eye: Option<Eye>,
}

/// What a step found.
#[derive(Clone, Debug, PartialEq)]
pub struct Finished {
    /// Good enough?
    pub grade: Grade,
    /// Figures with their uncertainty, a line each.
    pub lines: Vec<String>,
    /// What speaks against it and what to do, worst first.
    pub findings: Vec<(Grade, String)>,
    /// What would make it better.
    pub hints: Vec<String>,
    /// The report: a whole HTML page that loads nothing.
    pub page: String,
    /// The calibration, as JSON; none if it was refused.
    pub file: Option<String>,
}

impl Finished {
    /// The header of the calibration file that `step` writes.
    #[must_use]
    pub fn header(&self, step: &str, made: &Made) -> Header {
        Header {
            penumbra_calibration: VERSION,
            step: step.to_owned(),
            date: made.date.clone(),
            source: made.source.clone(),
            device: made.device.as_ref().map(|name| DeviceRecord {
                name: name.clone(),
                serial: made.serial.clone(),
            }),
            verdict: self.grade.name().to_owned(),
            findings: self.findings.iter().map(|f| f.1.clone()).collect(),
        }
    }
}

/// Who asks, when, of what; goes into file and report.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Made {
    /// UTC, ISO 8601.
    pub date: String,
    /// A session's name, or "live".
    pub source: String,
    /// Device's name, as far as known.
    pub device: Option<String>,
    /// Its serial number.
    pub serial: Option<String>,
}

/// A step of calibration.
pub trait Step: Send {
    /// Its name on the command line.
    fn name(&self) -> &'static str;

    /// What is to be shown.
    fn wants(&self) -> Wants;

    /// Here it is.
    fn look(&mut self, shown: &Shown);

    /// How far it is.
    fn progress(&self) -> Progress;

    /// All that it will see it has seen.
    fn finish(&mut self, made: &Made) -> Finished;
}
