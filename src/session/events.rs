//! Events of a session in the order of arrival.

use super::SessionError;
use super::container::{ChunkLocation, DamagedPart, open};
use super::journal::{ControlsMessage, JournalMessage, LightRecord};
use super::loss::LossTally;
use super::messages::{self, ExposureMessage, FrameContext, recorded_time};
use super::reader::Session;
use super::records::{self, Channel, MESSAGE_HEADER, MessageHeader, Placed, op, records_in};
use super::topics::{BRACKET_EV, Camera, PROTOCOL, Role};
use super::tracker_message;
use bytes::Bytes;
use penumbra_interface::{ControlsInForce, Frame, MonotonicTime, PoseSample};
use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap, VecDeque};
use std::fs::File;
use std::io::BufReader;
use std::sync::Arc;

/// Maximum number of bytes that wait to be sorted where chunks overlap in time. Beyond it (which no
/// recording reaches) the events keep the file's order.
const MAX_PENDING_BYTES: usize = 512 << 20;

/// Why the rest of a chunk cannot be read.
pub(super) const LEADS_OUT: &str = "a record leads out of its chunk";

/// A recorded event.
#[derive(Clone, Debug)]
pub enum SessionEvent {
    /// A picture of the scene camera.
    Scene(Frame),
    /// A picture of the environment camera; `bracket_ev` identifies its exposure within a bracket.
    Environment(Frame),
    /// Bytes of the tracker, in the portions in which they were read.
    TrackerBytes {
        /// Their protocol; empty if unknown.
        protocol: Arc<str>,
        /// The bytes.
        bytes: Bytes,
        /// Arrival of the last byte.
        arrived_at: MonotonicTime,
    },
    /// A pose of a tracker that is not a byte stream.
    Pose(PoseSample),
    /// The live rig advanced the time of pairing without an arrival.
    Tick(MonotonicTime),
    /// The live rig prepared a picture of the scene camera for the compositor. It skipped the
    /// pictures between two of these events.
    Prepared {
        /// Time of the preparation.
        at: MonotonicTime,
        /// Arrival of the picture.
        arrived_at: MonotonicTime,
        /// Its light. `None` in older recordings, where the light estimator used each of these
        /// pictures and each was rendered in the light of the previous one.
        light: Option<LightRecord>,
    },
}

impl SessionEvent {
    /// Arrival at the recorder.
    #[must_use]
    pub const fn arrived_at(&self) -> MonotonicTime {
        match self {
            Self::Scene(frame) | Self::Environment(frame) => frame.arrived_at,
            Self::TrackerBytes { arrived_at, .. } => *arrived_at,
            Self::Pose(sample) => sample.arrived_at,
            Self::Tick(at) | Self::Prepared { at, .. } => *at,
        }
    }

    /// Number of bytes that the event holds in memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Scene(frame) | Self::Environment(frame) => frame.data.len(),
            Self::TrackerBytes { bytes, .. } => bytes.len(),
            Self::Pose(_) | Self::Tick(_) | Self::Prepared { .. } => size_of::<Self>(),
        }
    }
}

/// Iterator over a session; see [`Session::events`]. An error stands for a damaged part, which is
/// skipped; the iteration continues after it.
#[derive(Debug)]
pub struct Events {
    session: Session,
    file: Option<BufReader<File>>,
    next_chunk: usize,
    pending: BinaryHeap<Reverse<Pending>>,
    pending_bytes: usize,
    errors: VecDeque<SessionError>,
    /// The newest exposure message of each camera, for the image after it.
    exposures: BTreeMap<Camera, ExposureMessage>,
    /// The newest controls of each camera.
    controls: BTreeMap<Camera, ControlsInForce>,
    /// The tracker's newest protocol.
    protocol: Arc<str>,
    /// Number of messages read; keeps the file's order among equal times.
    ordinal: u64,
}

#[derive(Debug)]
struct Pending {
    log_time: u64,
    ordinal: u64,
    event: SessionEvent,
}

impl Pending {
    const fn key(&self) -> (u64, u64) {
        (self.log_time, self.ordinal)
    }
}

