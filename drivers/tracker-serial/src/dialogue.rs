//! What is said to a tracker on connecting and on leaving, without I/O.
//!
//! A [`Dialogue`] asks its owner to write bytes or to read until an instant, and is given
//! what was read. At its end the device streams and has been seen to do so in the mode
//! that it was told, or the dialogue says what came instead.

use crate::recognise::recognise;
use crate::settings::TrackerSettings;
use crate::{AnyDecoder, csv, fastrak, flock, freed, liberty};
use penumbra_interface::MonotonicTime;
use std::collections::VecDeque;
use std::time::Duration;

/// More than this of what came is not kept for judging it.
const HEARD_LIMIT: usize = 8192;

/// One thing to do on connecting.
#[derive(Debug)]
pub(crate) enum Step {
    /// Write this.
    Send(Vec<u8>),
    /// Let the device work.
    Pause(Duration),
    /// Read and forget until nothing comes for 100 ms; a device that does not stop within a
    /// second is not the one that was meant.
    Quiet,
    /// Write this and read until `heard` finds its answer; again, up to `tries` times. When
    /// none comes, that matters only if `needed`.
    Ask {
        /// The question.
        send: Vec<u8>,
        /// Finds the answer in all bytes since the question.
        heard: fn(&[u8]) -> Option<Answer>,
        /// How long one try lasts.
        within: Duration,
        /// How often to ask.
        tries: u32,
        /// Whether the device must answer.
        needed: bool,
    },
    /// Read until two records have been understood.
    Stream(Duration),
}

/// What a device answered.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Answer {
    /// What it said of itself, in one line.
    pub said: Option<String>,
    /// What is odd about it.
    pub warning: Option<String>,
}

/// What the dialogue's owner is to do next.
#[derive(Debug, PartialEq, Eq)]
pub enum Action {
    /// Write these bytes.
    Write(Vec<u8>),
    /// Read, at the longest until then, and say what came; `keep` means that it is part of
    /// the stream already.
    Read {
        /// Until when.
        until: MonotonicTime,
        /// Whether the bytes are records of the stream.
        keep: bool,
    },
    /// The device streams.
    Done(Answer),
    /// It does not.
    Failed(Trouble),
}

/// Why a device is of no use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// Nothing came.
    Silent {
        /// For how long, milliseconds.
        millis: u64,
    },
    /// Something else came.
    Foreign {
        /// What it looks like and what to do.
        seen: String,
    },
}

/// A conversation with a tracker, from connecting to its first records.
#[derive(Debug)]
pub struct Dialogue {
    protocol: String,
    decoder: AnyDecoder,
    steps: VecDeque<Step>,
    heard: Vec<u8>,
    /// When the present step began, and when something last came in it.
    began: Option<MonotonicTime>,
    newest: MonotonicTime,
    started: Option<MonotonicTime>,
    tries: u32,
    answer: Answer,
}

impl Dialogue {
    /// The conversation for these settings. `None` for an unknown protocol.
    #[must_use]
    pub fn new(settings: &TrackerSettings) -> Option<Self> {
        let decoder = AnyDecoder::for_protocol(&settings.protocol)?;
        Some(Self {
            protocol: settings.protocol.clone(),
            steps: greeting(settings, decoder.format()).into(),
            decoder,
            heard: Vec::new(),
            began: None,
            newest: MonotonicTime::default(),
            started: None,
            tries: 0,
            answer: Answer::default(),
        })
    }

    /// What to do now.
    pub fn next(&mut self, now: MonotonicTime) -> Action {
        self.started.get_or_insert(now);
        loop {
            let began = *self.began.get_or_insert(now);
            let elapsed = now.nanos_since(began);
            let Some(step) = self.steps.front_mut() else {
                return Action::Done(self.answer.clone());
            };
            match step {
                Step::Send(bytes) => {
                    let bytes = std::mem::take(bytes);
                    self.advance();
                    return Action::Write(bytes);
                }
                Step::Pause(pause) if elapsed < nanos(*pause) => {
                    return read(began + *pause, false);
                }
                Step::Pause(_) => self.advance(),
                Step::Quiet => {
                    let quiet_at = self.newest.max(began) + Duration::from_millis(100);
                    if now < quiet_at && elapsed < 1_000_000_000 {
                        return read(quiet_at, false);
                    }
                    if now < quiet_at {
                        return self.fail(now);
                    }
                    self.advance();
                }
                Step::Ask { .. } => match self.ask(now, began) {
                    Some(action) => return action,
                    None => self.advance(),
                },
                Step::Stream(within) if self.decoder.locked() => {
                    let _ = within;
                    self.advance();
                }
                Step::Stream(within) if elapsed < nanos(*within) => {
                    return read(began + *within, true);
                }
                Step::Stream(_) => return self.fail(now),
            }
        }
    }

