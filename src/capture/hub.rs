//! One ordered queue for the deliveries of all devices.

use crate::next::Next;
use crate::recorder_queue::RecorderQueue;
use crate::sync::{Condvar, Mutex, MutexGuard, limit};
use crate::tap::FrameTap;
use penumbra_interface::{Clock, MonotonicTime};
use penumbra_session::SessionEvent;
use std::collections::VecDeque;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

/// Maximum number of queued scene camera pictures. Beyond it the oldest is superseded, because the
/// rig must show the present.
pub const MAX_SCENE_PICTURES: usize = limit(4, 2);
/// Maximum number of queued environment camera pictures, including brackets.
pub const MAX_ENVIRONMENT_PICTURES: usize = limit(24, 2);
/// Maximum number of queued tracker readings: half a minute of the fastest tracker.
pub const MAX_TRACKER_READINGS: usize = limit(4096, 3);
/// Maximum number of superseded pictures of which the arrival is kept: two minutes of a consumer that
/// takes nothing.
pub const MAX_SUPERSEDED: usize = limit(4096, 2);

/// Numbers of deliveries dropped from the full queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HubCounts {
    /// Scene camera pictures superseded by newer ones before they were paired.
    pub scene_superseded: u64,
    /// Environment camera pictures lost.
    pub environment_lost: u64,
    /// Tracker readings lost.
    pub tracker_lost: u64,
}

/// An entry of the hub's queue.
#[derive(Debug)]
pub enum Delivery {
    /// An event of a device, or [`SessionEvent::Tick`] if the deadline has passed.
    Event(SessionEvent),
    /// A scene camera picture was superseded by newer ones. Pairing still needs its arrival,
    /// because a replay of the recording will see the picture.
    Superseded {
        /// When the picture arrived.
        arrived_at: MonotonicTime,
    },
}

/// Takes the deliveries of all devices and hands them to the rig, the recorder and a tap, in
/// the same order to each. None of these can delay a device.
pub struct Hub {
    state: Mutex<State>,
    arrived: Condvar,
    clock: Arc<dyn Clock>,
}

#[derive(Default)]
struct State {
    queue: VecDeque<Delivery>,
    /// Whether a consumer takes from the queue.
    has_consumer: bool,
    waiting: Waiting,
    recorder: Option<RecorderQueue>,
    tap: Option<FrameTap>,
    counts: HubCounts,
    has_ended: bool,
}

/// Number of events of each kind in the queue.
#[derive(Clone, Copy, Default)]
struct Waiting {
    scene: usize,
    environment: usize,
    tracker: usize,
    superseded: usize,
}

impl Waiting {
    /// Returns the count of events like `event` and its limit; `None` for kinds without one.
    const fn of(&mut self, event: &SessionEvent) -> Option<(&mut usize, usize)> {
        match event {
            SessionEvent::Scene(_) => Some((&mut self.scene, MAX_SCENE_PICTURES)),
            SessionEvent::Environment(_) => Some((&mut self.environment, MAX_ENVIRONMENT_PICTURES)),
            SessionEvent::TrackerBytes { .. } | SessionEvent::Pose(_) => {
                Some((&mut self.tracker, MAX_TRACKER_READINGS))
            }
            SessionEvent::Tick(_) | SessionEvent::Prepared { .. } => None,
        }
    }
}

impl Hub {
    /// Creates an empty hub. Without a consumer, which calls [`take`](Self::take), deliveries go
    /// only to the recorder and the tap.
    #[must_use]
    pub fn new(clock: Arc<dyn Clock>, has_consumer: bool) -> Arc<Self> {
        let state = State {
            has_consumer,
            ..State::default()
        };
        Arc::new(Self {
            state: Mutex::new(state),
            arrived: Condvar::new(),
            clock,
        })
    }

    /// Adds the delivery of a device. Does not wait for any consumer.
    pub fn deliver(&self, event: SessionEvent) {
        let mut state = self.lock();
        if let Some(recorder) = &state.recorder {
            recorder.offer(&event);
        }
        if let Some(tap) = &state.tap {
            tap.offer(&event);
        }
        if state.has_consumer && !state.has_ended {
            state.push(event);
            drop(state);
            self.arrived.notify_one();
        }
    }

    /// Passes a journal entry of the rig to the recorder alone.
    pub fn journal(&self, entry: &SessionEvent) {
        if let Some(recorder) = &self.lock().recorder {
            recorder.offer(entry);
        }
    }

