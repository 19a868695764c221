//! Wires the stations together and runs them. The only place that spawns threads.
//!
//! [`source`] is a recording or a live rig, [`feed`] pairs what arrives into [`RigFrame`]s, [`light`] turns their
//! environment pictures into light at the scene camera's white point, [`prepare`] does both
//! one frame ahead, [`runner`] lets frames flow through the compositor to the outputs,
//! [`recorder`] writes what arrives into a session meanwhile, [`report`] says afterwards what
//! happened.

pub mod bake;
mod baking;
pub mod calibration_runner;
pub mod display;
pub mod feed;
mod latency_status;
mod latency_watch;
pub mod light;
pub mod light_report;
mod lighter;
mod lights;
mod live_status;
mod near_light;
mod notify;
mod pace;
mod planes;
mod poses;
pub mod prepare;
mod probe_status;
mod rates;
pub mod recorder;
mod registration;
mod reload;
pub mod report;
mod run;
pub mod runner;
mod scene_light;
mod scenes;
pub mod service;
mod settings;
pub mod simulate;
pub mod source;
pub mod status;
pub mod wall_date;
mod watch;

pub use penumbra_output::Screen;
pub use recorder::Recorder;
pub use report::Report;
pub use runner::{RunOptions, Runner};
pub use settings::live_settings;
pub use source::{Live, RigFiles, Source};

use penumbra_compositor::GpuError;
use penumbra_config::{Config, ConfigError, PoseSource};
use penumbra_fiducials::TagMap;
use penumbra_interface::RigidTransform;
use penumbra_lighting::EnvironmentError;
use penumbra_output::OutputError;
use penumbra_picture::PictureError;
use penumbra_rig_model::lens_files::SCENE_LENS;
use penumbra_rig_model::{RigCalibration, RigDocument, RigFilesError};
use penumbra_scene::{Scene, SceneError};
use penumbra_session::SessionError;
use penumbra_session::import::ImportError;
use penumbra_sync::{PoseAt, RigFrame};
use std::path::PathBuf;
use thiserror::Error;

