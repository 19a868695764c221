//! The bounded queue from the hub to a recorder.

use crate::sync::atomic::{AtomicU64, Ordering};
use crate::sync::channel::{Sender, TrySendError};
use crate::sync::limit;
use penumbra_session::SessionEvent;
use std::sync::Arc;

/// Maximum number of queued bytes.
pub const MAX_RECORDER_BYTES: u64 = limit(256 << 20, 1000) as u64;

/// The sending end of a recorder's queue. Events that do not fit are dropped and counted.
#[derive(Clone, Debug)]
pub struct RecorderQueue {
    events: Sender<SessionEvent>,
    waiting_bytes: Arc<AtomicU64>,
    dropped: Arc<AtomicU64>,
}

impl RecorderQueue {
    /// Creates a queue that sends to `events`. It adds the size of each event to `waiting_bytes`,
    /// from which the recorder subtracts it, and counts dropped events in `dropped`.
    #[must_use]
    pub const fn new(
        events: Sender<SessionEvent>,
        waiting_bytes: Arc<AtomicU64>,
        dropped: Arc<AtomicU64>,
    ) -> Self {
        Self {
            events,
            waiting_bytes,
            dropped,
        }
    }

    /// Sends a copy of `event`, or drops it if the queue is full.
    pub(crate) fn offer(&self, event: &SessionEvent) {
        let size = event.bytes() as u64;
        if self.waiting_bytes.load(Ordering::Relaxed) + size > MAX_RECORDER_BYTES {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.waiting_bytes.fetch_add(size, Ordering::Relaxed);
        if let Err(TrySendError::Full(event) | TrySendError::Disconnected(event)) =
            self.events.try_send(event.clone())
        {
            self.waiting_bytes
                .fetch_sub(event.bytes() as u64, Ordering::Relaxed);
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}
