//! The state of a running rig as plain data: the content of `GET /status`.
//!
//! [`STATUS_FIELDS`](super::STATUS_FIELDS) describes every field for readers of the JSON; a test
//! compares the two. Numbers that are not finite appear as `null`.

use super::guide::GuideStatus;
use super::memory::Memory;
use super::objects::ObjectsStatus;
use super::planes::PlanesStatus;
use super::playback::PlaybackStatus;
use super::probe::ProbeStatus;
use super::recording::Recording;
use super::registration::RegistrationStatus;
use super::settings::Settings;
use super::times::StageTimes;
use penumbra_config::Quality;
use penumbra_interface::DeviceKind;
use serde::Serialize;

/// Version of the JSON. It changes when a field changes its meaning or is removed, not
/// when one is added.
pub const STATUS_VERSION: u32 = 1;

/// Maximum number of warnings kept; later ones are only counted.
const MAX_WARNINGS: usize = 32;
/// Maximum length of a warning, bytes.
const MAX_TEXT_BYTES: usize = 1000;

/// The state of the rig at one instant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Snapshot {
    /// [`STATUS_VERSION`].
    pub version: u32,
    /// The program.
    pub program: Program,
    /// The recording or the live rig.
    pub session: Session,
    /// Counts of scene frames.
    pub frames: Frames,
    /// Durations of the stages of a frame.
    pub stages: StageTimes,
    /// How the streams were paired.
    pub pairing: Pairing,
    /// Source and accuracy of the scene camera's pose.
    pub registration: RegistrationStatus,
    /// The scene camera's lens.
    pub lens: LensStatus,
    /// Brightness of the scene camera's picture.
    pub levels: Levels,
    /// White balance between the cameras.
    pub white_balance: WhiteBalance,
    /// Lighting.
    pub lighting: LightingStatus,
    /// The scene and its file.
    pub scene: SceneStatus,
    /// Virtual objects and their places.
    pub objects: ObjectsStatus,
    /// Shadowing planes.
    pub planes: PlanesStatus,
    /// Exposure of the output.
    pub exposure: ExposureStatus,
    /// Playback of a recording.
    pub playback: PlaybackStatus,
    /// Recording.
    pub recording: Recording,
    /// Cameras and trackers.
    pub devices: Vec<Device>,
    /// Graphics adapter.
    pub adapter: Adapter,
    /// Quality of the pictures.
    pub quality: Quality,
    /// Size of the composited picture.
    pub resolution: Resolution,
    /// Settings of the newest picture.
    pub settings: Settings,
    /// Settings as requested; they differ from `settings` until a picture uses them. Filled in when
    /// the snapshot is read.
    pub settings_requested: Settings,
    /// Settings at the start, by configuration and command line; filled in likewise.
    pub settings_configured: Settings,
    /// The stream to browsers.
    pub stream: Stream,
    /// Set-up of a webcam's rig; `None` for other rigs.
    pub guide: Option<GuideStatus>,
    /// Warnings for the user.
    pub warnings: Vec<Warning>,
    /// The log, whose entries are at `/log`.
    pub log: LogStatus,
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
            lens: LensStatus::default(),
            levels: Levels::default(),
            white_balance: WhiteBalance::default(),
            lighting: LightingStatus::default(),
            scene: SceneStatus::default(),
            objects: ObjectsStatus::default(),
            planes: PlanesStatus::default(),
            exposure: ExposureStatus::default(),
            playback: PlaybackStatus::default(),
            recording: Recording::default(),
            devices: Vec::new(),
            adapter: Adapter::default(),
            quality: Quality::default(),
            resolution: Resolution::default(),
            settings: Settings::default(),
            settings_requested: Settings::default(),
            settings_configured: Settings::default(),
            stream: Stream::default(),
            guide: None,
            warnings: Vec::new(),
            log: LogStatus::default(),
        }
    }
}

/// Returns the beginning of a text, which may come from outside.
fn clipped(text: &str) -> &str {
    &text[..text.floor_char_boundary(MAX_TEXT_BYTES)]
}

