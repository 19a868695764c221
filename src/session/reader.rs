//! A session opened for replay.

use super::SessionError;
use super::container::{Attachment, Container, DamagedPart, open};
use super::loss::LostMessages;
use super::messages::recorded_time;
use super::records::{self, Channel, op, records_in};
use super::topics::{self, Camera, Role};
use penumbra_interface::MonotonicTime;
use std::collections::BTreeMap;
use std::io::{Read, Seek};
use std::path::Path;
use std::sync::Arc;

/// A recorded session. Holds its attachments and the positions of its chunks; pictures are read on
/// demand. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Session {
    pub(super) container: Arc<Container>,
    pub(super) channels: Arc<BTreeMap<u16, Channel>>,
    damage: Arc<Vec<SessionError>>,
}

impl Session {
    /// Opens the session at `path`.
    ///
    /// # Errors
    /// The file is missing, empty, not an MCAP file, not a session, truncated before its first
    /// complete chunk, or has an attachment that is too large or whose name leads outside.
    pub fn open(path: &Path) -> Result<Self, SessionError> {
        let container = Container::scan(path)?;
        let mut channels = container.channels.clone();
        if container.truncated || channels.is_empty() {
            collect_channels(&container, &mut channels)?;
        }
        check_known(&container, &channels)?;
        let mut session = Self {
            container: Arc::new(container),
            channels: Arc::new(channels),
            damage: Arc::default(),
        };
        let (mut file, _) = open(path)?;
        let parts = session.container.damage.iter();
        let damage = parts.map(|part| session.damaged(&mut file, part)).collect();
        session.damage = Arc::new(damage);
        Ok(session)
    }

    /// Returns the error of a damaged part, with what it held.
    pub(super) fn damaged(
        &self,
        file: &mut (impl Read + Seek),
        part: &DamagedPart,
    ) -> SessionError {
        let topic = |id| self.channels.get(&id).map(|channel| channel.topic.clone());
        let lost = self.container.lost(file, part, topic);
        self.damage_error(part.offset, part.reason.clone(), lost)
    }

    /// Returns the error of a damaged part that held `lost`.
    pub(super) fn damage_error(
        &self,
        offset: u64,
        reason: String,
        lost: Vec<LostMessages>,
    ) -> SessionError {
        SessionError::Damaged {
            path: self.path().to_owned(),
            offset,
            reason,
            lost,
        }
    }

    /// Path of the session.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.container.path
    }

    /// Size of the file, bytes.
    #[must_use]
    pub fn file_len(&self) -> u64 {
        self.container.len
    }

    /// Returns the newest attachment of a name.
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

    /// Returns whether the end of the file is missing, because the writer was killed or the file
    /// was truncated. Complete chunks are still replayed.
    #[must_use]
    pub fn truncated(&self) -> bool {
        self.container.truncated
    }

    /// Damaged parts found while opening the file. Damage inside a chunk is reported only by
    /// [`Self::events`].
    #[must_use]
    pub fn damage(&self) -> &[SessionError] {
        &self.damage
    }

    /// Share of the recording, 0..=1, that arrived by `at`; `None` if it has no duration.
    #[must_use]
    pub fn progress_at(&self, at: MonotonicTime) -> Option<f64> {
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

    /// Returns whether the recording has a journal of a live rig. Such a file is in the order of
    /// arrival.
    #[must_use]
    pub fn has_journal(&self) -> bool {
        self.channels.values().any(|c| c.topic == topics::JOURNAL)
    }

    /// Protocol of the recorded tracker bytes, e.g. `fastrak`; `None` without tracker bytes.
    #[must_use]
    pub fn tracker_protocol(&self) -> Option<&str> {
        let tracker = |channel: &&Channel| channel.topic == topics::TRACKER_BYTES;
        let channel = self.channels.values().find(tracker)?;
        channel.metadata.get(topics::PROTOCOL).map(String::as_str)
    }

    /// Returns whether the recording has pictures of the environment camera.
    #[must_use]
    pub fn has_environment(&self) -> bool {
        let start = format!("/{}/image", Camera::Environment.frame_id());
        self.channels.values().any(|c| c.topic.starts_with(&start))
    }
}

/// Adds the channels described in chunks, for a truncated file.
fn collect_channels(
    container: &Container,
    channels: &mut BTreeMap<u16, Channel>,
) -> Result<(), SessionError> {
    let (mut file, _) = open(&container.path)?;
    for place in &container.chunks {
        let Ok(Ok(chunk)) = container.unpack(&mut file, place) else {
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

/// Checks that the file is a session: it has pictures of the scene camera.
fn check_known(
    container: &Container,
    channels: &BTreeMap<u16, Channel>,
) -> Result<(), SessionError> {
    let roles = || {
        channels
            .values()
            .map(|channel| Role::from_topic(&channel.topic))
    };
    if roles().any(|role| role == Some(Role::Image(Camera::Scene))) {
        return Ok(());
    }
    let path = container.path.clone();
    if container.truncated && (channels.is_empty() || roles().any(|role| role.is_some())) {
        return Err(SessionError::NoCompleteChunk { path });
    }
    // Names of others may hold line breaks, or be as long as the file.
    let name = |channel: &Channel| channel.topic.escape_debug().take(64).collect::<String>();
    let topics: Vec<String> = channels.values().take(8).map(name).collect();
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
