//! A camera and a tracker that play what was recorded, at its pace, as if they were there.
//!
//! Several of them share one [`Timeline`], so that what was recorded together comes
//! together again. At its end the recording begins anew. A device that is opened later, or
//! opened again, joins in where the others are: what came before is lost to it, as it is
//! with a real device.
//!
//! Nothing here reads files: whoever opens a device brings an iterator over what was
//! recorded.

mod playback;
mod timeline;

pub use playback::{Items, Recorded, ReplayCamera, ReplayTracker};
pub use timeline::Timeline;
