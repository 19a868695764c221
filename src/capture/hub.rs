//! Where everything that arrives gets its place in one order.

use super::tap::Tap;
use crossbeam_channel::{Sender, TrySendError};
use penumbra_interface::{Clock, MonotonicTime};
use penumbra_session::SessionEvent;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Pictures of the scene camera that may wait. One more, and the oldest is passed over:
/// whoever looks wants to see the present.
const SCENE_WAITING: usize = 4;
/// Pictures of the environment camera that may wait, brackets included.
const ENVIRONMENT_WAITING: usize = 24;
/// Readings of the tracker that may wait: half a minute of the quickest.
const TRACKER_WAITING: usize = 4096;
/// Bytes that may wait for the recorder.
const RECORDER_BYTES: u64 = 256 << 20;

/// What became too much.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HubCounts {
    /// Pictures of the scene camera passed over for newer ones before they were paired.
    pub scene_superseded: u64,
    /// Pictures of the environment camera lost.
    pub environment_lost: u64,
    /// Readings of the tracker lost.
    pub tracker_lost: u64,
}

/// What [`Hub::take`] gives.
#[derive(Debug)]
pub enum Taken {
    /// Something arrived, or the wait was over ([`SessionEvent::Tick`]).
    Event(SessionEvent),
    /// A picture of the scene camera that arrived then was passed over for newer ones.
    Superseded(MonotonicTime),
    /// Nothing came for a while, and nothing waits for time to pass.
    Idle,
    /// Nothing will come any more.
    Ended,
}

/// Takes from all devices, gives to the rig and to the recorder, in the same order to
/// both. Neither can hold a device up.
pub struct Hub {
    state: Mutex<State>,
    arrived: Condvar,
    clock: Arc<dyn Clock>,
}

#[derive(Default)]
struct State {
    queue: VecDeque<Queued>,
    /// Somebody takes.
    live: bool,
    waiting: Waiting,
    recorder: Option<Inlet>,
    tap: Option<Tap>,
    counts: HubCounts,
    ended: bool,
}

enum Queued {
    Event(SessionEvent),
    Superseded(MonotonicTime),
}

#[derive(Clone, Copy, Default)]
struct Waiting {
    scene: usize,
    environment: usize,
    tracker: usize,
}

impl Waiting {
    const fn of(&mut self, event: &SessionEvent) -> Option<(&mut usize, usize)> {
        match event {
            SessionEvent::Scene(_) => Some((&mut self.scene, SCENE_WAITING)),
            SessionEvent::Environment(_) => Some((&mut self.environment, ENVIRONMENT_WAITING)),
            SessionEvent::TrackerBytes { .. } | SessionEvent::Pose(_) => {
                Some((&mut self.tracker, TRACKER_WAITING))
            }
            SessionEvent::Tick(_) | SessionEvent::Prepared { .. } => None,
        }
    }
}

impl Hub {
    /// Nothing has arrived yet. With `live` false nobody will [`take`](Self::take), and what
    /// arrives goes to the recorder alone.
    #[must_use]
    pub fn new(clock: Arc<dyn Clock>, live: bool) -> Arc<Self> {
        let state = State {
            live,
            ..State::default()
        };
        Arc::new(Self {
            state: Mutex::new(state),
            arrived: Condvar::new(),
            clock,
        })
    }

    /// Something arrived. Never waits for anybody.
    pub fn deliver(&self, event: SessionEvent) {
        let mut state = self.lock();
        if let Some(recorder) = &state.recorder {
            recorder.offer(&event);
        }
        if let Some(tap) = &state.tap {
            tap.offer(&event);
        }
        if state.live && !state.ended {
            state.push(event);
            drop(state);
            self.arrived.notify_one();
        }
    }

    /// Notes for the recorder alone what the rig made of what arrived.
    pub fn journal(&self, entry: &SessionEvent) {
        if let Some(recorder) = &self.lock().recorder {
            recorder.offer(entry);
        }
    }

