//! What is known of a rig: `rig.json`, the calibration files beside it, and the scene that they
//! describe.
//!
//! [`RigDocument`] holds everything that the files state; its `calibration` ([`RigCalibration`])
//! is what the rest of the program works with.

mod calibration;
pub mod environment_file;
mod files;
mod header;
pub mod latency_file;
pub mod lens_files;
pub mod lens_record;
pub mod markers_file;
pub mod radiometric_file;
mod rig_json;
pub mod tracker_field;
pub mod tracker_file;

pub use calibration::{
    EnvironmentCamera, RigCalibration, SceneCamera, SphereMarker, TrackerCalibration,
};
pub use files::{Attachments, RigFilesError};
pub use header::{CalibrationFileError, DeviceRecord, Grade, Header, VERSION};
pub use rig_json::{
    EnvironmentSource, Marker, ObjectPlacement, PhantomPlacement, RigDocument, RigJsonError,
};
