//! The configuration: a TOML file in which every key is optional becomes [`Config`], in which
//! every setting with a default is present. `config/rig.toml` documents every key and its default.

mod choice;
mod convert;
mod device_source;
mod devices;
mod error;
mod exposure;
mod file;
mod look;
mod planes;
mod range;
mod registration;
mod renamed;
pub mod token;

pub use choice::{
    Antialias, Clipped, FollowLatency, LightPlaces, Monitor, Quality, Refresh, ReplayPairing,
    ReplaySpeed, Technique, ToneCurve, Unseen,
};
pub use convert::{LIGHT_COUNTS, default_value, listen_needs_token};
pub use device_source::{CameraSource, REPLAY_PREFIX, TrackerSource, replay_name};
pub use devices::{
    ControlChange, ControlValue, FormatName, Hemisphere, RecordingConfig, TrackerConfig,
    TrackerUnits,
};
pub use error::ConfigError;
pub use exposure::{
    ADAPTATION_SECONDS, EXPOSURE_KEYS, EXPOSURE_STOPS, ExposureChoice, ExposureConfig,
    ExposureMode, MAX_EV_STOPS, MIN_EV_STOPS,
};
pub use look::LookConfig;
pub use penumbra_lighting::{Filtering, IrradianceMethod, LightPlacement};
pub use penumbra_picture::{YuvEncoding, YuvMatrix, YuvRange};
use penumbra_rig_model::EnvironmentSource;
pub use penumbra_scene::{Highlights, LampResponse, PlaneShading, SceneChoice, ShadowMode};
use penumbra_sync::{Degree, Smoothing};
pub use penumbra_white_balance::WhiteBalanceMethod;
pub use planes::{FREQUENCIES, PlaneReceiver, PlanesConfig, lights_of_dome};
pub use registration::{Distortion, PoseSource, Predict, RegistrationConfig, register_dictionary};
pub use renamed::renamed_word;

use penumbra_interface::CameraSettings;
use penumbra_scene::SceneAddition;
use penumbra_strict_toml::{TomlError, TomlText};
use std::fmt;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

/// All settings, with defaults applied.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// Virtual objects.
    pub scene: SceneChoice,
    /// Scene files and models that can be chosen while the rig runs.
    pub scene_files: SceneFilesConfig,
    /// The scene camera.
    pub scene_camera: SceneCameraConfig,
    /// The environment camera, if the rig has one.
    pub environment_camera: Option<CameraSource>,
    /// The tracker, if the rig has one.
    pub tracker: Option<TrackerSource>,
    /// The live rig's calibration, phantoms and objects: a folder or a session.
    pub calibration: Option<PathBuf>,
    /// Recordings of the live rig.
    pub recording: RecordingConfig,
    /// The environment and its lights.
    pub environment: EnvironmentConfig,
    /// Source of the scene camera's pose.
    pub registration: RegistrationConfig,
    /// Dictionaries of markers; [`Self::load`] registers them.
    pub dictionaries: Vec<PathBuf>,
    /// White balance between the cameras.
    pub white_balance: WhiteBalanceConfig,
    /// Shadows of virtual objects.
    pub shadows: ShadowConfig,
    /// Lighting of virtual objects.
    pub shading: ShadingConfig,
    /// Shadowing planes.
    pub planes: PlanesConfig,
    /// Exposure of the output.
    pub exposure: ExposureConfig,
    /// Rendering of the picture.
    pub picture: PictureConfig,
    /// The camera's look on virtual objects.
    pub look: LookConfig,
    /// Latencies, smoothing and prediction.
    pub sync: SyncConfig,
    /// Encoding of camera pictures.
    pub input: InputConfig,
    /// Outputs of the picture.
    pub output: OutputConfig,
    /// Status endpoint.
    pub status: StatusConfig,
    /// Graphics adapter.
    pub gpu: GpuConfig,
    /// Replay of recordings.
    pub replay: ReplayConfig,
}

/// The keys of `[scene]` beside `file`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFilesConfig {
    /// Their folder; see [`Config::scene_folder`].
    pub folder: Option<PathBuf>,
    /// Maximum size of a file that is uploaded, bytes; 0 refuses all.
    pub max_upload_bytes: u64,
}

