//! Starts a tracker, without I/O.
//!
//! A [`Dialogue`] requests its owner to write bytes or to read until a time, and receives the bytes
//! read. At its end the device streams in the mode that was set, or the dialogue reports what it
//! sends instead.

use crate::format::{AnyDecoder, Format};
use crate::recognise::recognise;
use crate::settings::TrackerSettings;
use crate::step::Step;
use penumbra_interface::MonotonicTime;
use std::collections::VecDeque;
use std::time::Duration;

pub use crate::step::Answer;

/// Maximum number of received bytes kept for recognising the device.
const RECEIVED_LIMIT: usize = 8192;
/// A device that sends nothing for this time is silent.
const SILENCE: Duration = Duration::from_millis(100);
/// Time limit within which a device must fall silent after the stop command.
const SILENCE_LIMIT: Duration = Duration::from_secs(1);

/// The next action of the owner of a dialogue.
#[derive(Debug, PartialEq, Eq)]
pub enum Action {
    /// Write these bytes.
    Write(Vec<u8>),
    /// Read, and pass the bytes to the dialogue.
    Read {
        /// When to stop waiting.
        until: MonotonicTime,
        /// Whether the bytes are part of the stream already, to be kept.
        keep: bool,
    },
    /// The device streams.
    Done(Answer),
    /// The device does not stream.
    Failed(Trouble),
}

/// Why a device does not stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// The device sent nothing.
    Silent {
        /// For how long, milliseconds.
        millis: u64,
    },
    /// The device sent something else.
    Foreign {
        /// Description of the received bytes, and a remedy.
        seen: String,
    },
}

/// The start of a tracker, from connecting to its first records.
#[derive(Debug)]
pub struct Dialogue {
    protocol: String,
    /// The configured receivers.
    stations: Vec<u8>,
    decoder: AnyDecoder,
    steps: VecDeque<Step>,
    /// Bytes received since the current question, or since the last one.
    received: Vec<u8>,
    last_received_at: MonotonicTime,
    began: Option<MonotonicTime>,
    step_began: Option<MonotonicTime>,
    /// How often the current question has been asked.
    tries: u32,
    answer: Answer,
}

impl Dialogue {
    /// The dialogue for these settings. `None` for an unknown protocol.
    #[must_use]
    pub fn new(settings: &TrackerSettings) -> Option<Self> {
        let decoder = AnyDecoder::for_protocol(&settings.protocol)?;
        Some(Self {
            protocol: settings.protocol.clone(),
            stations: settings.stations.clone(),
            steps: decoder.format().start_sequence(settings).into(),
            decoder,
            received: Vec::new(),
            last_received_at: MonotonicTime::default(),
            began: None,
            step_began: None,
            tries: 0,
            answer: Answer::default(),
        })
    }

    /// Returns the next action.
    pub fn next(&mut self, now: MonotonicTime) -> Action {
        self.began.get_or_insert(now);
        loop {
            let began = *self.step_began.get_or_insert(now);
            let Some(step) = self.steps.front_mut() else {
                return Action::Done(self.answer.clone());
            };
            let action = match step {
                Step::Send(bytes) => {
                    let bytes = std::mem::take(bytes);
                    self.advance();
                    return Action::Write(bytes);
                }
                Step::Pause(pause) => read_until(began + *pause, now, false),
                Step::AwaitSilence => self.await_silence(began, now),
                Step::Ask { .. } => self.ask(began, now),
                Step::AwaitRecords(_) if self.decoder.locked() => None,
                Step::AwaitRecords(limit) => {
                    let limit = began + *limit;
                    Some(read_until(limit, now, true).unwrap_or_else(|| self.fail(now)))
                }
            };
            match action {
                Some(action) => return action,
                None => self.advance(),
            }
        }
    }

    /// `None` once the device is silent.
    fn await_silence(&self, began: MonotonicTime, now: MonotonicTime) -> Option<Action> {
        let silent_at = self.last_received_at.max(began) + SILENCE;
        if now < silent_at && now >= began + SILENCE_LIMIT {
            return Some(self.fail(now));
        }
        read_until(silent_at, now, false)
    }

    /// `None` once the device has answered, or if it did not answer an optional question.
    fn ask(&mut self, began: MonotonicTime, now: MonotonicTime) -> Option<Action> {
        let Some(Step::Ask {
            question,
            parse,
            timeout,
            tries,
            required,
        }) = self.steps.front()
        else {
            return None;
        };
        if let Some(answer) = parse(&self.received) {
            self.answer.description = answer.description.or(self.answer.description.take());
            self.answer.warning = answer.warning.or(self.answer.warning.take());
            if !answer.receivers.is_empty() {
                self.answer.receivers = answer.receivers;
            }
            return None;
        }
        if self.tries > 0
            && let Some(action) = read_until(began + *timeout, now, false)
        {
            return Some(action);
        }
        if self.tries < *tries {
            self.tries += 1;
            self.step_began = Some(now);
            return Some(Action::Write(question.clone()));
        }
        required.then(|| self.fail(now))
    }

    /// Passes received bytes to the dialogue.
    pub fn receive(&mut self, bytes: &[u8], now: MonotonicTime) {
        self.last_received_at = now;
        let room = RECEIVED_LIMIT.saturating_sub(self.received.len());
        self.received
            .extend_from_slice(bytes.get(..room).unwrap_or(bytes));
        if matches!(self.steps.front(), Some(Step::AwaitRecords(_))) {
            self.decoder.push(bytes, now, |_| {});
        }
    }

    /// Proceeds to the next step. Bytes received before a question are not its answer; bytes
    /// received without a question are kept for recognising another device.
    fn advance(&mut self) {
        self.steps.pop_front();
        self.step_began = None;
        self.tries = 0;
        let next = self.steps.front();
        if matches!(next, Some(Step::Ask { .. } | Step::AwaitRecords(_))) {
            self.received.clear();
        }
    }

    /// What is wrong if the device is silent because none of the configured receivers is plugged in.
    fn missing_receiver(&self) -> Option<String> {
        let there = &self.answer.receivers;
        let has_none = !self.stations.iter().any(|station| there.contains(station));
        let is_silent = self.received.is_empty() && !there.is_empty();
        let list = |stations: &[u8]| {
            let numbers = stations.iter().map(u8::to_string);
            numbers.collect::<Vec<_>>().join(", ")
        };
        (is_silent && has_none).then(|| {
            format!(
                "no receiver is plugged in at station {}; stations with one: {}; set `station` under \
                 [tracker]",
                list(&self.stations),
                list(there)
            )
        })
    }

    fn fail(&self, now: MonotonicTime) -> Action {
        let began = self.began.unwrap_or(now);
        Action::Failed(if let Some(seen) = self.missing_receiver() {
            Trouble::Foreign { seen }
        } else if self.received.is_empty() {
            Trouble::Silent {
                millis: u64::try_from(now.nanos_since(began) / 1_000_000).unwrap_or(0),
            }
        } else {
            Trouble::Foreign {
                seen: recognise(&self.received, &self.protocol),
            }
        })
    }
}

/// `None` once `until` is reached.
fn read_until(until: MonotonicTime, now: MonotonicTime, keep: bool) -> Option<Action> {
    (now < until).then_some(Action::Read { until, keep })
}

/// The command that stops the stream, so that the device is silent for the next program. Empty
/// if the device has no such command.
#[must_use]
pub fn stop_command(settings: &TrackerSettings) -> Vec<u8> {
    Format::for_protocol(&settings.protocol).map_or_else(Vec::new, |format| format.stop_command())
}

#[cfg(test)]
mod tests;
