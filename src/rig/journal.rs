//! The journal of a live rig about its frames, which is part of the recording. A replay follows it.

use crate::source::Source;
use penumbra_capture::Hub;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_session::{LightRecord, SessionEvent};
use std::sync::Arc;

/// The journal's entry for a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JournalEntry {
    /// No entry: no rig has composed the picture before.
    None,
    /// The rig skipped the picture, and its light estimate did not use it.
    Skipped,
    /// The picture was composed in this light; `None` in older recordings, which do not record it.
    Composed(Option<LightRecord>),
}

/// Writes the journal of a live rig; a replay writes none.
pub(crate) struct Journal(Option<Arc<Hub>>);

impl Journal {
    /// Creates the journal of a run from `source`.
    pub fn new(source: &Source) -> Self {
        match source {
            Source::Live(live) => Self(Some(Arc::clone(&live.hub))),
            Source::Recorded(_) => Self(None),
        }
    }

    /// Records that the picture that arrived at `arrived_at` is composed in `light`.
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
