//! What is known of a rig: `rig.json`, the calibration files beside it, and the scene that they
//! describe.
//!
//! [`RigDocument`] holds the contents of all files; its `calibration` ([`RigCalibration`]) is used by
//! the rest of the program. Modules in the order of the data flow: `calibration` and
//! `tracker_field` (the types), `rig_json`, the calibration files (`header`, `lens_record`,
//! `lens_files`, `environment_file`, `radiometric_file`, `markers_file`, `tracker_file`,
//! `latency_file`), `files` (all together, and the scene).

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
    rig_json_schema,
};
