//! One ordered queue for the deliveries of all devices.

use crate::next::Next;
use crate::recorder_queue::RecorderQueue;
use crate::tap::FrameTap;
use penumbra_interface::{Clock, MonotonicTime};
use penumbra_session::SessionEvent;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Scene camera pictures that may wait. With one more the oldest is superseded: the rig shall
/// show the present.
const MAX_SCENE_PICTURES: usize = 4;
/// Environment camera pictures that may wait, brackets included.
const MAX_ENVIRONMENT_PICTURES: usize = 24;
/// Tracker readings that may wait: half a minute of the fastest tracker.
const MAX_TRACKER_READINGS: usize = 4096;

/// Deliveries that did not fit into the queue.
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
    /// An event of a device, or [`SessionEvent::Tick`] where the deadline passed.
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
    /// Somebody takes from the queue.
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
    /// Creates an empty hub. With `has_consumer` false nobody will [`take`](Self::take), and
    /// deliveries go to the recorder and the tap alone.
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

    /// Takes the next delivery. While the queue is empty, waits until `deadline`, which gives a
    /// [`SessionEvent::Tick`], but at most for `timeout`, after which it is [`Next::Idle`].
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

    /// Sends all later deliveries to this recorder too; `None` ends that.
    pub fn set_recorder(&self, recorder: Option<RecorderQueue>) {
        self.lock().recorder = recorder;
    }

    /// Sends all later deliveries that the tap's filter accepts to this tap too; `None` ends
    /// that.
    pub fn set_tap(&self, tap: Option<FrameTap>) {
        let mut state = self.lock();
        // After the end nothing would ever close the tap.
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

    /// Returns how many deliveries did not fit so far.
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
                }
                return;
            }
            SessionEvent::Environment(_) => self.counts.environment_lost += 1,
            _ => self.counts.tracker_lost += 1,
        }
        self.queue.remove(oldest);
    }

    fn pop(&mut self) -> Option<Delivery> {
        let delivery = self.queue.pop_front()?;
        if let Delivery::Event(event) = &delivery
            && let Some((waiting, _)) = self.waiting.of(event)
        {
            *waiting = waiting.saturating_sub(1);
        }
        Some(delivery)
    }
}
