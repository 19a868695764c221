//! What is known of the rig: geometry, response, white point, exposure. Pure estimators
//! and plain data; no I/O, no GPU.

pub mod board_sheet;
pub mod exchange;
pub mod hand_eye;
pub mod intrinsics;
pub mod latency;
pub mod photometric;
pub mod rehearsal;
pub mod report;
pub mod step;
pub mod surround;
pub mod tag_map;
pub mod tracked;
pub mod verify;

pub use penumbra_camera::PinholeCamera;
pub use penumbra_camera::Response;
pub use penumbra_camera::RollingShutter;
pub use penumbra_rig_model::RigCalibration;
pub use penumbra_rig_model::{Attachments, RigFilesError};
pub use penumbra_rig_model::{EnvironmentSource, RigDocument, RigJsonError};
