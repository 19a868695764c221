//! A way for somebody who looks on: what devices deliver goes there too, and nobody waits.

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use penumbra_session::SessionEvent;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

/// Pictures that may wait. Whoever is slower sees fewer of them, not older ones.
const PICTURES_WAITING: usize = 12;
/// Everything that may wait; but for the pictures these are readings of the tracker, half a
/// minute of the quickest.
const WAITING: usize = 8192;

/// What is let through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Pictures of the scene camera.
    pub scene: bool,
    /// Pictures of the environment camera, brackets included.
    pub environment: bool,
    /// What the tracker reads.
    pub poses: bool,
}

#[derive(Debug, Default)]
struct Counts {
    pictures_waiting: AtomicUsize,
    passed_over: AtomicU64,
    readings_lost: AtomicU64,
}

/// The end that the [`Hub`](super::Hub) offers everything to.
#[derive(Debug)]
pub struct Tap {
    wanted: Wanted,
    events: Sender<SessionEvent>,
    counts: Arc<Counts>,
}

/// The end that is looked at.
#[derive(Debug)]
pub struct TapEnd {
    events: Receiver<SessionEvent>,
    counts: Arc<Counts>,
}

/// What [`TapEnd::next`] gives.
#[derive(Debug)]
pub enum Tapped {
    /// Something was delivered.
    Event(SessionEvent),
    /// Nothing for so long.
    Nothing,
    /// Nothing will come any more.
    Ended,
}

impl Tap {
    /// A tap with its two ends.
    #[must_use]
    pub fn new(wanted: Wanted) -> (Self, TapEnd) {
        let (sender, receiver) = bounded(WAITING);
        let counts = Arc::<Counts>::default();
        let tap = Self {
            wanted,
            events: sender,
            counts: Arc::clone(&counts),
        };
        let end = TapEnd {
            events: receiver,
            counts,
        };
        (tap, end)
    }

    /// Something was delivered. Never waits: pictures are passed over where enough wait.
    pub(super) fn offer(&self, event: &SessionEvent) {
        match event {
            SessionEvent::Scene(_) if self.wanted.scene => self.offer_picture(event),
            SessionEvent::Environment(_) if self.wanted.environment => self.offer_picture(event),
            SessionEvent::TrackerBytes { .. } | SessionEvent::Pose(_) if self.wanted.poses => {
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
        let fits = waiting.load(Ordering::Relaxed) < PICTURES_WAITING;
        // Counted first: it may be taken before this call returns.
        waiting.fetch_add(1, Ordering::Relaxed);
        if !fits || self.events.try_send(event.clone()).is_err() {
            waiting.fetch_sub(1, Ordering::Relaxed);
            self.counts.passed_over.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl TapEnd {
    /// The next in the order of arrival; waits for it, but not longer than `patience`.
    #[must_use]
    pub fn next(&self, patience: Duration) -> Tapped {
        match self.events.recv_timeout(patience) {
            Ok(event) => {
                if matches!(event, SessionEvent::Scene(_) | SessionEvent::Environment(_)) {
                    self.counts.pictures_waiting.fetch_sub(1, Ordering::Relaxed);
                }
                Tapped::Event(event)
            }
            Err(RecvTimeoutError::Timeout) => Tapped::Nothing,
            Err(RecvTimeoutError::Disconnected) => Tapped::Ended,
        }
    }

    /// Pictures that found enough others waiting.
    #[must_use]
    pub fn passed_over(&self) -> u64 {
        self.counts.passed_over.load(Ordering::Relaxed)
    }

    /// Readings of the tracker that found no room.
    #[must_use]
    pub fn readings_lost(&self) -> u64 {
        self.counts.readings_lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
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
    fn a_busy_onlooker_misses_pictures_but_no_readings_and_holds_nobody_up() {
        let hub = Hub::new(Arc::new(SystemClock), false);
        let wanted = Wanted {
            scene: true,
            environment: false,
            poses: true,
        };
        let (tap, end) = Tap::new(wanted);
        hub.set_tap(Some(tap));
        for i in 0..100 {
            hub.deliver(SessionEvent::Scene(frame(i)));
            hub.deliver(SessionEvent::Environment(frame(i)));
            hub.deliver(reading(i));
        }
        assert_eq!((end.passed_over(), end.readings_lost()), (88, 0));
        let (mut pictures, mut readings) = (0, 0);
        while let Tapped::Event(event) = end.next(Duration::ZERO) {
            match event {
                SessionEvent::Scene(_) => pictures += 1,
                SessionEvent::TrackerBytes { .. } => readings += 1,
                other => panic!("{other:?} was not asked for"),
            }
        }
        assert_eq!((pictures, readings), (12, 100));
        // There is room again, until the devices are gone.
        hub.deliver(SessionEvent::Scene(frame(200)));
        hub.end();
        assert!(matches!(end.next(Duration::ZERO), Tapped::Event(_)));
        assert!(matches!(end.next(Duration::ZERO), Tapped::Ended));
    }

    #[test]
    fn readings_beyond_all_room_are_counted() {
        let (tap, end) = Tap::new(Wanted {
            poses: true,
            ..Wanted::default()
        });
        for i in 0..WAITING as i64 + 7 {
            tap.offer(&reading(i));
        }
        assert_eq!(end.readings_lost(), 7);
    }
}
