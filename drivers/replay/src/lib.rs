//! A camera and a tracker that play recordings at their original pace.
//!
//! The devices of one recording share a [`Timeline`], so that they stay synchronous. At its end
//! the recording starts again. A device that is opened later, or opened again, starts at the
//! present position of the others; it misses what came before, like a real device.
//!
//! Nothing here reads files: a device is given an iterator over its recording.

mod devices;
mod playback;
mod timeline;

pub use devices::{ReplayCamera, ReplayTracker};
pub use playback::{Items, Recorded};
pub use timeline::Timeline;
