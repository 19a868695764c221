//! Everything worth knowing about a running rig, as plain data: what `GET /status` says.
//!
//! The meaning of every field, as a reader of the JSON sees it, stands in
//! [`STATUS_FIELDS`](super::STATUS_FIELDS); a test keeps the two together. Numbers that
//! are not finite appear as `null`.

use super::planes::PlanesStatus;
use super::probe::ProbeStatus;
use super::recording::Recording;
use super::registration::RegistrationStatus;
use super::settings::Settings;
use super::times::StageTimes;
use penumbra_interface::DeviceKind;
use serde::Serialize;

/// Version of the JSON. It changes when a field changes its meaning or goes away, not
/// when one is added.
pub const STATUS_VERSION: u32 = 1;

/// The most warnings kept; what comes later only counts.
const MAX_WARNINGS: usize = 32;

/// The state of the rig at one instant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Snapshot {
    /// [`STATUS_VERSION`].
    pub version: u32,
    /// The program.
    pub program: Program,
    /// What is being played or seen.
    pub session: Session,
    /// Counts of scene frames.
    pub frames: Frames,
    /// Durations of the stages of a frame.
    pub stages: StageTimes,
    /// How the streams were paired.
    pub pairing: Pairing,
    /// What tells where the scene camera is.
    pub registration: RegistrationStatus,
    /// The match of the two cameras.
    pub white_balance: WhiteBalance,
    /// The light.
    pub lighting: LightingStatus,
    /// The scene and its file.
    pub scene: SceneStatus,
    /// Shadowing planes.
    pub planes: PlanesStatus,
    /// In which exposure the picture is shown.
    pub exposure: ExposureStatus,
    /// Recording.
    pub recording: Recording,
    /// Cameras and trackers.
    pub devices: Vec<Device>,
    /// What draws.
    pub adapter: Adapter,
    /// Size of the composited picture.
    pub resolution: Resolution,
    /// The settings that the newest picture was made with.
    pub settings: Settings,
    /// The browser's side.
    pub stream: Stream,
    /// What somebody should look at.
    pub warnings: Vec<Warning>,
}

impl Default for Snapshot {
    fn default() -> Self {
        Self {
            version: STATUS_VERSION,
            program: Program::default(),
            session: Session::default(),
            frames: Frames::default(),
            stages: StageTimes::default(),
            pairing: Pairing::default(),
            registration: RegistrationStatus::default(),
            white_balance: WhiteBalance::default(),
            lighting: LightingStatus::default(),
            scene: SceneStatus::default(),
            planes: PlanesStatus::default(),
            exposure: ExposureStatus::default(),
            recording: Recording::default(),
            devices: Vec::new(),
            adapter: Adapter::default(),
            resolution: Resolution::default(),
            settings: Settings::default(),
            stream: Stream::default(),
            warnings: Vec::new(),
        }
    }
}

impl Snapshot {
    /// Notes a warning; one that is known already is counted instead of repeated.
    pub fn warn(&mut self, text: &str) {
        if let Some(known) = self.warnings.iter_mut().find(|w| w.text == text) {
            known.count += 1;
        } else if self.warnings.len() < MAX_WARNINGS {
            let text = text.to_owned();
            self.warnings.push(Warning { text, count: 1 });
        }
    }

    /// Takes a warning back whose cause is gone.
    pub fn clear_warning(&mut self, text: &str) {
        self.warnings.retain(|w| w.text != text);
    }
}

/// The program that answers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Program {
    /// `penumbra`.
    pub name: &'static str,
    /// Its version.
    pub version: &'static str,
    /// Time since it began to answer, seconds; filled in when it is read.
    pub uptime_seconds: f64,
}

impl Default for Program {
    fn default() -> Self {
        Self {
            name: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            uptime_seconds: 0.0,
        }
    }
}

/// The scene and its file, which is read anew when it is changed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SceneStatus {
    /// The scene file; `None` where the session brings the scene.
    pub file: Option<String>,
    /// Times that a changed scene was taken into the picture.
    pub loads: u64,
    /// Why the newest change was not taken: what, where, what to do.
    pub reason: Option<String>,
}

/// What is being played or seen.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Session {
    /// File name of the recording, or name of the rig.
    pub name: String,
    /// What it is doing.
    pub state: SessionState,
    /// One sentence about that state, with the reason where there is one.
    pub sentence: String,
    /// Times the recording has begun anew.
    pub loops: u64,
    /// Share of the recording played, 0..=1; `None` when live.
    pub progress: Option<f64>,
}

