//! Cameras through the Linux kernel's V4L2 interface.
//!
//! [`list_cameras`] says which cameras there are and what they can do; [`open`] starts one.
//! `kernel` is the only module that talks to the kernel; everything else works on the plain
//! types of `video` and is tested against a camera that fails on purpose. `stream` is the
//! buffer loop, `contract` keeps the controls as the settings want them, `bracket` cycles
//! exposures, `identity` finds a camera by a name that survives replugging.
//!
//! The kernel's structures are declared here instead of taken from the crates `v4l` or
//! `v4l2r`: those need libclang on every machine that builds Penumbra, and `v4l`'s stream
//! loses its place after a time-out. On systems without V4L2 this crate is empty.
#![cfg(target_os = "linux")]

#[cfg(not(target_pointer_width = "64"))]
compile_error!("the kernel's structures are declared for 64-bit machines only");

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
