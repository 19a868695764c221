//! One supervision loop per device: open, stream, back off, open again.
//!
//! A device that blocks has a thread of its own. [`supervise`] is its loop, the same for
//! every device and every way of opening one ([`source`]); what it finds stands on a
//! [`Board`] that the status reads. What devices deliver meets in the [`Hub`], which gives
//! everything its place in one order and hands it to the rig and to the recorder. Nothing
//! here ever waits for either of them.

pub mod backoff;
pub mod board;
mod drivers;
pub mod hub;
mod live;
pub mod source;
pub mod supervisor;
pub mod tap;
pub mod time;

pub use board::{Board, Condition, DeviceState};
pub use drivers::list_cameras;
pub use hub::{Hub, HubCounts, Taken};
pub use live::{Capture, Devices, LiveDevice};
pub use penumbra_config::{CameraSource, TrackerSource};
pub use supervisor::{Account, Device, Limits, Sink, supervise};
pub use time::{LiveTime, Timekeeper};

#[cfg(test)]
mod tests;
