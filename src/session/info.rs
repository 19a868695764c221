//! Statistics of a session, and their text.

use super::SessionError;
use super::container::{DamagedPart, open};
use super::events::{LEADS_OUT, Unreadable};
use super::messages::recorded_time;
use super::reader::Session;
use super::records::{self, MessageHeader, op, records_in};
use super::topics::{Camera, Role};
use penumbra_interface::MonotonicTime;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Minimum length of a gap, median intervals.
const GAP_INTERVALS: i64 = 2;
/// Maximum number of damaged parts that are listed.
const MAX_LISTED: usize = 100;

/// One stream of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamInfo {
    /// The topic.
    pub topic: String,
    /// Number of messages.
    pub messages: u64,
    /// Size of all messages, bytes.
    pub bytes: u64,
    /// Arrival of the first message.
    pub first: MonotonicTime,
    /// Arrival of the last message.
    pub last: MonotonicTime,
    /// Messages per second, from the median interval; `None` below two messages.
    pub rate_hz: Option<f64>,
    /// Number of intervals longer than twice the median interval.
    pub gaps: u64,
    /// The longest interval, nanoseconds.
    pub longest_interval_nanos: i64,
    /// Number of images missing by the camera's counter, which counts base exposures and brackets;
    /// stated once for a camera, at the first of its image streams.
    pub lost: u64,
}

impl StreamInfo {
    /// Time from the first message to the last, seconds.
    #[must_use]
    pub fn duration_seconds(&self) -> f64 {
        self.last.seconds_since(self.first)
    }
}

/// Data of a stream before they are summarised.
#[derive(Default)]
struct Tally {
    times: Vec<i64>,
    bytes: u64,
}

/// Counter of a camera's images in all of its streams: arrival, value.
#[derive(Default)]
struct Counter(Vec<(u64, u32)>);

impl Counter {
    /// Returns the number of images missing. Base exposure and brackets share the counter; what a
    /// camera always leaves out, such as pictures between two exposures, is not lost.
    fn lost(&mut self) -> u64 {
        self.0.sort_unstable();
        let steps = self.0.windows(2).map(|w| w[1].1.wrapping_sub(w[0].1));
        // A counter that restarts or repeats does not indicate losses.
        let mut steps: Vec<u32> = steps.filter(|s| (1..1 << 31).contains(s)).collect();
        steps.sort_unstable();
        let Some(&usual) = steps.get(steps.len() / 2) else {
            return 0;
        };
        let lost = steps.iter().map(|step| (step / usual).saturating_sub(1));
        lost.map(u64::from).sum()
    }
}

impl Tally {
    fn add(&mut self, header: &MessageHeader, bytes: u64) {
        self.times.push(recorded_time(header.log_time).as_nanos());
        self.bytes += bytes;
    }

    fn summarise(mut self, topic: String, lost: u64) -> Option<StreamInfo> {
        self.times.sort_unstable();
        let (first, last) = (*self.times.first()?, *self.times.last()?);
        let mut intervals: Vec<_> = self
            .times
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .collect();
        intervals.sort_unstable();
        let median = intervals.get(intervals.len() / 2).copied();
        // Damaged time stamps may be centuries apart.
        let longest = median.map(|m| GAP_INTERVALS.saturating_mul(m));
        let is_gap = |interval: &&i64| longest.is_some_and(|l| **interval > l);
        Some(StreamInfo {
            topic,
            messages: self.times.len() as u64,
            bytes: self.bytes,
            first: MonotonicTime::from_nanos(first),
            last: MonotonicTime::from_nanos(last),
            rate_hz: median.filter(|m| *m > 0).map(|m| 1e9 / m as f64),
            gaps: intervals.iter().filter(is_gap).count() as u64,
            longest_interval_nanos: intervals.last().copied().unwrap_or(0),
            lost,
        })
    }
}

impl Session {
    /// Returns count, rate and gaps of every stream. Reads the entire file; skips damaged parts.
    ///
    /// # Errors
    /// The file can no longer be read.
    pub fn streams(&self) -> Result<Vec<StreamInfo>, SessionError> {
        Ok(survey(self)?.streams)
    }
}

/// What a pass over the whole file finds.
struct Survey {
    streams: Vec<StreamInfo>,
    /// Damaged parts inside chunks.
    damage: Vec<SessionError>,
}