    /// Takes the next delivery. Waits while the queue is empty; returns a [`SessionEvent::Tick`]
    /// when
    /// `deadline` has passed and [`Next::Idle`] after `timeout`.
    pub fn take(&self, deadline: Option<MonotonicTime>, timeout: Duration) -> Next<Delivery> {
        let mut state = self.lock();
        let latest = self.clock.now() + timeout;
        loop {
            if let Some(delivery) = state.pop() {
                return Next::Item(delivery);
            }
            if state.has_ended {
                return Next::Ended;
            }
            let now = self.clock.now();
            if deadline.is_some_and(|deadline| now >= deadline) {
                let tick = SessionEvent::Tick(now);
                if let Some(recorder) = &state.recorder {
                    recorder.offer(&tick);
                }
                return Next::Item(Delivery::Event(tick));
            }
            if now >= latest {
                return Next::Idle;
            }
            let until = deadline.map_or(latest, |deadline| deadline.min(latest));
            let wait = Duration::from_nanos(until.nanos_since(now).unsigned_abs());
            let waited = self.arrived.wait_timeout(state, wait);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Takes the next delivery if one is waiting.
    pub fn take_waiting(&self) -> Option<Delivery> {
        self.lock().pop()
    }

    /// Sends all later deliveries also to this recorder; `None` detaches the recorder.
    pub fn set_recorder(&self, recorder: Option<RecorderQueue>) {
        self.lock().recorder = recorder;
    }

    /// Sends all later deliveries that the tap's filter accepts also to this tap; `None` detaches
    /// the tap.
    pub fn set_tap(&self, tap: Option<FrameTap>) {
        let mut state = self.lock();
        // After the end a new tap would never be closed.
        state.tap = tap.filter(|_| !state.has_ended);
    }

    /// Ends the queue. Waiting deliveries can still be taken.
    pub fn end(&self) {
        let mut state = self.lock();
        state.has_ended = true;
        state.tap = None;
        drop(state);
        self.arrived.notify_all();
    }

    /// Returns the number of deliveries dropped so far.
    #[must_use]
    pub fn counts(&self) -> HubCounts {
        self.lock().counts
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn push(&mut self, event: SessionEvent) {
        let is_full = match self.waiting.of(&event) {
            Some((waiting, max)) => {
                *waiting += 1;
                *waiting > max
            }
            None => false,
        };
        if is_full {
            self.drop_oldest(&event);
        }
        self.queue.push_back(Delivery::Event(event));
    }

    /// Drops the oldest event of the same kind as `newer`.
    fn drop_oldest(&mut self, newer: &SessionEvent) {
        let kind = std::mem::discriminant(newer);
        let is_same_kind = |delivery: &Delivery| match delivery {
            Delivery::Event(event) => std::mem::discriminant(event) == kind,
            Delivery::Superseded { .. } => false,
        };
        let Some(oldest) = self.queue.iter().position(is_same_kind) else {
            return;
        };
        if let Some((waiting, _)) = self.waiting.of(newer) {
            *waiting -= 1;
        }
        match newer {
            SessionEvent::Scene(_) => {
                self.counts.scene_superseded += 1;
                if let Some(Delivery::Event(event)) = self.queue.get(oldest) {
                    let arrived_at = event.arrived_at();
                    self.queue[oldest] = Delivery::Superseded { arrived_at };
                    self.waiting.superseded += 1;
                }
                if self.waiting.superseded > MAX_SUPERSEDED {
                    self.drop_oldest_superseded();
                }
                return;
            }
            SessionEvent::Environment(_) => self.counts.environment_lost += 1,
            _ => self.counts.tracker_lost += 1,
        }
        self.queue.remove(oldest);
    }

    fn drop_oldest_superseded(&mut self) {
        let is_superseded = |delivery: &Delivery| matches!(delivery, Delivery::Superseded { .. });
        if let Some(oldest) = self.queue.iter().position(is_superseded) {
            self.queue.remove(oldest);
            self.waiting.superseded -= 1;
        }
    }

    fn pop(&mut self) -> Option<Delivery> {
        let delivery = self.queue.pop_front()?;
        match &delivery {
            Delivery::Event(event) => {
                if let Some((waiting, _)) = self.waiting.of(event) {
                    *waiting = waiting.saturating_sub(1);
                }
            }
            Delivery::Superseded { .. } => {
                self.waiting.superseded = self.waiting.superseded.saturating_sub(1);
            }
        }
        Some(delivery)
    }
}