impl Default for SceneFilesConfig {
    fn default() -> Self {
        Self {
            folder: None,
            max_upload_bytes: 64_000_000,
        }
    }
}

impl Config {
    /// Returns the folder of scene files and models: the configured one, else that of the scene
    /// file, else `scenes` where the program was started.
    #[must_use]
    pub fn scene_folder(&self) -> PathBuf {
        if let Some(folder) = &self.scene_files.folder {
            return folder.clone();
        }
        match &self.scene {
            SceneChoice::File(file) => match file.parent() {
                Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
                _ => PathBuf::from("."),
            },
            SceneChoice::Session | SceneChoice::None => PathBuf::from("scenes"),
        }
    }
}

/// `[scene_camera]`
#[derive(Clone, Debug, PartialEq)]
pub struct SceneCameraConfig {
    /// The camera of a live rig.
    pub source: CameraSource,
    /// Overrides the calibration's.
    pub response: Option<ToneCurve>,
}

/// `[environment]`
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentConfig {
    /// Where the light is measured.
    pub source: EnvironmentSource,
    /// Overrides the calibration's.
    pub response: Option<ToneCurve>,
    /// Overrides the calibration's; empty = brackets are ignored.
    pub brackets_ev: Option<Vec<f64>>,
    /// Texels along an edge of the cube map, a power of two.
    pub cube_size: u32,
    /// How the dome lights are placed.
    pub light_placement: LightPlacement,
    /// Budget of dome lights: one of [`LIGHT_COUNTS`].
    pub light_count: u32,
    /// Treatment of sources that every exposure clips.
    pub clipped: Clipped,
    /// How diffuse irradiance is computed.
    pub irradiance: IrradianceMethod,
    /// Radiance of directions that are not seen.
    pub unseen: Unseen,
    /// Lighting older than this is flagged, nanoseconds.
    pub stale_after_nanos: i64,
    /// Whether the places of lamps are estimated.
    pub light_places: LightPlaces,
    /// `map`, with [`EnvironmentSource::Map`].
    pub map: Option<EnvironmentMapConfig>,
    /// `[[room_light]]`: places of lamps and windows as stated.
    pub room_lights: Vec<RoomLight>,
}

/// A light whose place is stated, world, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RoomLight {
    /// A lamp.
    Lamp {
        /// Its middle.
        position: [f64; 3],
    },
    /// A window, or another flat, rectangular source.
    Window {
        /// Its corners, in the order of its edge: a parallelogram.
        corners: [[f64; 3]; 4],
    },
}

/// An environment map that states the light.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMapConfig {
    /// An equirectangular picture, Radiance HDR or OpenEXR.
    pub path: PathBuf,
    /// Rotation about the world's +Z, counterclockwise from above, radians.
    pub yaw: f32,
    /// Factor on its radiance: 1 in the result is the scene camera's white.
    pub factor: f32,
}

/// `[white_balance]`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WhiteBalanceConfig {
    /// How the gains are estimated.
    pub method: WhiteBalanceMethod,
    /// Linear gains on the environment camera for [`WhiteBalanceMethod::Fixed`].
    pub gains: [f32; 3],
    /// Estimate a 3×3 matrix instead of three gains, where the method can.
    pub matrix: bool,
    /// Whether both cameras are of one model, with the same white balance and picture settings;
    /// `None`: assumed of cameras whose lens calibrations name the same product.
    pub same_camera: Option<bool>,
}

/// `[shadows]`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowConfig {
    /// How virtual objects are lit and cast shadows.
    pub technique: Technique,
    /// How shadows change the camera's picture.
    pub mode: ShadowMode,
    /// Strength, 0 (none) to 1 (as measured).
    pub strength: f32,
    /// Texels along an edge of one shadow map, a power of two.
    pub map_size: u32,
    /// Shadow maps updated in each frame.
    pub refresh_per_frame: Refresh,
    /// Whether compact sources cast soft shadows by their angular extent.
    pub soft: bool,
}

/// `[shading]`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShadingConfig {
    /// How the environment is filtered for reflections on virtual objects.
    pub reflections: Filtering,
    /// Whether virtual objects and real surfaces reflect light onto each other.
    pub indirect_light: bool,
    /// How real surfaces respond to virtual lamps.
    pub lamp_response: LampResponse,
}

