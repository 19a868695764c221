//! Supervises the devices of a rig and merges their deliveries into one ordered queue.
//!
//! Modules in the order in which data flows:
//!
//! - [`source`] opens a camera or a tracker: a real device (`drivers`), a recording that is
//!   played as a device, or a device of a test.
//! - [`supervisor`] runs one loop per device on the device's own thread: open, stream, wait
//!   after an error ([`backoff`]), open again. Status goes to a [`DeviceMonitor`].
//! - `irregular` corrects and counts deliveries that are repeated, out of order, late, or stamped
//!   with impossible times.
//! - [`hub`] merges all deliveries into one ordered queue and hands them to the rig, to the
//!   recorder ([`RecorderQueue`]) and to a calibration step ([`FrameTap`]).
//! - [`live`] starts all of it for the devices of one rig.
//! - [`sync`] names what the queues wait with; the model checker replaces it.
//!
//! A device thread never waits for the consumers of its data.

pub mod backoff;
mod device;
mod drivers;
pub mod hub;
mod irregular;
pub mod live;
mod monitor;
mod next;
mod recorder_queue;
pub mod source;
pub mod supervisor;
pub mod sync;
pub mod tap;
pub mod time;

pub use device::{Device, DeviceReport};
pub use drivers::list_cameras;
pub use hub::{Delivery, Hub, HubCounts};
pub use irregular::{IrregularCounts, Irregularity};
pub use live::{Capture, Devices, LiveDevice};
pub use monitor::{DeviceMonitor, DeviceState, DeviceStatus};
pub use next::Next;
pub use recorder_queue::{MAX_RECORDER_BYTES, RecorderQueue};
pub use supervisor::{Limits, Sink, Supervisor};
pub use tap::{FrameTap, TapFilter, TapReader};
pub use time::{StoppableClock, StoppableSystemClock};

#[cfg(test)]
mod tests;
