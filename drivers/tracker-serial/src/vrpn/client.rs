//! A VRPN client without I/O.

use super::wire::{self, COOKIE_LEN, MESSAGE_HEADER_LEN, POS_QUAT_LEN};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// Client and server must have the same major version; the minor one does not matter.
const MAGIC: &[u8] = b"vrpn: ver. 07.38";
const MAJOR: &[u8] = b"vrpn: ver. 07.";
/// Types of the messages that give a sender or a message type its name.
const SENDER_DESCRIPTION: i32 = -1;
const TYPE_DESCRIPTION: i32 = -2;
/// Type of the message with which the server ends the connection.
const DISCONNECT: i32 = -5;
/// Name of the message type that carries poses.
const POS_QUAT: &str = "vrpn_Tracker Pos_Quat";
/// Maximum length of a message, bytes; servers send far shorter ones.
const MESSAGE_LIMIT: usize = 1 << 16;
/// Maximum number of stored names; a server has far fewer.
const NAMES_LIMIT: usize = 4096;
/// Maximum length of a name, bytes; VRPN's own limit is 100.
const NAME_LIMIT: usize = 256;

/// The connection is unusable.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum VrpnError {
    /// The other end is no VRPN server.
    #[error("is no VRPN server: it answered {answered:?}")]
    NoServer {
        /// Its first characters.
        answered: String,
    },
    /// Another major version.
    #[error("speaks {version:?}; Penumbra speaks version 07 of VRPN")]
    Version {
        /// The version that it sent.
        version: String,
    },
    /// A message of an impossible length.
    #[error("sent a message of {length} bytes, which no VRPN server sends")]
    Length {
        /// Declared length, bytes.
        length: i64,
    },
    /// The server ended the connection.
    #[error("closed the connection")]
    Closed,
}

/// The state of one connection. Push what the server sends to get the messages of one tracker.
#[derive(Debug)]
pub struct Client {
    tracker: String,
    greeted: bool,
    buffer: Vec<u8>,
    /// Names by the numbers that the server gives them.
    senders: BTreeMap<i32, String>,
    types: BTreeMap<i32, String>,
    /// Numbers of the devices that have sent poses.
    moving: BTreeSet<i32>,
}

impl Client {
    /// A client for the tracker with this name at the server.
    #[must_use]
    pub fn new(tracker: &str) -> Self {
        Self {
            tracker: tracker.to_owned(),
            greeted: false,
            buffer: Vec::new(),
            senders: BTreeMap::new(),
            types: BTreeMap::new(),
            moving: BTreeSet::new(),
        }
    }

    /// The first message to the server: the cookie, then the names of the tracker and of the
    /// message type.
    #[must_use]
    pub fn greeting(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        // Two blanks, then the logging mode 0: none.
        bytes.extend(b"  0");
        bytes.resize(COOKIE_LEN, 0);
        bytes.extend(wire::message(
            0,
            SENDER_DESCRIPTION,
            &wire::name_payload(&self.tracker),
        ));
        bytes.extend(wire::message(
            0,
            TYPE_DESCRIPTION,
            &wire::name_payload(POS_QUAT),
        ));
        bytes
    }

    /// Whether the server has sent its cookie.
    #[must_use]
    pub const fn greeted(&self) -> bool {
        self.greeted
    }

    /// Names of devices that the server has sent so far. A server also repeats the name that the
    /// client has asked for, whether it has such a device or not.
    pub fn senders(&self) -> impl Iterator<Item = &str> {
        self.senders.values().map(String::as_str)
    }

    /// Names of the devices that have sent poses so far.
    pub fn trackers(&self) -> impl Iterator<Item = &str> {
        let name = |number| self.senders.get(number).map(String::as_str);
        self.moving.iter().filter_map(name)
    }

