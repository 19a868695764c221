//! The notes of a live rig about its frames: written into a recording, followed by a replay.

use crate::source::Source;
use penumbra_capture::Hub;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_session::{LightRecord, SessionEvent};
use std::sync::Arc;

/// What the recording of a live rig says about a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JournalEntry {
    /// Nothing: no rig has composed the picture before.
    None,
    /// The rig skipped the picture, and its light estimate has not used it.
    Skipped,
    /// The picture was composed. `None` in older recordings, which do not name the light.
    Composed(Option<LightRecord>),
}

/// Writes the notes of a live rig; a replay has no journal to write.
pub(crate) struct Journal(Option<Arc<Hub>>);

impl Journal {
    /// Creates the journal of a run from `source`.
    pub fn new(source: &Source) -> Self {
        match source {
            Source::Live(live) => Self(Some(Arc::clone(&live.hub))),
            Source::Recorded(_) => Self(None),
        }
    }

    /// Notes that the picture which arrived at `arrived_at` is composed, and in which light.
    pub fn write(&self, arrived_at: MonotonicTime, light: LightRecord) {
        if let Some(hub) = &self.0 {
            hub.journal(&SessionEvent::Prepared {
                at: SystemClock.now(),
                arrived_at,
                light: Some(light),
            });
        }
    }
}
