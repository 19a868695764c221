//! What the page asks the program to do, and what came of it. The program waits for requests; the server never
//! waits for the program.

use crate::{Adjustment, PhotoPage};
use bytes::Bytes;
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Interval at which the program looks whether it shall end.
const POLL: Duration = Duration::from_millis(100);
/// How long the program waits at its end for the page to read that it has.
const FAREWELL: Duration = Duration::from_secs(3);
/// How long an answer may take to be sent.
const GRACE: Duration = Duration::from_millis(200);

/// What a person asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// Compose the picture with this ball and this ground.
    Compose(Adjustment),
    /// Write the picture that was composed last, and end.
    Finish,
}

/// A composed picture.
#[derive(Clone, Debug)]
pub struct Composite {
    /// The PNG file.
    pub png: Bytes,
    /// What there is to say about it, the check last.
    pub lines: Vec<String>,
}

/// What the program does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Phase {
    /// It waits for a request.
    #[default]
    Waiting,
    /// It composes.
    Composing,
    /// It writes the files.
    Writing,
    /// It has written the files, or could not, and ends.
    Finished,
}

/// The state, and a way to wait for a request.
#[derive(Default)]
pub(crate) struct Work {
    state: Mutex<State>,
    asked: Condvar,
}

#[derive(Default)]
struct State {
    phase: Phase,
    request: Option<Request>,
    /// Number of pictures composed.
    composed: u64,
    composite: Option<Composite>,
    trouble: Option<String>,
    /// The page has read the last state.
    is_read: bool,
}

/// The state as the page reads it.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    phase: Phase,
    composed: u64,
    lines: Vec<String>,
    trouble: Option<String>,
}

impl Work {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Leaves a request for the program.
    ///
    /// # Errors
    /// The program is busy, or there is nothing to be written.
    pub fn ask(&self, request: Request) -> Result<(), &'static str> {
        let mut state = self.lock();
        if state.phase != Phase::Waiting {
            return Err("the program is busy; wait until it has composed");
        }
        state.phase = match request {
            Request::Compose(_) => Phase::Composing,
            Request::Finish if state.composite.is_none() => {
                return Err("nothing has been composed yet");
            }
            Request::Finish => Phase::Writing,
        };
        state.trouble = None;
        state.request = Some(request);
        self.asked.notify_all();
        Ok(())
    }

    /// Returns the state; the program may end once the last has been read.
    pub fn report(&self) -> Report {
        let mut state = self.lock();
        state.is_read = state.phase == Phase::Finished;
        self.asked.notify_all();
        let composite = state.composite.as_ref();
        Report {
            phase: state.phase,
            composed: state.composed,
            lines: composite.map_or_else(Vec::new, |c| c.lines.clone()),
            trouble: state.trouble.clone(),
        }
    }

    /// Returns the last composed picture.
    pub fn png(&self) -> Option<Bytes> {
        self.lock().composite.as_ref().map(|c| c.png.clone())
    }
}

impl PhotoPage {
    /// Waits for the next request; `None` once `shutdown` is set.
    #[must_use]
    pub fn next(&self, shutdown: &AtomicBool) -> Option<Request> {
        let mut state = self.work.lock();
        while !shutdown.load(Ordering::Relaxed) {
            if let Some(request) = state.request.take() {
                return Some(request);
            }
            let waited = self.work.asked.wait_timeout(state, POLL);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        None
    }

    /// Shows a composed picture, or why there is none.
    pub fn show(&self, composite: Result<Composite, String>) {
        let mut state = self.work.lock();
        state.phase = Phase::Waiting;
        match composite {
            Ok(composite) => {
                state.composed += 1;
                state.composite = Some(composite);
            }
            Err(trouble) => state.trouble = Some(trouble),
        }
    }

    /// Tells the page that the program ends, and why if it is for an error; waits until the page has read it, for
    /// some seconds at most.
    pub fn take_leave(&self, trouble: Option<String>) {
        let until = Instant::now() + FAREWELL;
        let mut state = self.work.lock();
        state.phase = Phase::Finished;
        state.trouble = trouble;
        state.is_read = false;
        while !state.is_read && Instant::now() < until {
            let waited = self.work.asked.wait_timeout(state, POLL);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        drop(state);
        // The answer is on its way to the browser.
        std::thread::sleep(GRACE);
    }
}
