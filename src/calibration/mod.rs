//! What is known of the rig: geometry, response, white point, exposure. Pure estimators
//! and plain data; no I/O, no GPU.

pub mod board_sheet;
pub mod camera;
pub mod colour;
pub mod exchange;
pub mod fiducial;
pub mod hand_eye;
pub mod intrinsics;
mod json_node;
pub mod latency;
pub mod lens_files;
pub mod numeric;
pub mod photometry;
pub mod record;
pub mod response;
pub mod rig;
pub mod rig_json;

pub use camera::PinholeCamera;
pub use response::Response;
pub use rig::RigCalibration;
pub use rig_json::{EnvironmentSource, RigDocument, RigJsonError};
