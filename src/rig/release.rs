//! When prepared frames are sent. Those of a recording that is watched at its own rate are held until
//! they have been followed by others for a while: so the light of their instant, which depends on later
//! environment pictures, is mostly known.

use crate::frame::PreparedFrame;
use crate::held_frames::HeldFrames;
use crate::light::scheduler::LightScheduler;
use crate::light::state::LightState;
use crate::pace::Pace;
use crate::prepare::is_paced;
use crate::source::Source;
use penumbra_config::{Config, ReplaySpeed};
use penumbra_interface::MonotonicTime;

/// By how much a recording that is watched at its own rate is read ahead of what is shown, seconds: the
/// time between two environment pictures of three exposures and a light estimate
/// on a slow machine.
const AHEAD_SECONDS: f64 = 0.8;
/// For how long the light must be known when a recording starts again, nanoseconds: the estimates that
/// follow then have a lead.
const FIRST_NANOS: i64 = 150_000_000;
/// The same as [`AHEAD_SECONDS`], at most, while the first light of the recording is estimated.
const MAX_AHEAD_SECONDS: f64 = 3.0;
/// Maximum time from a picture to the next one whose light is wanted beforehand, nanoseconds.
const MAX_COMING_NANOS: i64 = 200_000_000;

/// How frames that are prepared are sent.
pub(super) struct Release {
    /// Number of late frames since the last one that was sent.
    skipped: u64,
    /// The instant of the last frame that was sent.
    last_sent: Option<MonotonicTime>,
    /// Whether the next frame does not follow the last one in time.
    starts: bool,
    /// Whether pictures are for eyes only, and need not be reproducible.
    shows_at_once: bool,
    /// How much faster than recorded a recording is watched, at least 1.
    rate: f64,
    /// How far a recording that is watched at its own rate has come; `None` for others.
    ahead: Option<Ahead>,
}

impl Release {
    /// Nothing has been sent.
    pub fn new(config: &Config, source: &Source) -> Self {
        Self {
            last_sent: None,
            skipped: 0,
            starts: false,
            shows_at_once: source.is_live() || is_paced(config),
            rate: match config.replay.speed {
                ReplaySpeed::Factor(factor) => factor.max(1.0),
                ReplaySpeed::Max => 1.0,
            },
            ahead: is_paced(config)
                .then_some(Ahead::First)
                .filter(|_| !source.is_live()),
        }
    }

    /// Starts again with the first frame of a recording, or after a jump.
    pub fn restart(&mut self) {
        self.last_sent = None;
        self.starts = true;
        self.ahead = self.ahead.map(|ahead| match ahead {
            Ahead::First => Ahead::First,
            Ahead::Starting | Ahead::Running => Ahead::Starting,
        });
    }

    /// Counts late frames that are not sent. They are told with the next frame: a message of their own
    /// would wait for the compositor, and make the next frame late, too.
    pub const fn skip(&mut self, count: u64) {
        self.skipped += count;
    }

    /// Takes the number of late frames since the last one that was sent.
    pub const fn take_skipped(&mut self) -> u64 {
        std::mem::replace(&mut self.skipped, 0)
    }

    /// Notes that `frame` is sent, and tells it what came before.
    pub fn mark(&mut self, frame: &mut PreparedFrame) {
        frame.is_start = std::mem::take(&mut self.starts);
        frame.skipped += self.take_skipped();
        self.last_sent = Some(frame.frame.captured_at);
    }

    /// Returns the light of the picture that follows the one captured at `at` as that one follows the
    /// one before.
    pub fn coming_light(
        &self,
        lights: &mut LightScheduler,
        at: MonotonicTime,
    ) -> Option<LightState> {
        if !self.shows_at_once {
            return None;
        }
        let interval = at.nanos_since(self.last_sent?);
        (1..=MAX_COMING_NANOS)
            .contains(&interval)
            .then(|| lights.coming_light(at.offset_nanos(interval)))
    }

    /// Returns whether the first frame that waits is to be sent, or `all` are.
    pub fn may_go(
        &mut self,
        all: bool,
        held: &HeldFrames,
        lights: &mut LightScheduler,
        pace: Option<&mut Pace>,
    ) -> bool {
        let Some((first, span)) = held.span() else {
            return false;
        };
        if all || held.is_full() {
            return true;
        }
        let Some(ahead) = self.ahead else {
            return lights.is_settled(first);
        };
        let is_read = |seconds: f64| span as f64 * 1e-9 >= seconds * self.rate;
        let goes = match ahead {
            Ahead::First => true,
            Ahead::Running => is_read(AHEAD_SECONDS),
            Ahead::Starting => {
                let soon = first.offset_nanos(FIRST_NANOS);
                while is_read(AHEAD_SECONDS) && !lights.is_settled(soon) {
                    if !lights.wait() {
                        break;
                    }
                }
                let is_settled = lights.is_settled(soon);
                is_read(AHEAD_SECONDS) && is_settled || is_read(MAX_AHEAD_SECONDS)
            }
        };
        if goes && ahead != Ahead::Running {
            // The frame may have waited for its light for longer than until it was due.
            if let Some((pace, at)) = pace.zip(held.first_arrival())
                && pace.is_late(at)
            {
                pace.restart();
            }
            let is_first = ahead == Ahead::First;
            self.ahead = Some(if is_first {
                Ahead::Starting
            } else {
                Ahead::Running
            });
        }
        goes
    }
}

/// How far a recording that is read ahead of what is shown has come.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Ahead {
    /// Its first frame ever is to be shown as soon as it has any light.
    First,
    /// The next frame waits for the light of its instant.
    Starting,
    /// Frames follow at the recording's rate.
    Running,
}
