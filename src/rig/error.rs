//! The errors of a run, each a one-line message for the user.

use penumbra_compositor::GpuError;
use penumbra_config::ConfigError;
use penumbra_lighting::EnvironmentError;
use penumbra_output::OutputError;
use penumbra_picture::PictureError;
use penumbra_rig_model::RigFilesError;
use penumbra_scene::SceneError;
use penumbra_session::SessionError;
use penumbra_session::import::ImportError;
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
    /// The tracker's configured unit differs from that of its calibration.
    #[error(
        "tracker.units: {configured:?}, but the calibration uses a unit of {metres} m; remove `units`, \
         or recalibrate"
    )]
    Units {
        /// The configured unit.
        configured: penumbra_config::TrackerUnits,
        /// The unit of the calibration, metres.
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