impl PartialEq for Pending {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Pending {}

impl PartialOrd for Pending {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Pending {
    fn cmp(&self, other: &Self) -> Ordering {
        self.key().cmp(&other.key())
    }
}

/// The messages of one chunk that cannot be read.
#[derive(Debug, Default)]
pub(super) struct Unreadable {
    /// Of the first one.
    reason: Option<String>,
    lost: LossTally,
}

impl Unreadable {
    fn add(&mut self, message: Option<(&str, u64)>, reason: String) {
        self.reason.get_or_insert(reason);
        if let Some((topic, log_time)) = message {
            self.lost.add(topic, log_time);
        }
    }

    /// Returns the error of the chunk; `None` if all messages could be read.
    pub(super) fn error(self, session: &Session, place: &ChunkLocation) -> Option<SessionError> {
        let lost = self.lost.into_lost(session.container.start_time());
        Some(session.damage_error(place.offset, self.reason?, lost))
    }
}

impl Iterator for Events {
    type Item = Result<SessionEvent, SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(error) = self.errors.pop_front() {
                return Some(Err(error));
            }
            if let Some(place) = self.chunk_due() {
                self.next_chunk += 1;
                if let Err(error) = self.load(&place) {
                    self.errors.push_back(error);
                }
                continue;
            }
            let Reverse(pending) = self.pending.pop()?;
            self.pending_bytes -= pending.event.bytes();
            return Some(Ok(pending.event));
        }
    }
}

impl Session {
    /// Returns all recorded events in the order of arrival, from the beginning. Each call starts
    /// again, so a loop over the session needs no more memory than one pass.
    #[must_use]
    pub fn events(&self) -> Events {
        Events::new(self.clone())
    }
}

impl Events {
    fn new(session: Session) -> Self {
        Self {
            session,
            file: None,
            next_chunk: 0,
            pending: BinaryHeap::new(),
            pending_bytes: 0,
            errors: VecDeque::new(),
            exposures: BTreeMap::new(),
            controls: BTreeMap::new(),
            protocol: Arc::from(""),
            ordinal: 0,
        }
    }

    /// Returns the next chunk, if one of its messages may be earlier than all pending ones.
    fn chunk_due(&self) -> Option<ChunkLocation> {
        let place = self.session.container.chunks.get(self.next_chunk)?;
        let due = self.pending.peek().is_none_or(|Reverse(first)| {
            place.header.start_time <= first.log_time && self.pending_bytes < MAX_PENDING_BYTES
        });
        due.then(|| place.clone())
    }

    fn load(&mut self, place: &ChunkLocation) -> Result<(), SessionError> {
        let mut file = match self.file.take() {
            Some(file) => file,
            None => open(self.session.path())?.0,
        };
        let outcome = self.load_from(&mut file, place);
        self.file = Some(file);
        outcome
    }

    fn load_from(
        &mut self,
        file: &mut BufReader<File>,
        place: &ChunkLocation,
    ) -> Result<(), SessionError> {
        let session = self.session.clone();
        let chunk = match session.container.unpack(file, place)? {
            Ok(chunk) => chunk,
            Err(part) => return Err(session.damaged(file, &part)),
        };
        let (mut unreadable, mut end) = (Unreadable::default(), 0);
        for placed in records_in(&chunk) {
            let Ok(placed) = placed else {
                let reason = LEADS_OUT.to_owned();
                let part = DamagedPart::of_chunk(place.offset, &place.header, end, reason);
                self.errors.push_back(session.damaged(file, &part));
                break;
            };
            end = placed.end as u64;
            if placed.opcode != op::MESSAGE {
                continue;
            }
            if let Some((event, log_time)) = self.read_message(&chunk, placed, &mut unreadable) {
                self.add(event, log_time);
            }
        }
        self.errors.extend(unreadable.error(&session, place));
        Ok(())
    }

    /// Reads a message of a known stream; counts one that cannot be read.
    pub(super) fn read_message(
        &mut self,
        chunk: &Bytes,
        placed: Placed,
        unreadable: &mut Unreadable,
    ) -> Option<(SessionEvent, u64)> {
        let body = chunk.slice(placed.start..placed.end);
        let Some(header) = records::message_header(&body) else {
            unreadable.add(None, "a message without header".to_owned());
            return None;
        };
        let data = body.slice(MESSAGE_HEADER..);
        let channels = Arc::clone(&self.session.channels);
        let Some(channel) = channels.get(&header.channel_id) else {
            let reason = format!("a message of unknown channel {}", header.channel_id);
            unreadable.add(None, reason);
            return None;
        };
        match self.event(channel, &header, data) {
            Ok(event) => Some((event?, header.log_time)),
            Err(reason) => {
                unreadable.add(Some((&channel.topic, header.log_time)), reason);
                None
            }
        }
    }