    /// The next in order. With nothing there it waits until `deadline`, which gives a
    /// [`SessionEvent::Tick`], but not longer than `patience`.
    pub fn take(&self, deadline: Option<MonotonicTime>, patience: Duration) -> Taken {
        let mut state = self.lock();
        let longest = self.clock.now() + patience;
        loop {
            if let Some(taken) = state.pop() {
                return taken;
            }
            if state.ended {
                return Taken::Ended;
            }
            let now = self.clock.now();
            if deadline.is_some_and(|deadline| now >= deadline) {
                let tick = SessionEvent::Tick(now);
                if let Some(recorder) = &state.recorder {
                    recorder.offer(&tick);
                }
                return Taken::Event(tick);
            }
            if now >= longest {
                return Taken::Idle;
            }
            let until = deadline.map_or(longest, |deadline| deadline.min(longest));
            let wait = Duration::from_nanos(until.nanos_since(now).unsigned_abs());
            let waited = self.arrived.wait_timeout(state, wait);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The next that is there already.
    pub fn take_waiting(&self) -> Option<Taken> {
        self.lock().pop()
    }

    /// From here on everything goes to this recorder too; `None` ends that.
    pub fn set_recorder(&self, recorder: Option<Inlet>) {
        self.lock().recorder = recorder;
    }

    /// From here on what it wants goes to this tap too; `None` ends that.
    pub fn set_tap(&self, tap: Option<Tap>) {
        let mut state = self.lock();
        // After the end nothing would ever close it.
        state.tap = tap.filter(|_| !state.ended);
    }

    /// Nothing will come any more; what waits can still be taken.
    pub fn end(&self) {
        let mut state = self.lock();
        state.ended = true;
        state.tap = None;
        drop(state);
        self.arrived.notify_all();
    }

    /// What became too much so far.
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
        let full = match self.waiting.of(&event) {
            Some((waiting, most)) => {
                *waiting += 1;
                *waiting > most
            }
            None => false,
        };
        if full {
            self.make_room(&event);
        }
        self.queue.push_back(Queued::Event(event));
    }

    /// Gives up the oldest that is of the same kind as `newer`.
    fn make_room(&mut self, newer: &SessionEvent) {
        let kind = std::mem::discriminant(newer);
        let same = |queued: &Queued| match queued {
            Queued::Event(event) => std::mem::discriminant(event) == kind,
            Queued::Superseded(_) => false,
        };
        let Some(oldest) = self.queue.iter().position(same) else {
            return;
        };
        if let Some((waiting, _)) = self.waiting.of(newer) {
            *waiting -= 1;
        }
        match newer {
            // Pairing still learns that it arrived: a replay of the recording will see it.
            SessionEvent::Scene(_) => {
                self.counts.scene_superseded += 1;
                if let Some(Queued::Event(event)) = self.queue.get(oldest) {
                    self.queue[oldest] = Queued::Superseded(event.arrived_at());
                }
                return;
            }
            SessionEvent::Environment(_) => self.counts.environment_lost += 1,
            _ => self.counts.tracker_lost += 1,
        }
        self.queue.remove(oldest);
    }

    fn pop(&mut self) -> Option<Taken> {
        Some(match self.queue.pop_front()? {
            Queued::Superseded(at) => Taken::Superseded(at),
            Queued::Event(event) => {
                if let Some((waiting, _)) = self.waiting.of(&event) {
                    *waiting = waiting.saturating_sub(1);
                }
                Taken::Event(event)
            }
        })
    }
}

/// The way to a recorder: bounded, and what does not fit is counted, not waited for.
#[derive(Clone, Debug)]
pub struct Inlet {
    events: Sender<SessionEvent>,
    /// Bytes that wait; the recorder takes them off.
    bytes: Arc<AtomicU64>,
    dropped: Arc<AtomicU64>,
}

impl Inlet {
    /// Into `events`; `bytes` counts what waits there, `dropped` what did not fit.
    #[must_use]
    pub const fn new(
        events: Sender<SessionEvent>,
        bytes: Arc<AtomicU64>,
        dropped: Arc<AtomicU64>,
    ) -> Self {
        Self {
            events,
            bytes,
            dropped,
        }
    }

    fn offer(&self, event: &SessionEvent) {
        let size = event.bytes() as u64;
        if self.bytes.load(Ordering::Relaxed) + size > RECORDER_BYTES {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.bytes.fetch_add(size, Ordering::Relaxed);
        if let Err(TrySendError::Full(event) | TrySendError::Disconnected(event)) =
            self.events.try_send(event.clone())
        {
            self.bytes
                .fetch_sub(event.bytes() as u64, Ordering::Relaxed);
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}