/// The rig cannot start or go on. Each text is the one line that the user gets.
#[derive(Debug, Error)]
pub enum RigError {
    /// The recording.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The folder with the rig's files.
    #[error(transparent)]
    Files(#[from] ImportError),
    /// What is known of the rig cannot be used.
    #[error(transparent)]
    RigFiles(#[from] RigFilesError),
    /// The tracker would be told another unit than it was calibrated in.
    #[error(
        "tracker.units: {told:?}, but by the calibration a unit is {metres} m; remove `units`, or \
         calibrate anew"
    )]
    Units {
        /// What the configuration says.
        told: penumbra_config::TrackerUnits,
        /// What the calibration says, metres.
        metres: f64,
    },
    /// Pictures to calibrate from.
    #[error("{path}: {reason}; name a folder with JPEG or PNG pictures", path = path.display())]
    Pictures {
        /// The folder, or a file in it.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A step of calibration that cannot be begun.
    #[error(transparent)]
    Calibration {
        /// Why.
        refusal: penumbra_status::calibration::CalibrationRefusal,
    },
    /// A calibration has no place among the rig's files.
    #[error(
        "{reason}, so a calibration has no place; set [calibration] from = \"FOLDER\" to a folder \
         of the rig's files"
    )]
    NoCalibrationFolder {
        /// What is there instead.
        reason: String,
    },
    /// Calibration, objects, phantoms.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The graphics device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A window or a folder of frames.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Shadowing planes.
    #[error(transparent)]
    Planes(#[from] penumbra_scene::planes::PlaneError),
    /// The pose is to come from markers that nobody told of.
    #[error(
        "registration.pose = \"{wanted}\", but the calibration lists no markers; add `markers` to \
         rig.json, or use \"tracker\""
    )]
    NoMarkers {
        /// What the configuration says.
        wanted: &'static str,
    },
    /// A check without markers.
    #[error(
        "the rig has no markers to check it by; print some, fix them, and run `penumbra calibrate map`, or \
         list them in rig.json"
    )]
    NothingToCheckBy,
    /// Markers that cannot be found.
    #[error("rig.json: markers: {reason}")]
    Markers {
        /// What is wrong with them, and what to do.
        reason: String,
    },
    /// Neither a scene nor something that brings one.
    #[error(
        "{path}: expected a scene file (.toml), a model (.glb, .gltf) or a session (.mcap; without \
         --session)",
        path = path.display()
    )]
    NoScene {
        /// What was named.
        path: PathBuf,
    },
    /// A scene without objects.
    #[error(
        "{path}: holds nothing virtual, so there is nothing to bake; add an [[object]], or name a \
         model",
        path = path.display()
    )]
    NothingVirtual {
        /// The scene.
        path: PathBuf,
    },
    /// A bake of what does not stand still.
    #[error(
        "{path}: `{part}` moves, and planes are baked for what stands still; take its `keys` and \
         `animation` away, or use the light dome, which needs no bake",
        path = path.display()
    )]
    Moves {
        /// The scene.
        path: PathBuf,
        /// A part that moves.
        part: String,
    },
    /// The view of the environment.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A picture that must be readable (the chart) is not.
    #[error("{name}: {source}")]
    Picture {
        /// Attachment or stream.
        name: String,
        /// Why.
        source: PictureError,
    },
    /// The status endpoint.
    #[error(transparent)]
    Status(#[from] penumbra_status::StatusError),
    /// The poses' file is there already.
    #[error("{path}: is there already; name another file or pass --force", path = path.display())]
    PosesThere {
        /// The file.
        path: PathBuf,
    },
    /// The poses' receiver cannot be reached.
    #[error("output.freed: {receiver}: {source}; name another address")]
    Freed {
        /// Who should be told.
        receiver: std::net::SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
    /// One recording at a time.
    #[error("{path}: is being recorded; end that first", path = path.display())]
    Recording {
        /// Which.
        path: PathBuf,
    },
    /// The session shows no light.
    #[error("{path}: no complete picture of the environment in it; there is no light to tell of", path = path.display())]
    NoLight {
        /// The session.
        path: PathBuf,
    },
    /// The light could not be told of.
    #[error(transparent)]
    LightReport(#[from] penumbra_lighting::report::LightReportError),
    /// The system has no more threads.
    #[error("no thread to be had: {source}; end other programs")]
    Thread {
        /// What the system said.
        source: std::io::Error,
    },
    /// The session has no frame of the scene camera.
    #[error("{path}: no picture of the scene camera in it; nothing to compose", path = path.display())]
    Empty {
        /// The session.
        path: PathBuf,
    },
}

/// What a session and a configuration say about the rig, made true.
#[derive(Clone)]
pub struct RigSetup {
    /// Calibration with the configuration's overrides.
    pub calibration: RigCalibration,
    /// What is drawn.
    pub scene: Scene,
    /// What tells the scene camera's pose; never [`PoseSource::Auto`].
    pub pose: PoseSource,
    /// Fiducials by which it is found, instead of a tracker or beside one.
    pub tags: Option<TagMap>,
    /// Somebody has calibrated the rig.
    pub calibrated: bool,
}

impl RigSetup {
    /// Reads calibration and scene from `source` and `config`.
    ///
    /// # Errors
    /// A missing or broken calibration, object or scene file.
    pub fn read(source: &Source, config: &Config) -> Result<Self, RigError> {
        let attachments = |name: &str| source.attachment(name);
        let mut document = source.document(config)?;
        let camera_recorded = source.has_environment();
        document
            .select_environment(config.environment.source, camera_recorded)
            .map_err(RigFilesError::from)?;
        let scene = document.chosen_scene(&config.scene, &attachments)?;
        let mut calibration = calibration(&document, config);
        let tracker = calibration.tracker.is_some();
        let pose = registration::pose_source(&document.markers, tracker, config)?;
        let tags = registration::wanted_tags(&document.markers, pose)?;
        if pose == PoseSource::Markers {
            // Nothing waits for a tracker that nobody asks.
            calibration.tracker = None;
        }
        Ok(Self {
            calibration,
            pose,
            tags,
            calibrated: ["rig.json", SCENE_LENS]
                .iter()
                .any(|file| source.attachment(file).is_some()),
            scene,
        })
    }

    /// The scene camera's pose for a paired frame, if the sensor's is known.
    #[must_use]
    pub fn world_from_camera(&self, frame: &RigFrame) -> Option<RigidTransform> {
        if self.pose == PoseSource::Markers {
            return None;
        }
        Some(self.camera_of(frame.pose.as_ref()?.transmitter_from_sensor))
    }

    /// The scene camera's pose, the tracker's sensor being there.
    pub(crate) fn camera_of(&self, transmitter_from_sensor: RigidTransform) -> RigidTransform {
        let tracker = self.calibration.tracker.as_ref();
        let sensor = transmitter_from_sensor;
        tracker.map_or(sensor, |t| t.world_from_scene_camera(sensor))
    }
}

/// Noise of a pose by a tracker that tells none: metres, radians.
const TRACKER_NOISE: [f64; 2] = [2e-4, 3e-4];

impl RigSetup {
    /// Standard deviations, along an axis, of the noise of the scene camera's pose by the
    /// tracker: metres, radians.
    pub(crate) fn tracker_noise(&self, frame: &RigFrame) -> Option<[f64; 2]> {
        let over_all = self.camera_noise(frame.pose.as_ref()?)?;
        Some(over_all.map(|all| all / 3.0_f64.sqrt()))
    }

    /// Standard deviations over all axes of the scene camera's pose by one of the tracker:
    /// metres, radians. The camera stands off the sensor, so that the sensor's turn moves it.
    pub(crate) fn camera_noise(&self, pose: &PoseAt) -> Option<[f64; 2]> {
        let [metres, radians] = pose.sigma?;
        let tracker = self.calibration.tracker.as_ref();
        let lever = tracker.map_or(0.0, |t| t.sensor_from_scene_camera.translation.length());
        Some([metres.hypot(radians * lever), radians])
    }
}

/// The session's calibration with what the configuration overrides.
fn calibration(document: &RigDocument, config: &Config) -> RigCalibration {
    let mut rig = document.calibration.clone();
    if let Some(curve) = &config.scene_camera.response {
        rig.scene_camera.response = curve.response();
    }
    if let Some(latency) = config.sync.scene_camera_latency_nanos {
        rig.scene_camera.latency_nanos = latency;
    }
    if let (Some(tracker), Some(latency)) = (&mut rig.tracker, config.sync.tracker_latency_nanos) {
        tracker.latency_nanos = latency;
    }
    if let Some(environment) = &mut rig.environment {
        if let Some(curve) = &config.environment.response {
            environment.response = curve.response();
        }
        if let Some(brackets) = &config.environment.brackets_ev {
            environment.brackets_ev.clone_from(brackets);
        }
        if let Some(latency) = config.sync.environment_camera_latency_nanos {
            environment.latency_nanos = latency;
        }
    }
    rig
}