impl Snapshot {
    /// Adds a warning of at most 1000 bytes; a repeated one is counted.
    pub fn warn(&mut self, text: &str) {
        let text = clipped(text);
        if let Some(known) = self.warnings.iter_mut().find(|w| w.text == text) {
            known.count += 1;
        } else if self.warnings.len() < MAX_WARNINGS {
            let text = text.to_owned();
            self.warnings.push(Warning { text, count: 1 });
        }
    }

    /// Removes a warning whose cause is gone.
    pub fn clear_warning(&mut self, text: &str) {
        let text = clipped(text);
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
    /// Time since the start, seconds; filled in when the snapshot is read.
    pub uptime_seconds: f64,
    /// Memory; filled in likewise.
    pub memory: Memory,
}

impl Default for Program {
    fn default() -> Self {
        Self {
            name: "penumbra",
            version: env!("CARGO_PKG_VERSION"),
            uptime_seconds: 0.0,
            memory: Memory::default(),
        }
    }
}

/// The scene and its file, which is read again when it changes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SceneStatus {
    /// The scene file; `None` if the session holds the scene.
    pub file: Option<String>,
    /// Number of changed scenes that were applied.
    pub loads: u64,
    /// Why the newest change was not applied: what, where, what to do.
    pub reason: Option<String>,
}

/// The recording or the live rig.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Session {
    /// File name of the recording, or name of the rig.
    pub name: String,
    /// State.
    pub state: SessionState,
    /// The state in words, with the reason if there is one.
    pub description: String,
    /// How often the recording was repeated.
    pub loops: u64,
    /// Share of the recording played, 0..=1; `None` when live.
    pub progress: Option<f64>,
}

impl Session {
    /// Sets a state, with its default description.
    pub fn enter(&mut self, state: SessionState) {
        self.enter_because(state, state.description());
    }

    /// Sets a state with a reason.
    pub fn enter_because(&mut self, state: SessionState, description: &str) {
        self.state = state;
        description.clone_into(&mut self.description);
    }
}

/// State of the session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SessionState {
    /// Before the first picture.
    #[default]
    Starting,
    /// Devices stream.
    Live,
    /// A recording plays.
    Replaying,
    /// Paused.
    Paused,
    /// The recording has ended.
    Ended,
    /// Stopped by an error.
    Failed,
}

impl SessionState {
    /// The state in words.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Starting => "Starting: waiting for the first picture.",
            Self::Live => "Live: the cameras deliver.",
            Self::Replaying => "Playing a recording.",
            Self::Paused => "Paused; the last picture is shown.",
            Self::Ended => "The recording has ended; the last picture is shown.",
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
    /// Scene frames skipped: replaced by a newer one, or damaged.
    pub skipped: u64,
    /// Scene frames in damaged parts of the recording.
    pub lost: u64,
    /// Scene frames without a known pose; they show the camera's picture.
    pub without_pose: u64,
    /// Composited pictures per second, over the last two seconds.
    pub per_second: f64,
    /// Age of the newest composited picture, milliseconds; filled in when the snapshot is read.
    pub last_age_ms: Option<f64>,
}

/// Pairing of the streams.
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
    /// Readings of the tracker that no motion of a hand explains; they are not used.
    pub rejected_poses: u64,
    /// Standard deviation of the camera's position by noise and prediction, millimetres.
    pub pose_sigma_mm: Option<f64>,
    /// Standard deviation of its orientation, degrees.
    pub pose_sigma_deg: Option<f64>,
    /// Standard deviation of the image of a point amid the virtual objects, pixels.
    pub pose_sigma_px: Option<f64>,
    /// Tracker latency that is used, milliseconds.
    pub tracker_latency_ms: Option<f64>,
    /// Tracker latency as measured while the rig runs, milliseconds.
    pub tracker_latency_measured_ms: Option<f64>,
    /// Its standard deviation, milliseconds.
    pub tracker_latency_sigma_ms: Option<f64>,
    /// Source of the measurement: `poses` or `image motion`.
    pub tracker_latency_by: Option<&'static str>,
    /// Time since the measurement, seconds.
    pub tracker_latency_ago_s: Option<f64>,
    /// Why the latency cannot be measured now.
    pub tracker_latency_note: Option<String>,
}

