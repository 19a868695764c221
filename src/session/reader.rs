//! A session opened for replay.

use super::SessionError;
use super::container::{Container, open};
use super::events::{Events, recorded_time};
use super::info::{self, StreamInfo};
use super::records::{self, Channel, op, records_in};
use super::topics::{self, Camera, Role};
use bytes::Bytes;
use penumbra_interface::MonotonicTime;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A file inside a session: calibration, virtual object, phantom object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Plain relative path with `/`, such as `object/object.glb`.
    pub name: String,
    /// Such as `application/json`.
    pub media_type: String,
    /// The file.
    pub data: Bytes,
}

/// A recorded session. Holds its attachments and the places of its chunks; pictures are
/// read as they are asked for. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Session {
    pub(super) container: Arc<Container>,
    pub(super) channels: Arc<BTreeMap<u16, Channel>>,
}

impl Session {
    /// Opens the session at `path`.
    ///
    /// # Errors
    /// If it is missing, empty, no MCAP file, an MCAP file of something else, cut off
    /// before its first whole chunk, or holds an attachment that is too large or named to
    /// lead outside.
    pub fn open(path: &Path) -> Result<Self, SessionError> {
        let container = Container::scan(path)?;
        let mut channels = container.channels.clone();
        if container.truncated || channels.is_empty() {
            collect_channels(&container, &mut channels)?;
        }
        check_known(&container, &channels)?;
        Ok(Self {
            container: Arc::new(container),
            channels: Arc::new(channels),
        })
    }

    /// Where the session is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.container.path
    }

    /// Size of the file, bytes.
    #[must_use]
    pub fn file_len(&self) -> u64 {
        self.container.len
    }

    /// The newest attachment of this name.
    #[must_use]
    pub fn attachment(&self, name: &str) -> Option<&[u8]> {
        let named = |attachment: &&Attachment| attachment.name == name;
        let found = self.container.attachments.iter().rev().find(named)?;
        Some(&found.data)
    }

    /// All attachments, in the order of the file.
    #[must_use]
    pub fn attachments(&self) -> &[Attachment] {
        &self.container.attachments
    }

    /// Whether the end that a finished writer puts there is missing: the writer was
    /// killed, or the file cut off. What is whole is replayed.
    #[must_use]
    pub fn truncated(&self) -> bool {
        self.container.truncated
    }

    /// Stretches of the file that opening it found damaged. Damage inside a chunk shows
    /// only in [`Self::events`].
    #[must_use]
    pub fn damage(&self) -> &[SessionError] {
        &self.container.damage
    }

    /// Share of the recording, 0..=1, that has arrived by `at`; `None` when it has no length.
    #[must_use]
    pub fn share_played(&self, at: MonotonicTime) -> Option<f64> {
        let chunks = self.container.chunks.iter().map(|chunk| &chunk.header);
        let start = chunks.clone().map(|c| c.start_time).min()?;
        let end = chunks.map(|c| c.end_time).max()?;
        let passed = (i128::from(at.as_nanos()) - i128::from(start)) as f64;
        (end > start).then(|| (passed / (end - start) as f64).clamp(0.0, 1.0))
    }

    /// First and last arrival; `None` for a recording without messages.
    #[must_use]
    pub fn span(&self) -> Option<(MonotonicTime, MonotonicTime)> {
        let chunks = self.container.chunks.iter().map(|chunk| &chunk.header);
        let start = chunks.clone().map(|c| c.start_time).min()?;
        let end = chunks.map(|c| c.end_time).max()?;
        Some((recorded_time(start), recorded_time(end)))
    }

    /// Whether a live rig recorded it while it composed, and so wrote down what it made of
    /// the streams. The order of such a file is the order of arrival.
    #[must_use]
    pub fn has_journal(&self) -> bool {
        self.channels.values().any(|c| c.topic == topics::JOURNAL)
    }

    /// Protocol of the recorded tracker bytes, such as `fastrak`; `None` if there are none.
    #[must_use]
    pub fn tracker_protocol(&self) -> Option<&str> {
        let tracker = |channel: &&Channel| channel.topic == topics::TRACKER_BYTES;
        let channel = self.channels.values().find(tracker)?;
        channel.metadata.get(topics::PROTOCOL).map(String::as_str)
    }

    /// The recording has a channel of the environment camera.
    #[must_use]
    pub fn has_environment(&self) -> bool {
        let start = format!("/{}/image", Camera::Environment.frame_id());
        self.channels.values().any(|c| c.topic.starts_with(&start))
    }

    /// Everything recorded, in the order of arrival, from the beginning. Each call starts
    /// anew, so a loop over the session needs no more memory than one pass.
    #[must_use]
    pub fn events(&self) -> Events {
        Events::new(self.clone())
    }

    /// Count, rate and gaps of every stream. Reads the whole file.
    ///
    /// # Errors
    /// If the file cannot be read any more; damaged chunks are left out.
    pub fn streams(&self) -> Result<Vec<StreamInfo>, SessionError> {
        info::streams(self)
    }
}

/// Adds the channels that chunks describe, for a file that was not finished.
fn collect_channels(
    container: &Container,
    channels: &mut BTreeMap<u16, Channel>,
) -> Result<(), SessionError> {
    let (mut file, _) = open(&container.path)?;
    for place in &container.chunks {
        let Ok(chunk) = container.unpack(&mut file, place) else {
            continue;
        };
        let listed = records_in(&chunk)
            .map_while(Result::ok)
            .filter(|placed| placed.opcode == op::CHANNEL)
            .filter_map(|placed| records::channel(&chunk[placed.start..placed.end]));
        channels.extend(listed.map(|channel| (channel.id, channel)));
    }
    Ok(())
}

/// A session has at least pictures of the scene camera.
fn check_known(
    container: &Container,
    channels: &BTreeMap<u16, Channel>,
) -> Result<(), SessionError> {
    let roles = || channels.values().map(|channel| Role::of(&channel.topic));
    if roles().any(|role| role == Some(Role::Image(Camera::Scene))) {
        return Ok(());
    }
    let path = container.path.clone();
    if container.truncated && (channels.is_empty() || roles().any(|role| role.is_some())) {
        return Err(SessionError::NothingWhole { path });
    }
    let mut topics: Vec<_> = channels.values().map(|c| c.topic.as_str()).collect();
    topics.truncate(8);
    Err(SessionError::Foreign {
        path,
        expected: topics::SCENE_IMAGES,
        topics: if topics.is_empty() {
            "none at all".to_owned()
        } else {
            topics.join(", ")
        },
    })
}