impl Session {
    /// Goes into a state, with its own sentence.
    pub fn enter(&mut self, state: SessionState) {
        self.enter_because(state, state.sentence());
    }

    /// Goes into a state for a reason worth saying.
    pub fn enter_because(&mut self, state: SessionState, sentence: &str) {
        self.state = state;
        sentence.clone_into(&mut self.sentence);
    }
}

/// What the session is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SessionState {
    /// Nothing has been composed yet.
    #[default]
    Starting,
    /// Devices deliver.
    Live,
    /// A recording plays.
    Replaying,
    /// Held on purpose.
    Paused,
    /// The recording is over.
    Ended,
    /// It cannot go on.
    Failed,
}

impl SessionState {
    /// The state in words.
    #[must_use]
    pub const fn sentence(self) -> &'static str {
        match self {
            Self::Starting => "Getting ready: the first picture is on its way.",
            Self::Live => "Live: the cameras deliver.",
            Self::Replaying => "Playing a recording.",
            Self::Paused => "Paused on purpose; the last picture stays.",
            Self::Ended => "The recording is over; the last picture stays.",
            Self::Failed => "Stopped by an error.",
        }
    }
}

/// Counts of scene frames since the start.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Frames {
    /// Scene frames that arrived.
    pub arrived: u64,
    /// Pictures composited.
    pub composed: u64,
    /// Scene frames left out because a newer one was there, or because they were damaged.
    pub skipped: u64,
    /// Scene frames for which no pose was known: shown as the camera's picture.
    pub without_pose: u64,
    /// Composited pictures per second, over the last two seconds.
    pub per_second: f64,
    /// Age of the newest composited picture, milliseconds; filled in when it is read.
    pub last_age_ms: Option<f64>,
}

/// How the streams were paired into one instant.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Pairing {
    /// Scene frame minus its environment frame, milliseconds, newest.
    pub environment_skew_ms: Option<f64>,
    /// The larger of the distances to the pose records used, milliseconds, newest.
    pub pose_skew_ms: Option<f64>,
    /// Median of the environment skew since the start, milliseconds.
    pub environment_skew_p50_ms: Option<f64>,
    /// 99th percentile of it, milliseconds.
    pub environment_skew_p99_ms: Option<f64>,
    /// How the newest pose was found: `exact`, `interpolated`, `predicted` or `none`.
    pub pose: PoseAnswer,
    /// Standard deviation of the tracked camera's place by noise and prediction, millimetres.
    pub pose_sigma_mm: Option<f64>,
    /// Of its direction, degrees.
    pub pose_sigma_deg: Option<f64>,
    /// Of the picture of a point amid the virtual objects, pixels.
    pub pose_sigma_px: Option<f64>,
    /// The tracker's latency in force, milliseconds.
    pub tracker_latency_ms: Option<f64>,
    /// As it was measured while the rig ran.
    pub tracker_latency_measured_ms: Option<f64>,
    /// Standard deviation of that.
    pub tracker_latency_sigma_ms: Option<f64>,
    /// By what: `poses` or `image motion`.
    pub tracker_latency_by: Option<&'static str>,
    /// Seconds since then.
    pub tracker_latency_ago_s: Option<f64>,
    /// Why the newest seconds do not tell.
    pub tracker_latency_note: Option<String>,
}

/// How a pose was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseAnswer {
    /// A record of that very instant.
    Exact,
    /// Between two records.
    Interpolated,
    /// Carried on past the newest record.
    Predicted,
    /// Not known.
    #[default]
    None,
}

impl PoseAnswer {
    /// As it stands in the status and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Interpolated => "interpolated",
            Self::Predicted => "predicted",
            Self::None => "none",
        }
    }
}

/// Ways of finding the gains between the cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum WhiteBalanceMethod {
    /// Pictures of one colour chart or grey card taken by both cameras.
    Chart,
    /// What both cameras see of the same surfaces.
    Automatic,
    /// A surface of known reflectance in the measured light.
    KnownSurface,
    /// The scene's colours are taken to be grey on average: a guess.
    GreyWorld,
    /// The scene camera sees the environment itself: nothing to match.
    SameCamera,
    /// Gains written in the config.
    Configured,
    /// None: the cameras are taken as they are.
    #[default]
    None,
}

/// One estimate of the gains.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WhiteBalanceEstimate {
    /// How it was found.
    pub method: WhiteBalanceMethod,
    /// Linear factors on the environment camera's red, green, blue.
    pub gains: [f64; 3],
    /// Standard deviation of each, as a share of it.
    pub uncertainty: [f64; 3],
}

