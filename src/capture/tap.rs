//! A copy of the devices' deliveries for a consumer beside the rig, e.g. a calibration step. A slow
//! consumer does not delay the rig; it misses pictures.

use crate::next::Next;
use crate::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use crate::sync::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use crate::sync::limit;
use penumbra_session::SessionEvent;
use std::sync::Arc;
use std::time::Duration;

/// Maximum number of queued pictures. While the queue has that many, newer pictures are skipped.
pub const MAX_PICTURES: usize = limit(12, 2);
/// Maximum number of queued events. Apart from pictures these are tracker readings, half a minute
/// of the fastest tracker.
pub const MAX_EVENTS: usize = limit(8192, 4);

/// Which deliveries a tap passes on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TapFilter {
    /// Pictures of the scene camera.
    pub scene: bool,
    /// Pictures of the environment camera, brackets included.
    pub environment: bool,
    /// Readings of the tracker.
    pub poses: bool,
}

#[derive(Debug, Default)]
struct Counts {
    pictures_waiting: AtomicUsize,
    pictures_skipped: AtomicU64,
    readings_lost: AtomicU64,
}

/// The sending end, to which the [`Hub`](crate::Hub) offers every delivery.
#[derive(Debug)]
pub struct FrameTap {
    filter: TapFilter,
    events: Sender<SessionEvent>,
    counts: Arc<Counts>,
}

/// The receiving end.
#[derive(Debug)]
pub struct TapReader {
    events: Receiver<SessionEvent>,
    counts: Arc<Counts>,
}

impl FrameTap {
    /// Creates both ends of a tap.
    #[must_use]
    pub fn new(filter: TapFilter) -> (Self, TapReader) {
        let (sender, receiver) = bounded(MAX_EVENTS);
        let counts = Arc::<Counts>::default();
        let tap = Self {
            filter,
            events: sender,
            counts: Arc::clone(&counts),
        };
        let reader = TapReader {
            events: receiver,
            counts,
        };
        (tap, reader)
    }

    /// Sends a copy of a delivery that the filter accepts. Does not wait: a delivery that does not
    /// fit is dropped and counted.
    pub(crate) fn offer(&self, event: &SessionEvent) {
        match event {
            SessionEvent::Scene(_) if self.filter.scene => self.offer_picture(event),
            SessionEvent::Environment(_) if self.filter.environment => self.offer_picture(event),
            SessionEvent::TrackerBytes { .. } | SessionEvent::Pose(_) if self.filter.poses => {
                self.offer_reading(event);
            }
            _ => (),
        }
    }

    fn offer_reading(&self, event: &SessionEvent) {
        if self.events.try_send(event.clone()).is_err() {
            self.counts.readings_lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn offer_picture(&self, event: &SessionEvent) {
        let waiting = &self.counts.pictures_waiting;
        let fits = waiting.load(Ordering::Relaxed) < MAX_PICTURES;
        // Counted before it is sent: the reader may take it before this call returns.
        waiting.fetch_add(1, Ordering::Relaxed);
        if !fits || self.events.try_send(event.clone()).is_err() {
            waiting.fetch_sub(1, Ordering::Relaxed);
            self.counts.pictures_skipped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl TapReader {
    /// Takes the next event in the order of arrival; waits for it at most for `timeout`.
    #[must_use]
    pub fn next(&self, timeout: Duration) -> Next<SessionEvent> {
        match self.events.recv_timeout(timeout) {
            Ok(event) => {
                if matches!(event, SessionEvent::Scene(_) | SessionEvent::Environment(_)) {
                    self.counts.pictures_waiting.fetch_sub(1, Ordering::Relaxed);
                }
                Next::Item(event)
            }
            Err(RecvTimeoutError::Timeout) => Next::Idle,
            Err(RecvTimeoutError::Disconnected) => Next::Ended,
        }
    }

    /// Returns how many pictures were skipped because the queue was full of pictures.
    #[must_use]
    pub fn pictures_skipped(&self) -> u64 {
        self.counts.pictures_skipped.load(Ordering::Relaxed)
    }

    /// Returns how many tracker readings were dropped.
    #[must_use]
    pub fn readings_lost(&self) -> u64 {
        self.counts.readings_lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Hub;
    use penumbra_interface::{Frame, MonotonicTime, PixelFormat, SystemClock};

    fn frame(millis: i64) -> Frame {
        let at = MonotonicTime::from_nanos(millis * 1_000_000);
        Frame {
            data: vec![0; 4].into(),
            format: PixelFormat::Grey8,
            width: 2,
            height: 2,
            stride: 0,
            sequence: 0,
            captured_at: at,
            arrived_at: at,
            exposure: None,
            bracket_ev: 0.0,
            controls: None,
        }
    }

    fn reading(millis: i64) -> SessionEvent {
        SessionEvent::TrackerBytes {
            protocol: Arc::from("csv"),
            bytes: vec![1].into(),
            arrived_at: MonotonicTime::from_nanos(millis * 1_000_000),
        }
    }

    #[test]
    fn full_tap_skips_pictures_and_keeps_readings() {
        let hub = Hub::new(Arc::new(SystemClock), false);
        let filter = TapFilter {
            scene: true,
            environment: false,
            poses: true,
        };
        let (tap, reader) = FrameTap::new(filter);
        hub.set_tap(Some(tap));
        for i in 0..100 {
            hub.deliver(SessionEvent::Scene(frame(i)));
            hub.deliver(SessionEvent::Environment(frame(i)));
            hub.deliver(reading(i));
        }
        assert_eq!((reader.pictures_skipped(), reader.readings_lost()), (88, 0));
        let (mut pictures, mut readings) = (0, 0);
        while let Next::Item(event) = reader.next(Duration::ZERO) {
            match event {
                SessionEvent::Scene(_) => pictures += 1,
                SessionEvent::TrackerBytes { .. } => readings += 1,
                other => panic!("{other:?} passed the filter"),
            }
        }
        assert_eq!((pictures, readings), (12, 100));
        // The tap accepts pictures again until the hub ends.
        hub.deliver(SessionEvent::Scene(frame(200)));
        hub.end();
        assert!(matches!(reader.next(Duration::ZERO), Next::Item(_)));
        assert!(matches!(reader.next(Duration::ZERO), Next::Ended));
    }

    #[test]
    fn counts_readings_that_do_not_fit() {
        let (tap, reader) = FrameTap::new(TapFilter {
            poses: true,
            ..TapFilter::default()
        });
        for i in 0..MAX_EVENTS as i64 + 7 {
            tap.offer(&reading(i));
        }
        assert_eq!(reader.readings_lost(), 7);
    }
}
