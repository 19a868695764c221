//! Playback of a recording as the dashboard requests it: pause, jumps, repetition.
//!
//! The compositor's loop pauses: it composes the frame that it has again, so that settings take effect
//! meanwhile, and takes no other. The preparation jumps: it reads the recording from its beginning
//! to the requested position without decoding pictures, because pairing and tracker need what was
//! before.

use crate::context::RunContext;
use crate::source::Source;
use penumbra_interface::MonotonicTime;
use penumbra_status::{Playback, SharedStatus};
use std::time::Duration;
use tokio::sync::watch;

/// Interval at which a paused picture is composed again.
pub(super) const HOLD_INTERVAL: Duration = Duration::from_millis(100);
/// Interval at which requests are checked while the recording waits at its end.
pub(super) const END_INTERVAL: Duration = Duration::from_millis(50);
/// Jumps lead to this long before the end at most, nanoseconds, so that a picture follows.
const LAST_NANOS: i64 = 300_000_000;

/// Opens the playback of a run to requests, or states why it is closed to them.
pub(super) fn open(context: &RunContext) {
    let Source::Recorded(session) = &context.source else {
        let closed = "a live rig plays no recording";
        context.status.open_playback(false, None, Some(closed));
        return;
    };
    let writes = context.config.output.frames.is_some() || context.options.poses.is_some();
    let closed = writes.then_some("every picture is being written to a file");
    let duration = session.span().map(|(start, end)| end.seconds_since(start));
    let repeat = context.config.replay.repeat;
    context.status.open_playback(repeat, duration, closed);
}

/// The requests, as the preparation follows them.
pub(super) struct Transport {
    requests: watch::Receiver<Playback>,
    /// First and last arrival of the recording; `None` for live devices.
    span: Option<(MonotonicTime, MonotonicTime)>,
    /// Whether the run ends with the recording.
    ends: bool,
    jumps: u64,
    resumes: u64,
    /// Pictures that arrived before are passed over.
    target: Option<MonotonicTime>,
}

impl Transport {
    pub fn new(requests: watch::Receiver<Playback>, source: &Source, ends: bool) -> Self {
        let span = match source {
            Source::Recorded(session) => session.span(),
            Source::Live(_) => None,
        };
        Self {
            requests,
            span,
            ends,
            jumps: 0,
            resumes: 0,
            target: None,
        }
    }

    /// Number of the newest jump that has been made.
    pub const fn jumps(&self) -> u64 {
        self.jumps
    }

    /// Returns whether a jump is requested that has not been made.
    pub fn wants_jump(&self) -> bool {
        self.requests.borrow().jumps != self.jumps
    }

    /// Returns whether a pause has ended since the last call.
    pub fn has_resumed(&mut self) -> bool {
        let resumes = self.requests.borrow().resumes;
        std::mem::replace(&mut self.resumes, resumes) != resumes
    }

    /// Makes the requested jump: pictures before its position are passed over.
    pub fn jump(&mut self) {
        let playback = *self.requests.borrow();
        self.jumps = playback.jumps;
        self.target = self.span.map(|(start, end)| {
            let length = end.nanos_since(start);
            let after = (length as f64 * playback.position) as i64;
            start
                + Duration::from_nanos(after.clamp(0, (length - LAST_NANOS).max(0)).unsigned_abs())
        });
    }

    /// Returns whether a picture that arrived at `at` is passed over.
    pub fn passes(&mut self, at: MonotonicTime) -> bool {
        let passes = self.target.is_some_and(|target| at < target);
        if !passes {
            self.target = None;
        }
        passes
    }

    /// At the end of the recording: whether it starts again, ends, or waits for a request.
    pub fn at_end(&self) -> AtEnd {
        let playback = *self.requests.borrow();
        if playback.repeat || playback.jumps != self.jumps {
            AtEnd::Repeat
        } else if self.ends {
            AtEnd::End
        } else {
            AtEnd::Wait
        }
    }
}

/// What follows the end of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AtEnd {
    /// The recording starts again.
    Repeat,
    /// The run ends.
    End,
    /// The last picture stands still until a request.
    Wait,
}

/// Returns whether a frame that was read after jump number `jumps` is to be shown.
pub(super) fn is_current(status: &SharedStatus, jumps: u64) -> bool {
    status.playback_receiver().borrow().jumps == jumps
}
