//! Calibrates a rig: lenses, tone curves, white balance, hand–eye transform, latencies, fiducial
//! maps and the environment camera. Estimators and plain data; no input or output, no GPU.
//!
//! In the order of data flow: [`step`] is the interface of all calibration steps, [`simulation`]
//! renders input for them, [`board_sheet`] and [`webcam_sheet`] lay out a [`sheet`] to print. [`intrinsics`] calibrates lenses,
//! [`radiometric`] tone curves and gains, [`tag_map`] the fiducials' relative poses, [`latency`]
//! and [`hand_eye`] the tracker (steps in [`hand_eye_calibration`]), and
//! [`environment_camera_calibration`] the environment camera. [`verify`] checks a calibrated rig,
//! [`formats`] reads and writes other programs' files, [`report`] builds the HTML reports.

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
pub mod sheet;
pub mod simulation;
pub mod step;
mod summary;
pub mod tag_map;
pub mod verify;
pub mod webcam_sheet;