    /// Adds an event to the pending ones.
    fn add(&mut self, event: SessionEvent, log_time: u64) {
        self.ordinal += 1;
        self.pending_bytes += event.bytes();
        // A live rig's recording is in the order of arrival.
        let in_file_order = self.session.has_journal();
        self.pending.push(Reverse(Pending {
            log_time: if in_file_order { 0 } else { log_time },
            ordinal: self.ordinal,
            event,
        }));
    }

    fn event(
        &mut self,
        channel: &Channel,
        header: &MessageHeader,
        data: Bytes,
    ) -> Result<Option<SessionEvent>, String> {
        let arrived_at = recorded_time(header.log_time);
        let event = match Role::from_topic(&channel.topic) {
            Some(Role::Image(camera)) => {
                let frame = self.frame(camera, channel, header, data)?;
                match camera {
                    Camera::Scene => SessionEvent::Scene(frame),
                    Camera::Environment => SessionEvent::Environment(frame),
                }
            }
            Some(Role::Exposure(camera)) => {
                let message = serde_json::from_slice(&data).map_err(|e| e.to_string())?;
                self.exposures.insert(camera, message);
                return Ok(None);
            }
            Some(Role::Controls(camera)) => {
                let message: ControlsMessage =
                    serde_json::from_slice(&data).map_err(|e| e.to_string())?;
                self.controls.insert(camera, message.in_force());
                return Ok(None);
            }
            Some(Role::Journal) => {
                match serde_json::from_slice(&data).map_err(|e| e.to_string())? {
                    JournalMessage::Tick {} => SessionEvent::Tick(arrived_at),
                    JournalMessage::Prepared {
                        arrived_at: of,
                        seen,
                        lit_by,
                    } => SessionEvent::Prepared {
                        at: arrived_at,
                        arrived_at: MonotonicTime::from_nanos(of),
                        light: seen.map(|seen| LightRecord {
                            seen,
                            lit_by: lit_by.map(MonotonicTime::from_nanos),
                        }),
                    },
                }
            }
            Some(Role::TrackerBytes) => SessionEvent::TrackerBytes {
                protocol: self.protocol_of(channel),
                bytes: tracker_message::decode(&data)?,
                arrived_at,
            },
            Some(Role::TrackerPose) => SessionEvent::Pose(messages::pose_sample(data, arrived_at)?),
            None => return Ok(None),
        };
        Ok(Some(event))
    }

    /// Returns the protocol's name, shared between messages because it rarely changes.
    fn protocol_of(&mut self, channel: &Channel) -> Arc<str> {
        let named = channel.metadata.get(PROTOCOL).map_or("", String::as_str);
        if *self.protocol != *named {
            self.protocol = Arc::from(named);
        }
        Arc::clone(&self.protocol)
    }

    fn frame(
        &mut self,
        camera: Camera,
        channel: &Channel,
        header: &MessageHeader,
        data: Bytes,
    ) -> Result<Frame, String> {
        let bracket = channel.metadata.get(BRACKET_EV);
        let bracket_ev = match bracket.map(|text| text.parse::<f64>()) {
            None => 0.0,
            Some(Ok(ev)) if ev.is_finite() => ev,
            Some(_) => return Err(format!("{BRACKET_EV} {bracket:?} is no number")),
        };
        // Valid for one image only: a camera counts from 0 again when it is reopened.
        let message = self.exposures.remove(&camera).filter(|m| {
            m.sequence as u32 == header.sequence && (m.bracket_ev - bracket_ev).abs() < 1e-9
        });
        let sequence = message.as_ref().map(|m| m.sequence);
        let context = FrameContext {
            sequence: sequence.unwrap_or(u64::from(header.sequence)),
            published_at: recorded_time(header.publish_time),
            arrived_at: recorded_time(header.log_time),
            exposure: message.as_ref().and_then(ExposureMessage::exposure),
            bracket_ev,
        };
        let frame = if channel.topic.contains("/image_raw") {
            messages::frame_from_raw(data, context)?
        } else {
            messages::frame_from_compressed(data, context)?
        };
        Ok(Frame {
            controls: self.controls.get(&camera).cloned(),
            ..frame
        })
    }
}