impl Default for ShadingConfig {
    fn default() -> Self {
        Self {
            reflections: Filtering::default(),
            indirect_light: true,
            lamp_response: LampResponse::default(),
        }
    }
}

/// `[picture]`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PictureConfig {
    /// Whether pictures keep up with the cameras or take the time for the best result.
    pub quality: Quality,
    /// Antialiasing of virtual objects.
    pub antialias: Antialias,
}

/// `[sync]`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SyncConfig {
    /// Overrides the calibration's, nanoseconds.
    pub scene_camera_latency_nanos: Option<i64>,
    /// Overrides the calibration's, nanoseconds.
    pub environment_camera_latency_nanos: Option<i64>,
    /// Overrides the calibration's, nanoseconds.
    pub tracker_latency_nanos: Option<i64>,
    /// Whether the tracker latency is measured while the rig runs.
    pub follow_latency: FollowLatency,
    /// Half the maximum window over which poses are smoothed, nanoseconds; 0 = none.
    pub pose_smoothing_nanos: i64,
    /// Maximum prediction of a pose, nanoseconds.
    pub max_prediction_nanos: i64,
    /// Maximum time that a live picture waits for the tracker, nanoseconds.
    pub max_wait_nanos: i64,
}

impl SyncConfig {
    /// Returns the smoothing for the tracker's history.
    #[must_use]
    pub const fn smoothing(self) -> Smoothing {
        match self.pose_smoothing_nanos {
            0 => Smoothing::None,
            half_window_nanos => Smoothing::Local {
                half_window_nanos,
                degree: Degree::Quadratic,
            },
        }
    }
}

/// `[input]`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputConfig {
    /// Matrix of YUYV and NV12.
    pub yuv_matrix: YuvMatrix,
    /// Range of YUYV and NV12.
    pub yuv_range: YuvRange,
}

impl InputConfig {
    /// Returns the encoding for the picture decoder.
    #[must_use]
    pub const fn encoding(self) -> YuvEncoding {
        YuvEncoding {
            matrix: self.yuv_matrix,
            range: self.yuv_range,
        }
    }
}

/// `[output]`
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputConfig {
    /// Whether a window shows the picture.
    pub window: bool,
    /// The window's monitor; the primary one if `None`.
    pub monitor: Option<Monitor>,
    /// Whether the window fills the monitor.
    pub fullscreen: bool,
    /// Folder into which each frame is written as a PNG.
    pub frames: Option<PathBuf>,
    /// Whether only the frames are written that a viewer sees, as they are seen: no late ones, in the
    /// light that is known by then.
    pub as_shown: bool,
    /// UDP receiver of the scene camera's pose, as FreeD D1.
    pub freed: Option<SocketAddr>,
}

/// `[status]`
#[derive(Clone, PartialEq, Eq)]
pub struct StatusConfig {
    /// Address and port.
    pub listen: SocketAddr,
    /// Bearer token that requests must carry; needed for any address but loopback.
    pub token: Option<String>,
    /// JPEG quality of the stream, 1..=100.
    pub stream_quality: u8,
    /// Maximum number of viewers of the stream, 1..=4096.
    pub viewers: u32,
    /// What each stream sends to all its viewers together at most, megabits per second.
    pub stream_mbit_per_s: u32,
    /// The printed sheet through whose set-up the page guides: a PDF.
    pub guide: Option<PathBuf>,
}

impl fmt::Debug for StatusConfig {
    // The token is a secret and stays out of logs.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("StatusConfig")
            .field("listen", &self.listen)
            .field("token", &self.token.as_ref().map(|_| "(set)"))
            .field("stream_quality", &self.stream_quality)
            .field("viewers", &self.viewers)
            .field("stream_mbit_per_s", &self.stream_mbit_per_s)
            .field("guide", &self.guide)
            .finish()
    }
}

/// `[gpu]`
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GpuConfig {
    /// Part of the adapter's name; the best adapter if `None`.
    pub adapter: Option<String>,
}

/// `[replay]`
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReplayConfig {
    /// Speed of the replay.
    pub speed: ReplaySpeed,
    /// Whether the recording repeats.
    pub repeat: bool,
    /// How long pictures wait for matching readings.
    pub pairing: ReplayPairing,
}

