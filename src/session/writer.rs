//! Writes a session.

use super::SessionError;
use super::container::is_inside;
use super::events::SessionEvent;
use super::journal::LightRecord;
use super::journal::{self, ControlsMessage, JournalMessage};
use super::messages::{self, ExposureMessage};
use super::sink::{Sink, Watched};
use super::topics::{self, BRACKET_EV, Camera, PROTOCOL};
use super::tracker_message;
use bytes::Bytes;
use foxglove::messages::{CameraCalibration, CompressedImage, RawImage};
use foxglove::{Encode, Schema};
use mcap::records::{AttachmentHeader, MessageHeader};
use mcap::{WriteOptions, Writer};
use penumbra_interface::{ControlsInForce, Frame, MonotonicTime, PoseSample, RigidTransform};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;
use std::sync::Arc;

/// Size of a chunk, bytes. A killed writer loses at most the last chunk, which with pictures is a
/// fraction of a second.
const CHUNK_BYTES: u64 = 1 << 20;

/// Writes a session. Complete chunks can be read even if [`Self::finish`] is never called.
pub struct SessionWriter<W: Write + Seek> {
    sink: Sink,
    writer: Writer<Watched<W>>,
    channels: BTreeMap<String, u16>,
    /// The last written controls of each camera.
    controls: BTreeMap<Camera, ControlsInForce>,
    /// The tracker's newest protocol, and its channel.
    tracker: Option<(String, u16)>,
    tracker_messages: u32,
}

impl SessionWriter<BufWriter<File>> {
    /// Creates a session in a new file.
    ///
    /// # Errors
    /// The file exists or cannot be created.
    pub fn create(path: &Path) -> Result<Self, SessionError> {
        Self::new(BufWriter::new(new_file(path)?), path)
    }
}

/// Creates the file of a session.
///
/// # Errors
/// The file exists or cannot be created.
pub fn new_file(path: &Path) -> Result<File, SessionError> {
    File::create_new(path).map_err(|source| {
        let path = path.to_owned();
        match source.kind() {
            io::ErrorKind::AlreadyExists => SessionError::Exists { path },
            _ => SessionError::Io { path, source },
        }
    })
}

