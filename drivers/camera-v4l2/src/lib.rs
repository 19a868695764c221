//! Cameras through the Linux kernel's V4L2 interface.
//!
//! [`list_cameras`] lists the cameras and what they can do; [`open`] starts one.
//!
//! ```no_run
//! use penumbra_camera_v4l2::{CameraSettings, open};
//! use penumbra_interface::SystemClock;
//! use std::{sync::Arc, time::Duration};
//!
//! let settings = CameraSettings {
//!     device: "usb:046d:0825".into(),
//!     controls: vec![("auto_exposure".into(), 1), ("exposure_time_absolute".into(), 100)],
//!     ..CameraSettings::default()
//! };
//! let mut camera = open(&settings, Arc::new(SystemClock))?;
//! if let Some(frame) = camera.next_frame(Duration::from_secs(1))? {
//!     println!("{}×{} at {:?}", frame.width, frame.height, frame.captured_at);
//! }
//! # Ok::<(), penumbra_interface::DeviceError>(())
//! ```
//!
//! `kernel` is the only module that talks to the kernel. Everything else works on the plain
//! types and traits of `device` and is tested with a fake device that fails on demand. `stream`
//! is the buffer loop, `controls` locks the camera's controls, `bracketing` cycles exposure
//! times, and `identity` finds a camera by a name that survives unplugging. README.md lists all
//! files. On other systems than Linux this crate is empty.
#![cfg(target_os = "linux")]

mod bracketing;
mod brightness;
mod camera;
mod controls;
mod device;
mod error;
mod fourcc;
mod huffman;
mod identity;
mod jpeg;
mod kernel;
mod list;
mod mode;
mod pool;
mod stream;
#[cfg(test)]
mod testing;
mod timestamps;

pub use camera::open;
pub use identity::name_and_serial;
pub use list::list_cameras;
pub use penumbra_interface::{BracketSettings, CameraInfo, CameraSettings, OnChange};
