//! What a damaged part of a session held: streams, number of messages, times.
//!
//! MCAP writers put an index behind each chunk, which states the time and the position of every
//! message in it. Where the chunk cannot be read, its index tells what is lost.

use super::container::{Container, DamagedPart};
use super::records::{self, ChunkHeader, IndexedMessage, RECORD_HEADER, op, record_header};
use super::topics::{Camera, Role};
use std::collections::BTreeMap;
use std::fmt;
use std::io::{Read, Seek};

/// Maximum size of the index behind a chunk, bytes.
const MAX_INDEX_BYTES: u64 = 16 << 20;
/// Maximum number of streams that are named in a message.
const MAX_NAMED: usize = 6;

/// Messages of one stream that a damaged part of a session held.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LostMessages {
    /// The topic; `None` if the streams are not known.
    pub stream: Option<String>,
    /// Number of messages; `None` if it is not known.
    pub messages: Option<u64>,
    /// Arrival of the first one, seconds since the start of the recording.
    pub from_seconds: f64,
    /// Arrival of the last one.
    pub to_seconds: f64,
}

impl LostMessages {
    /// Number of pictures of `camera` among them.
    #[must_use]
    pub fn pictures_of(&self, camera: Camera) -> u64 {
        self.count_if(|role| role == Role::Image(camera))
    }

    /// Number of the tracker's messages among them.
    #[must_use]
    pub fn tracker_messages(&self) -> u64 {
        self.count_if(|role| matches!(role, Role::TrackerBytes | Role::TrackerPose))
    }

    fn count_if(&self, is_counted: impl Fn(Role) -> bool) -> u64 {
        let role = self.stream.as_deref().and_then(Role::from_topic);
        let count = role.filter(|role| is_counted(*role)).and(self.messages);
        count.unwrap_or(0)
    }
}

impl fmt::Display for LostMessages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.messages {
            Some(messages) => write!(f, "{messages} of ")?,
            None => write!(f, "an unknown number of messages of ")?,
        }
        let stream = self.stream.as_deref().unwrap_or("unknown streams");
        write!(
            f,
            "{stream} from {:.3} s to {:.3} s",
            self.from_seconds, self.to_seconds
        )
    }
}

/// The end of a message about a damaged part.
pub(super) fn sentence(lost: &[LostMessages]) -> String {
    if lost.is_empty() {
        return "that part is skipped".to_owned();
    }
    let mut named: Vec<_> = lost
        .iter()
        .take(MAX_NAMED)
        .map(ToString::to_string)
        .collect();
    if lost.len() > MAX_NAMED {
        named.push(format!("{} more streams", lost.len() - MAX_NAMED));
    }
    format!("lost: {}", named.join(", "))
}

/// Counts lost messages by stream.
#[derive(Debug, Default)]
pub(super) struct LossTally(BTreeMap<String, (u64, u64, u64)>);

impl LossTally {
    /// Adds a message of a topic with its log time, nanoseconds.
    pub fn add(&mut self, topic: &str, time: u64) {
        if let Some((count, first, last)) = self.0.get_mut(topic) {
            *count += 1;
            *first = time.min(*first);
            *last = time.max(*last);
        } else {
            self.0.insert(topic.to_owned(), (1, time, time));
        }
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the losses; `start` is the log time of the recording's start.
    pub fn into_lost(self, start: u64) -> Vec<LostMessages> {
        let lost = self
            .0
            .into_iter()
            .map(|(topic, (count, first, last))| LostMessages {
                stream: Some(topic),
                messages: Some(count),
                from_seconds: seconds(first, start),
                to_seconds: seconds(last, start),
            });
        lost.collect()
    }
}

fn seconds(time: u64, start: u64) -> f64 {
    (i128::from(time) - i128::from(start)) as f64 * 1e-9
}

impl Container {
    /// Returns the messages that the index at `at` states for the chunk before it, from `offset`
    /// within that chunk on. An index that is missing or damaged states none.
    pub fn indexed(
        &self,
        file: &mut (impl Read + Seek),
        at: u64,
        offset: u64,
    ) -> Vec<IndexedMessage> {
        let (mut messages, mut at, limit) = (Vec::new(), at, at.saturating_add(MAX_INDEX_BYTES));
        while let Ok(head) = self.read(file, at, RECORD_HEADER as u64)
            && let Some((op::MESSAGE_INDEX, len)) = record_header(&head)
            && let body = at + RECORD_HEADER as u64
            && body.saturating_add(len) <= limit
            && let Ok(bytes) = self.read(file, body, len)
        {
            messages.extend(records::message_index(&bytes).filter(|m| m.offset >= offset));
            at = body + len;
        }
        messages
    }

    /// Returns what a damaged part held, by the index behind it; by the times in the header of its
    /// chunk if there is no index.
    pub fn lost(
        &self,
        file: &mut (impl Read + Seek),
        part: &DamagedPart,
        topic: impl Fn(u16) -> Option<String>,
    ) -> Vec<LostMessages> {
        let start = self.start_time();
        let mut tally = LossTally::default();
        for message in self.indexed(file, part.index_at, part.from) {
            if let Some(topic) = topic(message.channel_id) {
                tally.add(&topic, message.log_time);
            }
        }
        match part.times {
            Some((first, last)) if tally.is_empty() => vec![LostMessages {
                stream: None,
                messages: None,
                from_seconds: seconds(first, start),
                to_seconds: seconds(last, start),
            }],
            _ => tally.into_lost(start),
        }
    }

    /// Log time of the recording's first message.
    pub fn start_time(&self) -> u64 {
        let starts = self.chunks.iter().map(|chunk| chunk.header.start_time);
        starts.min().unwrap_or_default()
    }
}

impl DamagedPart {
    /// The contents of a chunk from `from` on.
    pub fn of_chunk(offset: u64, header: &ChunkHeader, from: u64, reason: String) -> Self {
        Self {
            offset,
            index_at: offset.saturating_add(header.compressed_size),
            from,
            times: Some((header.start_time, header.end_time)),
            reason,
        }
    }
}