fn survey(session: &Session) -> Result<Survey, SessionError> {
    let container = &session.container;
    let (mut file, _) = open(session.path())?;
    let mut tallies: BTreeMap<&str, Tally> = BTreeMap::new();
    let mut counters: BTreeMap<Camera, Counter> = BTreeMap::new();
    let mut damage = Vec::new();
    // Its messages are read only to find those that cannot be.
    let mut events = session.events();
    for place in &container.chunks {
        let chunk = match container.unpack(&mut file, place)? {
            Ok(chunk) => chunk,
            Err(part) => {
                damage.push(session.damaged(&mut file, &part));
                continue;
            }
        };
        let (mut unreadable, mut end) = (Unreadable::default(), 0);
        for placed in records_in(&chunk) {
            let Ok(placed) = placed else {
                let reason = LEADS_OUT.to_owned();
                let part = DamagedPart::of_chunk(place.offset, &place.header, end, reason);
                damage.push(session.damaged(&mut file, &part));
                break;
            };
            end = placed.end as u64;
            let body = &chunk[placed.start..placed.end];
            let header = records::message_header(body).filter(|_| placed.opcode == op::MESSAGE);
            let Some(header) = header else { continue };
            let Some(channel) = session.channels.get(&header.channel_id) else {
                continue;
            };
            if let Some(Role::Image(camera)) = Role::from_topic(&channel.topic) {
                let counter = counters.entry(camera).or_default();
                counter.0.push((header.log_time, header.sequence));
            }
            let tally = tallies.entry(&channel.topic).or_default();
            tally.add(&header, body.len() as u64);
            events.read_message(&chunk, placed, &mut unreadable);
        }
        damage.extend(unreadable.error(session, place));
    }
    // Topics are sorted: a camera's base exposure comes before its brackets.
    let infos = tallies.into_iter().filter_map(|(topic, tally)| {
        let counter = match Role::from_topic(topic) {
            Some(Role::Image(camera)) => counters.remove(&camera),
            _ => None,
        };
        let lost = counter.map_or(0, |mut counter| counter.lost());
        tally.summarise(topic.to_owned(), lost)
    });
    Ok(Survey {
        streams: infos.collect(),
        damage,
    })
}

/// Returns the text of `penumbra info`.
#[must_use]
pub fn describe(session: &Session) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write_description(&mut text, session);
    text
}

fn write_description(text: &mut String, session: &Session) -> std::fmt::Result {
    let path = session.path().display();
    let megabytes = session.file_len() as f64 * 1e-6;
    write!(text, "{path}: {megabytes:.1} MB")?;
    let mut damage: Vec<_> = session.damage().iter().collect();
    let survey = survey(session);
    match &survey {
        Ok(survey) => {
            write_streams(text, &survey.streams)?;
            damage.extend(&survey.damage);
        }
        Err(error) => writeln!(text, "\n{error}")?,
    }
    if let Some(protocol) = session.tracker_protocol() {
        writeln!(text, "tracker protocol: {protocol}")?;
    }
    write_attachments(text, session)?;
    if session.truncated() {
        writeln!(
            text,
            "truncated: the recording was interrupted; its complete part is replayed"
        )?;
    }
    for part in damage.iter().take(MAX_LISTED) {
        writeln!(text, "{part}")?;
    }
    if damage.len() > MAX_LISTED {
        writeln!(text, "{} more damaged parts", damage.len() - MAX_LISTED)?;
    }
    Ok(())
}

fn write_streams(text: &mut String, streams: &[StreamInfo]) -> std::fmt::Result {
    let first = streams.iter().map(|s| s.first).min().unwrap_or_default();
    let last = streams.iter().map(|s| s.last).max().unwrap_or_default();
    writeln!(
        text,
        ", {:.3} s, {} streams",
        last.seconds_since(first),
        streams.len()
    )?;
    writeln!(
        text,
        "{:<36} {:>8} {:>9} {:>9} {:>5} {:>10} {:>5} {:>9}",
        "topic", "messages", "rate", "duration", "gaps", "longest", "lost", "bytes"
    )?;
    for stream in streams {
        let rate = stream
            .rate_hz
            .map_or("-".to_owned(), |rate| format!("{rate:.2} Hz"));
        writeln!(
            text,
            "{:<36} {:>8} {rate:>9} {:>7.3} s {:>5} {:>7.1} ms {:>5} {:>9}",
            stream.topic,
            stream.messages,
            stream.duration_seconds(),
            stream.gaps,
            stream.longest_interval_nanos as f64 * 1e-6,
            stream.lost,
            stream.bytes,
        )?;
    }
    Ok(())
}

fn write_attachments(text: &mut String, session: &Session) -> std::fmt::Result {
    writeln!(text, "{} attachments", session.attachments().len())?;
    for attachment in session.attachments() {
        writeln!(
            text,
            "  {:<34} {:>9} bytes",
            attachment.name,
            attachment.data.len()
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_time_stamps_are_no_overflow() {
        let tally = Tally {
            times: vec![0, i64::MAX / 2, i64::MAX],
            bytes: 3,
        };
        let info = tally.summarise("/scene_camera/image".to_owned(), 0);
        let info = info.unwrap();
        assert_eq!((info.messages, info.gaps), (3, 0));
    }
}