/// How the environment camera is brought to the scene camera's white point and exposure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WhiteBalance {
    /// The method in force.
    pub method: WhiteBalanceMethod,
    /// Linear factors in force on the environment camera's red, green, blue.
    pub gains: [f64; 3],
    /// Standard deviation of each, as a share of it.
    pub uncertainty: Option<[f64; 3]>,
    /// Largest relative difference between the methods that have an estimate.
    pub disagreement: Option<f64>,
    /// Why the estimate is held as it is, when it is.
    pub frozen: Option<String>,
    /// What each method says.
    pub estimates: Vec<WhiteBalanceEstimate>,
    /// The same white as both cameras see it.
    pub white: Option<WhiteMatch>,
}

impl Default for WhiteBalance {
    fn default() -> Self {
        Self {
            method: WhiteBalanceMethod::None,
            gains: [1.0; 3],
            uncertainty: None,
            disagreement: None,
            frozen: None,
            estimates: Vec::new(),
            white: None,
        }
    }
}

/// One white or grey surface as both cameras see it, linear RGB.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WhiteMatch {
    /// By the scene camera.
    pub scene: [f64; 3],
    /// By the environment camera, as it comes.
    pub environment_before: [f64; 3],
    /// The same after the gains.
    pub environment_after: [f64; 3],
}

/// The light in force.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LightingStatus {
    /// Dome lights that cast shadows now.
    pub dome_lights: u32,
    /// How many of them stand for compact sources.
    pub compact_lights: u32,
    /// Compact sources found: sun, lamps, windows.
    pub compact_sources: u32,
    /// Age of the environment picture against the scene picture, milliseconds.
    pub age_ms: Option<f64>,
    /// Why the light is older than it should be, when it is.
    pub stale: Option<String>,
    /// Share of the environment's solid angle seen clipped, 0..=1.
    pub clipped_fraction: Option<f64>,
    /// Unit vector to where most light comes from, world (+Z up).
    pub dominant_direction: Option<[f64; 3]>,
    /// By how much that light outshines the others, as a share of all light, 0..=1.
    pub dominance: Option<f64>,
    /// What a mirrored sphere in the scene camera's picture has shown; `None` where the light is
    /// seen otherwise.
    pub probe: Option<ProbeStatus>,
    /// Counts the previews of the environment; 0 = there is none at `/environment.png`.
    pub preview_revision: u64,
}

/// In which exposure the picture is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ExposureStatus {
    /// Of the newest picture, stops beside the camera's own.
    pub ev: f32,
    /// Where the automatic one is going, stops.
    pub wanted_ev: f32,
    /// Mean linear brightness of the camera's picture, where it is measured.
    pub camera: Option<f32>,
    /// What virtual lights add to it.
    pub added: Option<f32>,
    /// What virtual shadows take from it.
    pub taken: Option<f32>,
}

/// What a device is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DeviceState {
    /// Named nowhere.
    #[default]
    Absent,
    /// Being opened.
    Opening,
    /// Delivers.
    Streaming,
    /// Open, but nothing comes.
    Silent,
    /// Closed after trouble, to be opened again.
    Retrying,
    /// Cannot be used.
    Failed,
    /// The recording holds no more of it.
    Ended,
}

impl DeviceState {
    /// The state in words.
    #[must_use]
    pub const fn sentence(self) -> &'static str {
        match self {
            Self::Absent => "Not part of this session.",
            Self::Opening => "Being opened.",
            Self::Streaming => "Delivers as it should.",
            Self::Silent => "Nothing comes; the last of it stays in use.",
            Self::Retrying => "In trouble; it will be opened again shortly.",
            Self::Failed => "Cannot be used until somebody sees to it.",
            Self::Ended => "The recording holds no more of it.",
        }
    }

    /// As it stands in `/status` and as a metric label.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Absent => "absent",
            Self::Opening => "opening",
            Self::Streaming => "streaming",
            Self::Silent => "silent",
            Self::Retrying => "retrying",
            Self::Failed => "failed",
            Self::Ended => "ended",
        }
    }
}

