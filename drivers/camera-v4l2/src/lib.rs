//! Cameras through the Linux kernel's V4L2 interface.
//!
//! [`list_cameras`] says which cameras there are and what they can do; [`open`] starts one.
//! `kernel` is the only module that talks to the kernel; everything else works on the plain
//! types of `video` and is tested against a camera that fails on purpose. `stream` is the
//! buffer loop, `contract` keeps the controls as the settings want them, `bracket` cycles
//! exposures, `identity` finds a camera by a name that survives replugging.
//!
//! On systems without V4L2 this crate is empty.
#![cfg(target_os = "linux")]

mod bracket;
mod brightness;
mod camera;
mod contract;
mod fourcc;
mod huffman;
mod identity;
mod jpeg;
mod kernel;
mod list;
mod mode;
mod pool;
mod stamps;
mod stream;
#[cfg(test)]
mod testing;
mod trouble;
mod video;

pub use camera::open;
pub use identity::name_and_serial;
pub use list::list_cameras;
pub use penumbra_interface::{BracketSettings, CameraInfo, CameraSettings, OnChange};
