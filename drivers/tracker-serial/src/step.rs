//! The steps of starting a tracker. Each protocol lists its own; [`Dialogue`] carries them out.
//!
//! [`Dialogue`]: crate::dialogue::Dialogue

use std::time::Duration;

/// One step.
#[derive(Debug)]
pub(crate) enum Step {
    /// Write these bytes.
    Send(Vec<u8>),
    /// Wait for the device.
    Pause(Duration),
    /// Read and discard until nothing has come for 100 ms. A device that sends on for a second
    /// is not the expected one.
    AwaitSilence,
    /// Write a question and read until `parse` finds the answer.
    Ask {
        /// The question.
        question: Vec<u8>,
        /// Finds the answer in all bytes received since the question.
        parse: fn(&[u8]) -> Option<Answer>,
        /// Time limit of one try.
        timeout: Duration,
        /// How often to ask.
        tries: u32,
        /// Whether to give up when no answer comes.
        required: bool,
    },
    /// Read until two records in a row have been decoded, within this time.
    AwaitRecords(Duration),
}

/// Answer of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Answer {
    /// The device's description of itself, one line.
    pub description: Option<String>,
    /// A note for the user, one line.
    pub warning: Option<String>,
    /// The receivers that are plugged in, in ascending order; empty if the device did not tell.
    pub receivers: Vec<u8>,
}