    /// One step of asking; `None` when it is over.
    fn ask(&mut self, now: MonotonicTime, began: MonotonicTime) -> Option<Action> {
        let Some(Step::Ask {
            send,
            heard,
            within,
            tries,
            needed,
        }) = self.steps.front()
        else {
            return None;
        };
        if let Some(answer) = heard(&self.heard) {
            self.answer.said = answer.said.or(self.answer.said.take());
            self.answer.warning = answer.warning.or(self.answer.warning.take());
            return None;
        }
        if self.tries > 0 && now.nanos_since(began) < nanos(*within) {
            return Some(read(began + *within, false));
        }
        if self.tries < *tries {
            self.tries += 1;
            let send = send.clone();
            self.began = Some(now);
            return Some(Action::Write(send));
        }
        needed.then(|| self.fail(now))
    }

    /// Takes what was read.
    pub fn receive(&mut self, bytes: &[u8], now: MonotonicTime) {
        self.newest = now;
        let room = HEARD_LIMIT.saturating_sub(self.heard.len());
        self.heard
            .extend_from_slice(bytes.get(..room).unwrap_or(bytes));
        if matches!(self.steps.front(), Some(Step::Stream(_))) {
            self.decoder.push(bytes, now, |_| {});
        }
    }

    fn advance(&mut self) {
        // What came before a question is no answer to it. What came while nothing was asked
        // is kept for judging a foreign device by.
        self.steps.pop_front();
        self.began = None;
        self.tries = 0;
        if matches!(self.steps.front(), Some(Step::Ask { .. } | Step::Stream(_))) {
            self.heard.clear();
        }
    }

    fn fail(&self, now: MonotonicTime) -> Action {
        let started = self.started.unwrap_or(now);
        Action::Failed(if self.heard.is_empty() {
            Trouble::Silent {
                millis: u64::try_from(now.nanos_since(started) / 1_000_000).unwrap_or(0),
            }
        } else {
            Trouble::Foreign {
                seen: recognise(&self.heard, &self.protocol),
            }
        })
    }
}

fn read(until: MonotonicTime, keep: bool) -> Action {
    Action::Read { until, keep }
}

fn nanos(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

/// All that is said on connecting.
fn greeting(settings: &TrackerSettings, format: &crate::Format) -> Vec<Step> {
    use crate::Format;
    match format {
        Format::Fastrak(format) => fastrak::commands::greeting(settings, format),
        Format::Liberty(format) => liberty::commands::greeting(settings, format),
        Format::Flock(format) => flock::commands::greeting(settings, format),
        Format::Freed(_) => freed::commands::greeting(settings),
        Format::Csv(_) => csv::greeting(),
        // Its conversation is the connection's own, see vrpn::Client.
        Format::Vrpn(_) => Vec::new(),
    }
}

/// All that is said on leaving, so that the device is quiet for whoever comes next. Empty
/// where a device knows no such command.
#[must_use]
pub fn farewell(settings: &TrackerSettings) -> Vec<u8> {
    use crate::Format;
    match Format::for_protocol(&settings.protocol) {
        Some(Format::Fastrak(_)) => b"c".to_vec(),
        Some(Format::Liberty(_)) => b"P\r".to_vec(),
        Some(Format::Flock(_)) => b"B".to_vec(),
        Some(Format::Freed(_)) => freed::commands::command(freed::commands::STOP).to_vec(),
        Some(Format::Csv(_) | Format::Vrpn(_)) | None => Vec::new(),
    }
}

#[cfg(test)]
mod tests;
