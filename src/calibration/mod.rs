//! What is known of the rig: geometry, response, white point, exposure. Pure estimators
//! and plain data; no I/O, no GPU.

pub mod board_sheet;
pub mod environment_file;
pub mod exchange;
pub mod fusion;
pub mod hand_eye;
pub mod head;
pub mod intrinsics;
mod json_node;
pub mod latency;
pub mod latency_file;
pub mod lens_files;
pub mod markers_file;
pub mod photometric;
pub mod photometric_file;
pub mod record;
pub mod rehearsal;
pub mod report;
pub mod rig;
pub mod rig_json;
pub mod rig_scene;
pub mod step;
pub mod surround;
pub mod tag_map;
pub mod tracked;
pub mod tracker_file;
pub mod verify;

pub use penumbra_camera::PinholeCamera;
pub use penumbra_camera::Response;
pub use penumbra_camera::RollingShutter;
pub use rig::RigCalibration;
pub use rig_json::{EnvironmentSource, RigDocument, RigJsonError};
pub use rig_scene::{Attachments, RigFilesError};