/// How a pose was obtained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseAnswer {
    /// A record of the same instant.
    Exact,
    /// Interpolated between two records.
    Interpolated,
    /// Predicted past the newest record.
    Predicted,
    /// Unknown.
    #[default]
    None,
}

impl PoseAnswer {
    /// Returns the name in status and in files.
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

/// Methods that estimate the gains between the cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum WhiteBalanceMethod {
    /// Pictures of one colour chart or grey card taken by both cameras.
    Chart,
    /// Surfaces that both cameras see.
    Automatic,
    /// A surface of known reflectance in the measured light.
    KnownSurface,
    /// The scene is assumed to be grey on average: a guess.
    GreyWorld,
    /// The scene camera sees the environment itself: nothing to match.
    SameCamera,
    /// Both cameras are of one model, as the configuration states.
    SameModel,
    /// Both cameras have the same product name, and are assumed to have the same settings.
    SameProduct,
    /// Configured gains.
    Configured,
    /// No correction.
    #[default]
    None,
}

/// One estimate of the gains.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WhiteBalanceEstimate {
    /// Method.
    pub method: WhiteBalanceMethod,
    /// Linear factors on the environment camera's red, green, blue.
    pub gains: [f64; 3],
    /// Relative standard deviation of each.
    pub uncertainty: [f64; 3],
}

/// Match of the environment camera to the scene camera's white point and exposure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WhiteBalance {
    /// Active method.
    pub method: WhiteBalanceMethod,
    /// Active linear factors on the environment camera's red, green, blue.
    pub gains: [f64; 3],
    /// Relative standard deviation of each.
    pub uncertainty: Option<[f64; 3]>,
    /// Maximum relative difference between the methods with an estimate.
    pub disagreement: Option<f64>,
    /// Why the estimate is frozen; `None` while it is updated.
    pub frozen: Option<String>,
    /// Estimates of all methods.
    pub estimates: Vec<WhiteBalanceEstimate>,
    /// A white surface as both cameras see it.
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
    /// In the scene camera.
    pub scene: [f64; 3],
    /// In the environment camera, before the gains.
    pub environment_before: [f64; 3],
    /// The same after the gains.
    pub environment_after: [f64; 3],
}

/// Active lighting.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LightingStatus {
    /// Number of dome lights that cast shadows.
    pub dome_lights: u32,
    /// Number of those that represent compact sources.
    pub compact_lights: u32,
    /// Number of compact sources detected: sun, lamps, windows.
    pub compact_sources: u32,
    /// These sources, strongest first.
    pub lamps: Vec<LampStatus>,
    /// Age of the environment picture relative to the scene picture, milliseconds.
    pub age_ms: Option<f64>,
    /// Number of environment pictures since the start from which no light was estimated, because
    /// estimates took longer than their interval.
    pub environments_left_out: u64,
    /// Why the lighting is stale; `None` if it is not.
    pub stale: Option<String>,
    /// Share of the environment's solid angle that is clipped, 0..=1.
    pub clipped_fraction: Option<f64>,
    /// By how much the environment camera's exposures disagree about the same light under its tone
    /// curve: root mean square, relative; `None` before two exposures have shown enough.
    pub exposures_disagree: Option<f64>,
    /// By how much the contrasts of real shadows in the scene camera's picture differ from what the
    /// estimated light predicts: root mean square over the surfaces, relative; `None` before any was
    /// compared.
    pub picture_difference: Option<f64>,
    /// Its standard error, relative.
    pub picture_difference_sigma: Option<f64>,
    /// A line for each real surface whose shadows differ significantly.
    pub disagreeing: Vec<String>,
    /// Unit vector towards the dominant light, world (+Z up).
    pub dominant_direction: Option<[f64; 3]>,
    /// Dominance of that light over the rest, as a share of all light, 0..=1.
    pub dominance: Option<f64>,
    /// State of the mirrored sphere in the scene camera's picture; `None` with another source of
    /// light.
    pub probe: Option<ProbeStatus>,
    /// Number of previews of the environment; 0 = none at `/environment.png` yet.
    pub preview_revision: u64,
}

