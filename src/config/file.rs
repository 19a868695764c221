//! The sections of the configuration file; every key is optional. `config/rig.toml` documents them.

use super::choice::{
    Antialias, Clipped, FollowLatency, LightPlaces, Monitor, Quality, Refresh, ReplayPairing,
    ReplaySpeed, Technique, ToneCurve, Unseen,
};
use super::devices::{
    CalibrationFile, CameraFile, ControlChange, ControlValue, FormatName, RecordingFile,
    TrackerFile,
};
use super::exposure::ExposureFile;
use super::look::LookFile;
use super::planes::PlanesFile;
use super::registration::RegistrationFile;
use penumbra_lighting::{Filtering, IrradianceMethod, LightPlacement};
use penumbra_picture::{YuvMatrix, YuvRange};
use penumbra_rig_model::EnvironmentSource;
use penumbra_scene::{LampResponse, ShadowMode};
use penumbra_white_balance::WhiteBalanceMethod;
use serde::Deserialize;
use std::collections::BTreeMap;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ConfigFile {
    pub scene: Scene,
    pub scene_camera: SceneCamera,
    pub environment_camera: CameraFile,
    pub tracker: TrackerFile,
    pub calibration: CalibrationFile,
    pub recording: RecordingFile,
    pub environment: Environment,
    pub room_light: Vec<RoomLight>,
    pub registration: RegistrationFile,
    pub white_balance: WhiteBalance,
    pub shadows: Shadows,
    pub shading: Shading,
    pub planes: PlanesFile,
    pub exposure: ExposureFile,
    pub picture: Picture,
    pub look: LookFile,
    pub sync: Sync,
    pub input: Input,
    pub output: Output,
    pub status: Status,
    pub gpu: Gpu,
    pub replay: Replay,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Scene {
    pub file: Option<String>,
    pub folder: Option<String>,
    pub max_upload_mb: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SceneCamera {
    pub response: Option<ToneCurve>,
    pub device: Option<String>,
    pub width: Option<u32>,
    pub height: Option<u32>,
    pub frames_per_second: Option<f64>,
    pub formats: Option<Vec<FormatName>>,
    pub buffers: Option<u32>,
    pub gain_per_unit: Option<f64>,
    pub on_control_change: Option<ControlChange>,
    pub silent_after_ms: Option<f64>,
    pub controls: Option<BTreeMap<String, ControlValue>>,
}

impl SceneCamera {
    /// Returns the settings that both cameras have.
    pub fn camera(self) -> CameraFile {
        CameraFile {
            device: Some(self.device.unwrap_or_else(|| "auto".to_owned())),
            width: self.width,
            height: self.height,
            frames_per_second: self.frames_per_second,
            formats: self.formats,
            buffers: self.buffers,
            gain_per_unit: self.gain_per_unit,
            on_control_change: self.on_control_change,
            silent_after_ms: self.silent_after_ms,
            controls: self.controls,
            ..CameraFile::default()
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Environment {
    pub source: Option<EnvironmentSource>,
    pub map: Option<String>,
    pub map_yaw_deg: Option<f64>,
    pub map_ev: Option<f64>,
    pub response: Option<ToneCurve>,
    pub brackets_ev: Option<Vec<f64>>,
    pub cube_size: Option<u32>,
    pub light_placement: Option<LightPlacement>,
    pub light_count: Option<u32>,
    pub clipped: Option<Clipped>,
    pub irradiance: Option<IrradianceMethod>,
    pub unseen: Option<Unseen>,
    pub stale_after_ms: Option<f64>,
    pub light_places: Option<LightPlaces>,
}

/// A lamp or a window whose place is known.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RoomLight {
    pub position: Option<[f64; 3]>,
    pub corners: Option<[[f64; 3]; 4]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct WhiteBalance {
    pub method: Option<WhiteBalanceMethod>,
    pub gains: Option<[f64; 3]>,
    pub matrix: Option<bool>,
    pub same_camera: Option<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Shadows {
    pub technique: Option<Technique>,
    pub mode: Option<ShadowMode>,
    pub strength: Option<f64>,
    pub map_size: Option<u32>,
    pub refresh_per_frame: Option<Refresh>,
    pub soft: Option<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Shading {
    pub reflections: Option<Filtering>,
    pub indirect_light: Option<bool>,
    pub lamp_response: Option<LampResponse>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Picture {
    pub quality: Option<Quality>,
    pub antialias: Option<Antialias>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Sync {
    pub scene_camera_latency_ms: Option<f64>,
    pub environment_camera_latency_ms: Option<f64>,
    pub tracker_latency_ms: Option<f64>,
    pub follow_latency: Option<FollowLatency>,
    pub pose_smoothing_ms: Option<f64>,
    pub max_prediction_ms: Option<f64>,
    pub max_wait_ms: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Input {
    pub yuv_matrix: Option<YuvMatrix>,
    pub yuv_range: Option<YuvRange>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Output {
    pub window: Option<bool>,
    pub monitor: Option<Monitor>,
    pub fullscreen: Option<bool>,
    pub frames: Option<String>,
    pub freed: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Status {
    pub listen: Option<String>,
    pub token: Option<String>,
    pub stream_quality: Option<u32>,
    pub viewers: Option<u32>,
    pub stream_mbit_per_s: Option<u32>,
    pub guide: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Gpu {
    pub adapter: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Replay {
    pub speed: Option<ReplaySpeed>,
    #[serde(rename = "loop")]
    pub repeat: Option<bool>,
    pub pairing: Option<ReplayPairing>,
}