    /// Adds received bytes, which may be split anywhere, and appends every complete `Pos_Quat`
    /// message of the tracker to `messages`, unchanged.
    ///
    /// # Errors
    /// The other end is no VRPN server, has another version, or ends the connection. The connection
    /// is then unusable.
    pub fn push(&mut self, bytes: &[u8], messages: &mut Vec<u8>) -> Result<(), VrpnError> {
        self.buffer.extend_from_slice(bytes);
        let mut start = 0;
        if !self.greeted {
            let Some(cookie) = self.buffer.get(..COOKIE_LEN) else {
                return self.check_partial_cookie();
            };
            check_cookie(cookie)?;
            self.greeted = true;
            start = COOKIE_LEN;
        }
        // Names are copied out of the buffer while it is read.
        let buffer = std::mem::take(&mut self.buffer);
        let used = self.take_all(buffer.get(start..).unwrap_or_default(), messages);
        self.buffer = buffer;
        self.buffer.drain(..start + used?);
        Ok(())
    }

    /// Refuses a wrong beginning before the complete cookie has arrived.
    fn check_partial_cookie(&self) -> Result<(), VrpnError> {
        let available = self.buffer.len().min(MAJOR.len());
        match self.buffer.get(..available) == MAJOR.get(..available) {
            true => Ok(()),
            false => check_cookie(&self.buffer),
        }
    }

    /// Handles all complete messages at the front; returns their length in bytes.
    fn take_all(&mut self, bytes: &[u8], messages: &mut Vec<u8>) -> Result<usize, VrpnError> {
        let mut rest = bytes;
        while let Some(length) = wire::int_at(rest, 0) {
            let length = usize::try_from(length)
                .ok()
                .filter(|len| (MESSAGE_HEADER_LEN..=MESSAGE_LIMIT).contains(len))
                .ok_or(VrpnError::Length {
                    length: length.into(),
                })?;
            let Some((message, later)) = rest.split_at_checked(wire::padded(length)) else {
                break;
            };
            self.take(message.get(..length).unwrap_or(message), messages)?;
            rest = later;
        }
        Ok(bytes.len() - rest.len())
    }

    fn take(&mut self, message: &[u8], messages: &mut Vec<u8>) -> Result<(), VrpnError> {
        let (Some(sender), Some(kind)) = (wire::int_at(message, 12), wire::int_at(message, 16))
        else {
            return Ok(());
        };
        let payload = message.get(MESSAGE_HEADER_LEN..).unwrap_or_default();
        match kind {
            SENDER_DESCRIPTION => remember(&mut self.senders, sender, payload),
            TYPE_DESCRIPTION => remember(&mut self.types, sender, payload),
            DISCONNECT => return Err(VrpnError::Closed),
            _ if self.is_pose(kind) && message.len() == POS_QUAT_LEN => {
                if self.moving.len() < NAMES_LIMIT {
                    self.moving.insert(sender);
                }
                if self.is_of_tracker(sender) {
                    messages.extend_from_slice(message);
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn is_pose(&self, kind: i32) -> bool {
        self.types.get(&kind).is_some_and(|name| name == POS_QUAT)
    }

    fn is_of_tracker(&self, sender: i32) -> bool {
        let name = self.senders.get(&sender);
        name.is_some_and(|name| *name == self.tracker)
    }
}

fn remember(names: &mut BTreeMap<i32, String>, number: i32, payload: &[u8]) {
    let is_short = |name: &&str| names.len() < NAMES_LIMIT && name.len() <= NAME_LIMIT;
    if let Some(name) = wire::name_in(payload).filter(is_short) {
        names.insert(number, name.to_owned());
    }
}

fn check_cookie(cookie: &[u8]) -> Result<(), VrpnError> {
    if cookie.starts_with(MAJOR) {
        return Ok(());
    }
    let text: String = String::from_utf8_lossy(cookie)
        .chars()
        .take_while(|character| *character != '\0')
        .take(MAGIC.len())
        .collect();
    Err(if text.starts_with("vrpn: ver.") {
        VrpnError::Version { version: text }
    } else {
        VrpnError::NoServer { answered: text }
    })
}

#[cfg(test)]
mod tests;