/// A compact source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LampStatus {
    /// Unit vector from the environment camera towards it, world (+Z up).
    pub direction: [f64; 3],
    /// Where it is, world, metres; `None` if it counts as infinitely far.
    pub position: Option<[f64; 3]>,
    /// Its distance from the environment camera, metres; `None` likewise.
    pub distance_m: Option<f64>,
    /// Standard deviation of that distance, metres; 0 where the place is stated.
    pub distance_sigma_m: Option<f64>,
    /// Share of its light in pixels that every exposure clips, 0..=1.
    pub clipped: f64,
    /// Whether the environment camera does not see it: real shadows show it.
    pub unseen: bool,
}

/// Exposure of the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ExposureStatus {
    /// Exposure of the newest picture, stops relative to the camera's.
    pub ev: f32,
    /// Target of the automatic exposure, stops.
    pub target_ev: f32,
    /// Mean linear brightness of the camera's picture, where it is measured.
    pub camera: Option<f32>,
    /// Mean linear brightness added by virtual lights.
    pub added: Option<f32>,
    /// Mean linear brightness removed by virtual shadows.
    pub removed: Option<f32>,
}

/// State of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DeviceState {
    /// Not configured.
    #[default]
    Absent,
    /// Being opened.
    Opening,
    /// Streaming.
    Streaming,
    /// Open, without data.
    Silent,
    /// Closed after an error, to be opened again.
    Retrying,
    /// Failed permanently.
    Failed,
    /// The recording has no more data of it.
    Ended,
}

impl DeviceState {
    /// The state in words.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Absent => "Not part of this session.",
            Self::Opening => "Opening.",
            Self::Streaming => "Streaming.",
            Self::Silent => "No data; the last data stay in use.",
            Self::Retrying => "Closed after an error; it will be opened again.",
            Self::Failed => "Failed; it needs attention.",
            Self::Ended => "The recording has no more data of it.",
        }
    }

    /// Returns the name in `/status` and in metric labels.
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
    /// Name or path.
    pub name: String,
    /// Role.
    pub kind: DeviceKind,
    /// State.
    pub state: DeviceState,
    /// The state in words.
    pub description: &'static str,
    /// The driver's error, if there is one.
    pub reason: Option<String>,
    /// Frames or records per second.
    pub per_second: f64,
    /// Frames or records since the start.
    pub received: u64,
    /// Frames or records lost: gaps in the counter, damaged, or replaced by newer ones.
    pub dropped: u64,
    /// Age of the newest frame or record, milliseconds.
    pub last_age_ms: Option<f64>,
    /// Identity that persists when the device is plugged in again; `None` before it was open, and in
    /// a replay.
    pub identity: Option<String>,
    /// Size, format and rate of a camera; protocol of a tracker.
    pub mode: Option<String>,
    /// Number of attempts to open it.
    pub attempts: u64,
    /// Number of times that the open device was lost.
    pub losses: u64,
    /// Time until the next attempt, milliseconds; `None` while it is open.
    pub retry_in_ms: Option<f64>,
    /// The last error, even if it is resolved.
    pub last_error: Option<String>,
    /// What was wrong with single frames or records, with the number of each.
    pub problems: Vec<Problem>,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Locked controls of a camera.
    pub controls: Vec<Control>,
}

/// A kind of problem that single frames or records had.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// What was wrong.
    pub text: &'static str,
    /// Number of frames or records, since the start.
    pub count: u64,
}

/// State of a control that the configuration locks.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Control {
    /// Name in the configuration.
    pub name: String,
    /// The requested value, in the device's unit.
    pub requested: i64,
    /// The value that the device reports.
    pub active: Option<i64>,
    /// Comparison of the two values, in words.
    pub status: String,
}

