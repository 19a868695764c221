//! Reads a recorded session without Penumbra.

use crate::rig::{Reading, read_jpeg};
use mcap::MessageStream;
use mcap::read::Options;
use std::collections::BTreeMap;
use std::path::Path;

/// One message of a stream.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The device's counter.
    pub sequence: u32,
    /// Time of arrival, nanoseconds of the monotonic clock.
    pub arrived: u64,
    /// Time of capture.
    pub captured: u64,
    /// The message.
    pub data: Vec<u8>,
}

/// The streams of a session by topic, in the order of the file.
pub type Streams = BTreeMap<String, Vec<Entry>>;

/// Reads a file up to its last complete message: if its writer was killed, it has no end.
pub fn read(path: &Path) -> Streams {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let messages = MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into()).unwrap();
    let mut streams = Streams::new();
    for message in messages.map_while(Result::ok) {
        let entries = streams.entry(message.channel.topic.clone()).or_default();
        entries.push(Entry {
            sequence: message.sequence,
            arrived: message.log_time,
            captured: message.publish_time,
            data: message.data.into_owned(),
        });
    }
    streams
}

/// The stream of this topic.
pub fn stream<'a>(streams: &'a Streams, topic: &str) -> &'a [Entry] {
    let there: Vec<_> = streams.keys().collect();
    streams
        .get(topic)
        .unwrap_or_else(|| panic!("no {topic} among {there:?}"))
}

/// Attachments of a session, by name.
pub fn attachments(path: &Path) -> BTreeMap<String, Vec<u8>> {
    let bytes = std::fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().expect("an index");
    let files = summary.attachment_indexes.iter().map(|index| {
        let file = mcap::read::attachment(&bytes, index).unwrap();
        (file.name, file.data.into_owned())
    });
    files.collect()
}

/// Seconds from the first message to the last.
pub fn seconds(entries: &[Entry]) -> f64 {
    let times = entries.first().zip(entries.last());
    times.map_or(0.0, |(first, last)| {
        (last.arrived - first.arrived) as f64 * 1e-9
    })
}

/// The longest time between two messages, seconds.
pub fn longest_gap(entries: &[Entry]) -> f64 {
    let gaps = entries
        .windows(2)
        .map(|pair| (pair[1].arrived - pair[0].arrived) as f64 * 1e-9);
    gaps.fold(0.0, f64::max)
}

/// Panics if times decrease, or if a message arrives before its capture.
pub fn assert_in_order(topic: &str, entries: &[Entry]) {
    for entry in entries {
        assert!(
            entry.captured <= entry.arrived,
            "{topic}: arrives before it is captured"
        );
    }
    for pair in entries.windows(2) {
        assert!(
            pair[1].arrived >= pair[0].arrived,
            "{topic}: arrival times decrease"
        );
        assert!(
            pair[1].captured >= pair[0].captured,
            "{topic}: capture times decrease"
        );
    }
}

/// Reads the data that the emulated camera has encoded in the picture of an image message.
pub fn read_image(entry: &Entry) -> Reading {
    let begin = entry
        .data
        .windows(3)
        .position(|bytes| bytes == [0xff, 0xd8, 0xff]);
    read_jpeg(&entry.data[begin.expect("a JPEG in the message")..])
}
