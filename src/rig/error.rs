//! The errors of a run, each a one-line message for the user.

use penumbra_compositor::GpuError;
use penumbra_config::ConfigError;
use penumbra_lighting::{EnvironmentError, EnvironmentMapError};
use penumbra_output::OutputError;
use penumbra_picture::PictureError;
use penumbra_rig_model::RigFilesError;
use penumbra_scene::SceneError;
use penumbra_session::SessionError;
use penumbra_session::import::ImportError;
use std::path::PathBuf;
use thiserror::Error;

/// An error that prevents a rig from starting or ends a run.
#[derive(Debug, Error)]
pub enum RigError {
    /// A session cannot be read or written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The folder of the rig's files cannot be read.
    #[error(transparent)]
    Files(#[from] ImportError),
    /// A file of the rig is invalid.
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
    /// The pictures to calibrate from cannot be read.
    #[error("{path}: {reason}; name a folder with JPEG or PNG pictures", path = path.display())]
    Pictures {
        /// The folder, or a file in it.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// A calibration step cannot start.
    #[error(transparent)]
    Calibration {
        /// The reason.
        refusal: penumbra_status::calibration::CalibrationRefusal,
    },
    /// There is no folder to which a calibration can be written.
    #[error(
        "{reason}, so the calibration cannot be saved; set [calibration] from = \"FOLDER\" to the \
         folder of the rig's files"
    )]
    NoCalibrationFolder {
        /// The reason.
        reason: String,
    },
    /// A scene, object or phantom file is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The configuration is invalid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The graphics device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A window or an output file failed.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Shadowing planes cannot be generated.
    #[error(transparent)]
    Planes(#[from] penumbra_scene::planes::PlaneError),
    /// The configured pose source needs markers, and the calibration lists none.
    #[error(
        "registration.pose = \"{wanted}\", but the calibration lists no markers; add `markers` to \
         rig.json, or use \"tracker\""
    )]
    NoMarkers {
        /// The configured pose source.
        wanted: &'static str,
    },
    /// The rig cannot be verified without markers.
    #[error(
        "the rig has no markers to verify it with; print and fix some, and run `penumbra calibrate \
         map`, or list them in rig.json"
    )]
    NoMarkersToVerify,
    /// The list of markers is invalid.
    #[error("rig.json: markers: {reason}")]
    Markers {
        /// The reason, and what to do.
        reason: String,
    },
    /// The file to bake is neither a scene, a model nor a session.
    #[error(
        "{path}: expected a scene file (.toml), a model (.glb, .gltf) or a session (.mcap; without \
         --session)",
        path = path.display()
    )]
    NoScene {
        /// The file.
        path: PathBuf,
    },
    /// The scene to bake has no virtual objects.
    #[error(
        "{path}: has no virtual objects to bake; add an [[object]], or name a model",
        path = path.display()
    )]
    NoVirtualObjects {
        /// The scene.
        path: PathBuf,
    },
    /// The scene to bake has a moving object.
    #[error(
        "{path}: `{part}` moves, and planes are baked for static objects; remove its `keys` and \
         `animation`, or use the light dome, which needs no bake",
        path = path.display()
    )]
    MovingObject {
        /// The scene.
        path: PathBuf,
        /// The moving part.
        part: String,
    },
    /// The light is to come from an environment map, and none is named.
    #[error(
        "the light is to come from an environment map, and the configuration names none; set \
         [environment] map = \"FILE.hdr\""
    )]
    NoMap,
    /// The environment map cannot be used.
    #[error("environment.map: {0}")]
    Map(#[from] EnvironmentMapError),
    /// The environment camera's view is invalid.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// A required picture (of a chart) cannot be decoded.
    #[error("{name}: {source}")]
    Picture {
        /// The attachment or stream.
        name: String,
        /// The reason.
        source: PictureError,
    },
    /// The status server cannot start.
    #[error(transparent)]
    Status(#[from] penumbra_status::StatusError),
    /// The file of poses exists.
    #[error("{path}: exists already; name another file or pass --force", path = path.display())]
    PosesFileExists {
        /// The file.
        path: PathBuf,
    },
    /// The receiver of FreeD poses cannot be reached.
    #[error("output.freed: {receiver}: {source}; name another address")]
    Freed {
        /// The receiver's address.
        receiver: std::net::SocketAddr,
        /// The error of the system.
        source: std::io::Error,
    },
    /// Another recording is running.
    #[error("{path}: is being recorded; stop it first", path = path.display())]
    Recording {
        /// Its file.
        path: PathBuf,
    },
    /// The session has no complete environment picture.
    #[error(
        "{path}: has no complete environment picture to estimate light from",
        path = path.display()
    )]
    NoLight {
        /// The session.
        path: PathBuf,
    },
    /// The report of the light cannot be written.
    #[error(transparent)]
    LightReport(#[from] penumbra_lighting::report::LightReportError),
    /// The system cannot start a thread.
    #[error("cannot start a thread: {source}; end other programs")]
    Thread {
        /// The error of the system.
        source: std::io::Error,
    },
    /// A file or folder that the configuration names cannot be used.
    #[error("`{key}`: {error}")]
    Named {
        /// The key of the configuration.
        key: &'static str,
        /// The reason.
        error: Box<RigError>,
    },
    /// A file is where a folder should be.
    #[error("{path}: is no folder; name another", path = path.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
    },
    /// A recording lacks the stream of a device.
    #[error("{path}: has no {stream}; name another recording", path = path.display())]
    Lacks {
        /// The recording.
        path: PathBuf,
        /// The stream.
        stream: &'static str,
    },
    /// The recording's pictures have another size than its calibration.
    #[error(
        "{path}: its pictures have {pictures} pixels, but its rig.json describes a camera of \
         {calibrated}; attach the rig.json of this camera and mode",
        path = path.display()
    )]
    PictureSize {
        /// The session.
        path: PathBuf,
        /// Width and height of the pictures.
        pictures: String,
        /// Width and height by the calibration.
        calibrated: String,
    },
    /// No picture of the scene camera could be decoded.
    #[error(
        "{path}: all {count} pictures of the scene camera are damaged ({reason}); nothing was \
         composed",
        path = path.display()
    )]
    AllDamaged {
        /// The session.
        path: PathBuf,
        /// Number of pictures.
        count: u64,
        /// What is wrong with the first.
        reason: String,
    },
    /// The session has no scene camera picture.
    #[error("{path}: has no scene camera picture to compose", path = path.display())]
    Empty {
        /// The session.
        path: PathBuf,
    },
}
