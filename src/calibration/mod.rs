//! What is known of the rig: geometry, response, white point, exposure. Pure estimators
//! and plain data; no I/O, no GPU.

pub mod camera;
pub mod colour;
pub mod exchange;
pub mod fiducial;
pub mod intrinsics;
mod json_node;
pub mod numeric;
pub mod photometry;
pub mod response;
pub mod rig;
pub mod rig_json;

pub use camera::PinholeCamera;
pub use response::Response;
pub use rig::RigCalibration;
pub use rig_json::{EnvironmentSource, RigDocument, RigJsonError};
