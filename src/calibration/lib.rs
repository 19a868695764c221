//! What is known of the rig: geometry, response, white point, exposure. Pure estimators
//! and plain data; no I/O, no GPU.

mod base64;
pub mod board_sheet;
pub mod environment_camera_calibration;
pub mod formats;
pub mod hand_eye;
pub mod hand_eye_calibration;
pub mod intrinsics;
pub mod latency;
pub mod radiometric;
pub mod report;
pub mod simulation;
pub mod step;
pub mod tag_map;
pub mod verify;
