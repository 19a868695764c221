//! Cameras on systems without V4L2, through the crate `nokhwa` (AVFoundation on macOS, Media
//! Foundation on Windows, V4L2 on Linux for trying it out).
//!
//! It does less than the V4L2 driver, and [`CameraReport::notes`](
//! penumbra_interface::CameraReport) says so: no frame counter (lost frames go unnoticed),
//! stamps of the wall clock or none, automatic modes cannot be switched, nobody sees another
//! program's changes, no bracketing.
//!
//! `nokhwa` waits for frames without a limit and its camera stays in one thread, so it gets
//! a thread of its own that leaves the newest frame where `next_frame` finds it.
#![cfg(feature = "nokhwa")]

mod camera;
mod controls;
mod format;
mod slot;
mod worker;

pub use camera::{list_cameras, open};