impl<W: Write + Seek> SessionWriter<W> {
    /// Creates a session in `writer`; `path` is used in error messages.
    ///
    /// # Errors
    /// If nothing can be written.
    pub fn new(writer: W, path: &Path) -> Result<Self, SessionError> {
        // Not compressed: JPEG does not shrink, and a truncated file stays readable by hand.
        let options = WriteOptions::new()
            .profile("penumbra")
            .library(concat!("penumbra-", env!("CARGO_PKG_VERSION")))
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES));
        let (sink, watched) = Sink::watch(writer, path);
        match options.create(watched) {
            Ok(writer) => Ok(Self {
                sink,
                writer,
                channels: BTreeMap::new(),
                controls: BTreeMap::new(),
                tracker: None,
                tracker_messages: 0,
            }),
            Err(error) => Err(sink.error("the session", &error)),
        }
    }

    /// Attaches a file to the session. Attach files before writing streams, so that a truncated
    /// session still has them.
    ///
    /// # Errors
    /// The name is not a plain relative path, or the output fails.
    pub fn attach(&mut self, name: &str, data: &[u8]) -> Result<(), SessionError> {
        if !is_inside(name) {
            return Err(SessionError::AttachmentName {
                path: self.sink.path().to_owned(),
                name: name.to_owned(),
            });
        }
        let header = AttachmentHeader {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: media_type(name).to_owned(),
        };
        let writer = &mut self.writer;
        writer
            .start_attachment(data.len() as u64, header)
            .and_then(|()| writer.put_attachment_bytes(data))
            .and_then(|()| writer.finish_attachment())
            .map_err(|error| self.sink.error(name, &error))
    }

    /// Records a picture.
    ///
    /// # Errors
    /// If its times are before the clock's zero, or nothing can be written.
    pub fn frame(&mut self, camera: Camera, frame: &Frame) -> Result<(), SessionError> {
        if frame.exposure.is_some() || frame.sequence > u64::from(u32::MAX) {
            self.exposure(camera, frame)?;
        }
        self.controls(camera, frame)?;
        let raw = messages::is_raw(frame.format);
        let topic = camera.image_topic(frame.bracket_ev, raw);
        if !frame.bracket_ev.is_finite() {
            return Err(self.unrecordable(&topic, "its exposure bracket is no number"));
        }
        let stamp = messages::timestamp(frame.captured_at)
            .ok_or_else(|| self.unrecordable(&topic, "its capture time is before zero"))?;
        let metadata = [(BRACKET_EV.to_owned(), frame.bracket_ev.to_string())];
        let (schema, bytes) = if raw {
            let image = messages::raw_image(camera, frame, stamp);
            (RawImage::get_schema(), messages::encode(&image))
        } else {
            let image = messages::compressed_image(camera, frame, stamp);
            (CompressedImage::get_schema(), messages::encode(&image))
        };
        let bytes = bytes.map_err(|reason| self.unrecordable(&topic, &reason))?;
        let channel = self.channel(&topic, schema, "protobuf", metadata.into())?;
        let times = Times {
            arrived_at: frame.arrived_at,
            published_at: frame.captured_at,
        };
        // The low half of the counter; the exposure message has the full counter.
        self.message(channel, &topic, frame.sequence as u32, times, &bytes)
    }

    /// Records a composited picture, a JPEG, for viewers; it is not read back. `captured_at` is that of
    /// the scene camera's picture in it.
    ///
    /// # Errors
    /// If a time is before the clock's zero, or nothing can be written.
    pub fn composite(
        &mut self,
        jpeg: Bytes,
        captured_at: MonotonicTime,
        composed_at: MonotonicTime,
    ) -> Result<(), SessionError> {
        let topic = topics::COMPOSITE;
        let stamp = messages::timestamp(captured_at)
            .ok_or_else(|| self.unrecordable(topic, "its capture time is before zero"))?;
        let image = messages::composite_image(jpeg, stamp);
        let bytes = messages::encode(&image).map_err(|reason| self.unrecordable(topic, &reason))?;
        let schema = CompressedImage::get_schema();
        let channel = self.channel(topic, schema, "protobuf", BTreeMap::new())?;
        let times = Times {
            arrived_at: composed_at,
            published_at: captured_at,
        };
        self.message(channel, topic, 0, times, &bytes)
    }

    fn exposure(&mut self, camera: Camera, frame: &Frame) -> Result<(), SessionError> {
        let topic = camera.exposure_topic();
        let schema = Schema::new("penumbra.Exposure", "jsonschema", messages::EXPOSURE_SCHEMA);
        let bytes = serde_json::to_vec(&ExposureMessage::from_frame(frame))
            .map_err(|error| self.unrecordable(&topic, &error.to_string()))?;
        let channel = self.channel(&topic, Some(schema), "json", BTreeMap::new())?;
        let times = Times {
            arrived_at: frame.arrived_at,
            published_at: frame.captured_at,
        };
        self.message(channel, &topic, frame.sequence as u32, times, &bytes)
    }

    /// Records the active controls if they have changed.
    fn controls(&mut self, camera: Camera, frame: &Frame) -> Result<(), SessionError> {
        let Some(controls) = &frame.controls else {
            return Ok(());
        };
        let known = self.controls.get(&camera);
        if known.is_some_and(|known| Arc::ptr_eq(known, controls) || known == controls) {
            return Ok(());
        }
        let topic = camera.controls_topic();
        let schema = ("penumbra.Controls", journal::CONTROLS_SCHEMA);
        self.json(
            &topic,
            schema,
            &ControlsMessage::from_controls(controls),
            frame.arrived_at,
        )?;
        self.controls.insert(camera, Arc::clone(controls));
        Ok(())
    }

    /// Records that the time of pairing was advanced without an arrival.
    ///
    /// # Errors
    /// If the time is before the clock's zero, or nothing can be written.
    pub fn tick(&mut self, at: MonotonicTime) -> Result<(), SessionError> {
        self.journal(&JournalMessage::Tick {}, at)
    }

    /// Records, at `at`, that the scene camera's picture which arrived at `arrived_at` was prepared
    /// for the compositor, and its light.
    ///
    /// # Errors
    /// If the time is before the clock's zero, or nothing can be written.
    pub fn prepared(
        &mut self,
        arrived_at: MonotonicTime,
        light: Option<LightRecord>,
        at: MonotonicTime,
    ) -> Result<(), SessionError> {
        self.journal(&JournalMessage::prepared(arrived_at, light), at)
    }

    fn journal(&mut self, message: &JournalMessage, at: MonotonicTime) -> Result<(), SessionError> {
        let schema = ("penumbra.Journal", journal::JOURNAL_SCHEMA);
        self.json(topics::JOURNAL, schema, message, at)
    }

    fn json<M: serde::Serialize>(
        &mut self,
        topic: &str,
        (name, schema): (&str, &'static [u8]),
        message: &M,
        at: MonotonicTime,
    ) -> Result<(), SessionError> {
        let schema = Schema::new(name, "jsonschema", schema);
        let bytes = serde_json::to_vec(message)
            .map_err(|error| self.unrecordable(topic, &error.to_string()))?;
        let channel = self.channel(topic, Some(schema), "json", BTreeMap::new())?;
        self.message(channel, topic, 0, Times::at(at), &bytes)
    }

    /// Records an event of a [`Session`](super::Session).
    ///
    /// # Errors
    /// If one of its times is before the clock's zero, or nothing can be written.
    pub fn event(&mut self, event: &SessionEvent) -> Result<(), SessionError> {
        match event {
            SessionEvent::Scene(frame) => self.frame(Camera::Scene, frame),
            SessionEvent::Environment(frame) => self.frame(Camera::Environment, frame),
            SessionEvent::TrackerBytes {
                protocol,
                bytes,
                arrived_at,
            } => self.tracker_bytes(protocol, bytes, *arrived_at),
            SessionEvent::Pose(sample) => self.pose(sample),
            SessionEvent::Tick(at) => self.tick(*at),
            SessionEvent::Prepared {
                at,
                arrived_at,
                light,
            } => self.prepared(*arrived_at, *light, *at),
        }
    }

    /// Records bytes of the tracker as read; `protocol` names their protocol, e.g. `fastrak`.
    ///
    /// # Errors
    /// If the time is before the clock's zero, or nothing can be written.
    pub fn tracker_bytes(
        &mut self,
        protocol: &str,
        bytes: &[u8],
        arrived_at: MonotonicTime,
    ) -> Result<(), SessionError> {
        let topic = topics::TRACKER_BYTES;
        let channel = self.tracker_channel(protocol)?;
        let sequence = self.tracker_messages;
        self.tracker_messages = sequence.wrapping_add(1);
        let message = tracker_message::encode(bytes);
        self.message(channel, topic, sequence, Times::at(arrived_at), &message)
    }

    /// Returns the channel of a protocol. Each protocol has its own channel of the same topic.
    fn tracker_channel(&mut self, protocol: &str) -> Result<u16, SessionError> {
        if let Some((_, id)) = self.tracker.as_ref().filter(|(known, _)| known == protocol) {
            return Ok(*id);
        }
        let schema = tracker_message::schema();
        let schema = Schema::new("penumbra.TrackerBytes", "protobuf", schema);
        let metadata = [(PROTOCOL.to_owned(), protocol.to_owned())];
        let topic = topics::TRACKER_BYTES;
        let id = self.add_channel(topic, Some(schema), "protobuf", metadata.into())?;
        self.tracker = Some((protocol.to_owned(), id));
        Ok(id)
    }

    /// Records a pose of a tracker that is not a byte stream.
    ///
    /// # Errors
    /// If the time is before the clock's zero, or nothing can be written.
    pub fn pose(&mut self, sample: &PoseSample) -> Result<(), SessionError> {
        let child = messages::sensor_frame(sample.station);
        let pose = sample.transmitter_from_sensor;
        self.transform(
            topics::TRACKER_POSE,
            ("tracker", &child),
            pose,
            sample.arrived_at,
        )
    }

    /// Records `parent_from_child` for viewers; it is not read back.
    ///
    /// # Errors
    /// If the time is before the clock's zero, or nothing can be written.
    pub fn view_transform(
        &mut self,
        frames: (&str, &str),
        parent_from_child: RigidTransform,
        at: MonotonicTime,
    ) -> Result<(), SessionError> {
        self.transform(topics::FRAME_TREE, frames, parent_from_child, at)
    }

    fn transform(
        &mut self,
        topic: &str,
        (parent, child): (&str, &str),
        pose: RigidTransform,
        at: MonotonicTime,
    ) -> Result<(), SessionError> {
        let stamp = messages::timestamp(at)
            .ok_or_else(|| self.unrecordable(topic, "its time is before zero"))?;
        let transform = messages::frame_transform(parent, child, pose, stamp);
        self.schema_message(topic, &transform, at)
    }

    /// Records a camera's calibration for viewers; Penumbra itself reads the attachment `rig.json`.
    ///
    /// # Errors
    /// If the time is before the clock's zero, or nothing can be written.
    pub fn view_calibration(
        &mut self,
        camera: Camera,
        calibration: &CameraCalibration,
        at: MonotonicTime,
    ) -> Result<(), SessionError> {
        self.schema_message(&camera.calibration_topic(), calibration, at)
    }

    fn schema_message<M: Encode>(
        &mut self,
        topic: &str,
        message: &M,
        at: MonotonicTime,
    ) -> Result<(), SessionError> {
        let bytes =
            messages::encode(message).map_err(|reason| self.unrecordable(topic, &reason))?;
        let channel = self.channel(topic, M::get_schema(), "protobuf", BTreeMap::new())?;
        self.message(channel, topic, 0, Times::at(at), &bytes)
    }

    /// Closes the current chunk and flushes the output. A recorder calls this about every second.
    ///
    /// # Errors
    /// If nothing can be written.
    pub fn flush(&mut self) -> Result<(), SessionError> {
        self.writer
            .flush()
            .map_err(|error| self.sink.error("the session", &error))
    }

    /// Writes the index and the end of the file, and returns the writer.
    ///
    /// # Errors
    /// If nothing can be written.
    pub fn finish(self) -> Result<W, SessionError> {
        let Self {
            sink, mut writer, ..
        } = self;
        writer
            .finish()
            .map_err(|error| sink.error("the session's end", &error))?;
        let mut inner = writer.into_inner().into_inner();
        let path = sink.into_path();
        match inner.flush() {
            Ok(()) => Ok(inner),
            Err(source) => Err(SessionError::Io { path, source }),
        }
    }

    /// Returns the channel of a topic; creates it at the first use.
    fn channel(
        &mut self,
        topic: &str,
        schema: Option<Schema>,
        encoding: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<u16, SessionError> {
        if let Some(&id) = self.channels.get(topic) {
            return Ok(id);
        }
        let id = self.add_channel(topic, schema, encoding, metadata)?;
        self.channels.insert(topic.to_owned(), id);
        Ok(id)
    }

    fn add_channel(
        &mut self,
        topic: &str,
        schema: Option<Schema>,
        encoding: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<u16, SessionError> {
        let writer = &mut self.writer;
        let schema = schema.map_or(Ok(0), |schema| {
            writer.add_schema(&schema.name, &schema.encoding, &schema.data)
        });
        schema
            .and_then(|schema| writer.add_channel(schema, topic, encoding, &metadata))
            .map_err(|error| self.sink.error(topic, &error))
    }

    fn message(
        &mut self,
        channel_id: u16,
        topic: &str,
        sequence: u32,
        times: Times,
        data: &[u8],
    ) -> Result<(), SessionError> {
        let nanos = |time: MonotonicTime| u64::try_from(time.as_nanos()).ok();
        let (Some(log_time), Some(publish_time)) =
            (nanos(times.arrived_at), nanos(times.published_at))
        else {
            return Err(self.unrecordable(topic, "its time is before zero"));
        };
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time,
            publish_time,
        };
        self.writer
            .write_to_known_channel(&header, data)
            .map_err(|error| self.sink.error(topic, &error))
    }

    fn unrecordable(&self, what: &str, reason: &str) -> SessionError {
        self.sink.unrecordable(what, reason)
    }
}

/// Arrival of a message, and the time that it describes.
#[derive(Clone, Copy)]
struct Times {
    arrived_at: MonotonicTime,
    published_at: MonotonicTime,
}

impl Times {
    const fn at(time: MonotonicTime) -> Self {
        Self {
            arrived_at: time,
            published_at: time,
        }
    }
}

fn media_type(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("json") => "application/json",
        Some("png") => "image/png",
        Some("jpg" | "jpeg") => "image/jpeg",
        Some("glb") => "model/gltf-binary",
        Some("gltf") => "model/gltf+json",
        Some("csv") => "text/csv",
        Some("toml") => "application/toml",
        _ => "application/octet-stream",
    }
}