impl Device {
    /// Creates a device without data.
    #[must_use]
    pub fn new(name: &str, kind: DeviceKind) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            state: DeviceState::Opening,
            description: DeviceState::Opening.description(),
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
            last_error: None,
            problems: Vec::new(),
            notes: Vec::new(),
            controls: Vec::new(),
        }
    }

    /// Sets a state, with its description and the driver's error.
    pub fn enter(&mut self, state: DeviceState, reason: Option<&str>) {
        self.state = state;
        self.description = state.description();
        if self.reason.as_deref() != reason {
            self.reason = reason.map(str::to_owned);
        }
    }
}

/// The graphics adapter.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Adapter {
    /// Name, from its driver.
    pub name: String,
    /// `Vulkan`, `Metal`, …
    pub backend: String,
    /// `DiscreteGpu`, `IntegratedGpu`, `Cpu`, …
    pub kind: String,
    /// Number of times that the device was lost and opened again.
    pub losses: u64,
    /// Time from the last loss to the next picture, seconds.
    pub recovery_seconds: Option<f64>,
}

/// The scene camera's lens.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LensStatus {
    /// Where it comes from.
    pub source: LensSource,
    /// Field of view across the picture, degrees.
    pub field_of_view_deg: Option<f64>,
    /// Whether it is being refined by views of the markers.
    pub refining: bool,
    /// Views of the markers that were kept.
    pub views: u32,
    /// RMS reprojection error of these views, pixels.
    pub reprojection_px: Option<f64>,
    /// Standard deviation of the focal length, per cent.
    pub focal_sigma_percent: Option<f64>,
    /// The most useful further view.
    pub hint: Option<String>,
}

/// Where the scene camera's lens comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LensSource {
    /// Assumed, or stated in rig.json.
    #[default]
    Assumed,
    /// Calibrated.
    Calibrated,
    /// Refined by views of the markers, now or earlier.
    Refined,
}

/// Brightness of the scene camera's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Levels {
    /// Mean of the codes, 0 to 255; `None` before the first picture.
    pub mean_code: Option<f64>,
    /// Share of the pixels with a clipped channel.
    pub clipped: Option<f64>,
}

/// Size of the composited picture, pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Resolution {
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

/// The stream to browsers; filled in by the stream itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stream {
    /// Number of viewers of `/stream.mjpeg`.
    pub viewers: u32,
    /// Pictures encoded for them.
    pub encoded: u64,
}

/// State of the log; filled in when the snapshot is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LogStatus {
    /// Number of the newest entry; 0 without entries.
    pub newest: u64,
}

/// A warning.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// What, where, what to do.
    pub text: String,
    /// Number of occurrences.
    pub count: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_has_the_name_that_users_know() {
        assert_eq!(Snapshot::default().program.name, "penumbra");
    }

    #[test]
    fn repeated_warnings_are_counted_and_their_number_is_limited() {
        let mut s = Snapshot::default();
        (0..100).for_each(|_| s.warn("again"));
        (0..100).for_each(|i| s.warn(&i.to_string()));
        assert_eq!((s.warnings.len(), s.warnings[0].count), (MAX_WARNINGS, 100));
        s.clear_warning("again");
        s.warn(&"ü".repeat(10_000));
        assert!(s.warnings.iter().all(|w| w.text.len() <= MAX_TEXT_BYTES));
        assert!(s.warnings.iter().all(|w| w.text != "again"));
    }

    #[test]
    fn entering_a_state_sets_its_description() {
        let mut d = Device::new("/dev/video0", DeviceKind::SceneCamera);
        d.enter(DeviceState::Retrying, Some("unplugged"));
        let json = serde_json::to_value(&d).unwrap();
        assert_eq!(json["state"], DeviceState::Retrying.label());
        assert_eq!(json["description"], DeviceState::Retrying.description());
        assert_eq!(json["reason"], "unplugged");
        d.enter(DeviceState::Streaming, None);
        assert_eq!(d.reason, None);
    }

    #[test]
    fn labels_equal_the_json_values() {
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
    fn non_finite_numbers_become_null() {
        let mut s = Snapshot::default();
        s.frames.per_second = f64::NAN;
        s.white_balance.gains = [f64::INFINITY; 3];
        let json = serde_json::to_value(&s).unwrap();
        assert!(json["frames"]["per_second"].is_null());
        assert!(json["white_balance"]["gains"][0].is_null());
    }
}