impl Default for SceneCameraConfig {
    /// The only connected camera.
    fn default() -> Self {
        Self {
            source: CameraSource::System(CameraSettings::default()),
            response: None,
        }
    }
}

impl Default for EnvironmentConfig {
    fn default() -> Self {
        Self {
            source: EnvironmentSource::Auto,
            response: None,
            brackets_ev: None,
            cube_size: 128,
            light_placement: LightPlacement::Adaptive,
            light_count: 64,
            clipped: Clipped::Estimate,
            irradiance: IrradianceMethod::Harmonics,
            unseen: Unseen::SceneCamera,
            stale_after_nanos: 500_000_000,
            map: None,
            light_places: LightPlaces::Estimate,
            room_lights: Vec::new(),
        }
    }
}

impl Default for WhiteBalanceConfig {
    fn default() -> Self {
        Self {
            method: WhiteBalanceMethod::Auto,
            gains: [1.0; 3],
            matrix: false,
            same_camera: None,
        }
    }
}

impl Default for ShadowConfig {
    fn default() -> Self {
        Self {
            technique: Technique::ImageBasedShadowing,
            mode: ShadowMode::Ratio,
            strength: 1.0,
            map_size: 512,
            refresh_per_frame: Refresh::All,
            soft: true,
        }
    }
}

impl Default for SyncConfig {
    fn default() -> Self {
        Self {
            scene_camera_latency_nanos: None,
            environment_camera_latency_nanos: None,
            tracker_latency_nanos: None,
            follow_latency: FollowLatency::Report,
            pose_smoothing_nanos: 100_000_000,
            max_prediction_nanos: 50_000_000,
            max_wait_nanos: 20_000_000,
        }
    }
}

impl OutputConfig {
    /// Whether every frame is written to a file, so that outputs can be compared.
    #[must_use]
    pub const fn writes_all(&self) -> bool {
        self.frames.is_some() && !self.as_shown
    }
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self {
            window: true,
            monitor: None,
            fullscreen: false,
            frames: None,
            as_shown: false,
            freed: None,
        }
    }
}

impl Default for StatusConfig {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 8780)),
            token: None,
            stream_quality: 80,
            viewers: 16,
            stream_mbit_per_s: 500,
            guide: None,
        }
    }
}

impl Config {
    /// Reads a configuration file, and registers the dictionaries of markers that it names. Paths in
    /// it are relative to the file's folder.
    ///
    /// # Errors
    /// The file cannot be read, is larger than 4 MiB, is not TOML, or has an unknown key, a former
    /// name or an invalid value, or a dictionary cannot be used; with file, line and key.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text = TomlText::read(path)?;
        Ok(Self::registered(&text, path)?)
    }

    fn registered(text: &TomlText, path: &Path) -> Result<Self, TomlError> {
        let config = convert::config(text, path.parent().unwrap_or(Path::new("")))?;
        registration::register_dictionaries(&config.dictionaries)
            .map_err(|fault| text.locate(fault))?;
        Ok(config)
    }

    /// Parses a configuration; `name` is the file name in messages.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_text(text: &str, name: &str) -> Result<Self, ConfigError> {
        Ok(convert::config(&TomlText::new(name, text), Path::new(""))?)
    }
}

/// The result of `penumbra check-config`.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// The settings that differ from their default: `section.key = value`.
    pub changed: Vec<String>,
    /// All settings with the values in effect, as a configuration. A setting without a value is
    /// absent; a token is hidden.
    pub effective: toml::Table,
    /// All settings.
    pub config: Config,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        if self.changed.is_empty() {
            return write!(f, "all settings at their defaults");
        }
        write!(f, "{}", self.changed.join("\n"))
    }
}

/// Reads a configuration and the scene file that it names, and lists the settings that it changes.
///
/// # Errors
/// The configuration or the scene file cannot be used.
pub fn check_config(path: &Path) -> Result<Summary, ConfigError> {
    let text = TomlText::read(path)?;
    let config = Config::registered(&text, path)?;
    let changed = convert::changed_keys(&text)?;
    if let SceneChoice::File(scene) = &config.scene {
        SceneAddition::load(scene)?;
    }
    let effective = convert::effective(&text)?;
    Ok(Summary {
        changed,
        effective,
        config,
    })
}

#[cfg(test)]
mod tests;