/// A camera or a tracker.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Device {
    /// Its name or path.
    pub name: String,
    /// What it is for.
    pub kind: DeviceKind,
    /// What it is doing.
    pub state: DeviceState,
    /// The state in words.
    pub sentence: &'static str,
    /// What the driver said, when it is in trouble.
    pub reason: Option<String>,
    /// Frames or records per second.
    pub per_second: f64,
    /// Frames or records since the start.
    pub received: u64,
    /// Of these lost: gaps in its counter, damaged, or overtaken.
    pub dropped: u64,
    /// Age of the newest frame or record, milliseconds.
    pub last_age_ms: Option<f64>,
    /// Who it is, the same after replugging; `None` before it was open, and in a replay.
    pub identity: Option<String>,
    /// Size, format and rate of a camera; protocol of a tracker.
    pub mode: Option<String>,
    /// Times that it was tried to open it.
    pub attempts: u64,
    /// Times that it was lost after it had been open.
    pub losses: u64,
    /// When it is tried again, milliseconds from now; `None` while it is open.
    pub retry_in_ms: Option<f64>,
    /// What went wrong last, even if all is well again.
    pub last_trouble: Option<String>,
    /// What its user should know.
    pub notes: Vec<String>,
    /// Locked controls of a camera.
    pub controls: Vec<Control>,
}

/// What became of a control that the configuration locks.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Control {
    /// As in the configuration.
    pub name: String,
    /// The value asked for, in the device's unit.
    pub wanted: i64,
    /// The value that the device reports.
    pub in_force: Option<i64>,
    /// How the two compare, in words.
    pub standing: String,
}

impl Device {
    /// A device that has delivered nothing yet.
    #[must_use]
    pub fn new(name: &str, kind: DeviceKind) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            state: DeviceState::Opening,
            sentence: DeviceState::Opening.sentence(),
            reason: None,
            per_second: 0.0,
            received: 0,
            dropped: 0,
            last_age_ms: None,
            identity: None,
            mode: None,
            attempts: 0,
            losses: 0,
            retry_in_ms: None,
            last_trouble: None,
            notes: Vec::new(),
            controls: Vec::new(),
        }
    }

    /// Goes into a state, with its sentence and what the driver said.
    pub fn enter(&mut self, state: DeviceState, reason: Option<&str>) {
        self.state = state;
        self.sentence = state.sentence();
        if self.reason.as_deref() != reason {
            self.reason = reason.map(str::to_owned);
        }
    }
}

/// What draws.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Adapter {
    /// As the driver calls it.
    pub name: String,
    /// `Vulkan`, `Metal`, …
    pub backend: String,
    /// `DiscreteGpu`, `IntegratedGpu`, `Cpu`, …
    pub kind: String,
}

/// Size of the composited picture, pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Resolution {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// The browser's side; filled in by the stream itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stream {
    /// Browsers that watch `/stream.mjpeg`.
    pub viewers: u32,
    /// Pictures encoded for them.
    pub encoded: u64,
}

/// Something to look at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// What, where, what to do.
    pub text: String,
    /// How often it happened.
    pub count: u64,
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    #[test]
    fn warnings_are_counted_not_repeated_and_never_without_end() {
        let mut s = Snapshot::default();
        (0..100).for_each(|_| s.warn("again"));
        (0..100).for_each(|i| s.warn(&i.to_string()));
        assert_eq!((s.warnings.len(), s.warnings[0].count), (MAX_WARNINGS, 100));
        s.clear_warning("again");
        assert!(s.warnings.iter().all(|w| w.text != "again"));
    }

    #[test]
    fn states_bring_their_sentence() {
        let mut d = Device::new("/dev/video0", DeviceKind::SceneCamera);
        d.enter(DeviceState::Retrying, Some("unplugged"));
        let json = serde_json::to_value(&d).unwrap();
        assert_eq!(json["state"], DeviceState::Retrying.label());
        assert_eq!(json["sentence"], DeviceState::Retrying.sentence());
        assert_eq!(json["reason"], "unplugged");
        d.enter(DeviceState::Streaming, None);
        assert_eq!(d.reason, None);
    }

    #[test]
    fn labels_are_what_the_json_says() {
        use DeviceState::{Absent, Ended, Failed, Opening, Retrying, Silent, Streaming};
        for state in [Absent, Opening, Streaming, Silent, Retrying, Failed, Ended] {
            assert_eq!(serde_json::to_value(state).unwrap(), state.label());
        }
        use DeviceKind::{EnvironmentCamera, SceneCamera, Tracker};
        for kind in [SceneCamera, EnvironmentCamera, Tracker] {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.label());
        }
    }

    #[test]
    fn numbers_that_are_not_finite_are_null() {
        let mut s = Snapshot::default();
        s.frames.per_second = f64::NAN;
        s.white_balance.gains = [f64::INFINITY; 3];
        let json = serde_json::to_value(&s).unwrap();
        assert!(json["frames"]["per_second"].is_null());
        assert!(json["white_balance"]["gains"][0].is_null());
    }
}
