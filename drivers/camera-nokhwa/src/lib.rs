//! Cameras on systems without V4L2, through the crate `nokhwa` (AVFoundation on macOS, Media
//! Foundation on Windows, V4L2 on Linux for trying it out).
//!
//! It does less than the V4L2 driver, and reports this in [`CameraReport::notes`](
//! penumbra_interface::CameraReport): no frame counter (lost frames are not noticed), time stamps
//! of the wall clock or none, no switching of automatic modes, no detection of changes by other
//! programs, no bracketing.
//!
//! `nokhwa` waits for frames without a time limit, and its camera cannot change threads. So it
//! runs on its own thread, which stores the newest frame for `next_frame`.
#![cfg(feature = "nokhwa")]

mod camera;
mod controls;
mod format;
mod slot;
mod worker;

pub use camera::{list_cameras, open};
