//! A VRPN client without I/O.

use super::wire::{self, COOKIE_LEN, MESSAGE_HEADER_LEN, POS_QUAT_LEN};
use std::collections::BTreeMap;
use thiserror::Error;

/// The same major version is spoken; what follows the dot does not matter.
const MAGIC: &[u8] = b"vrpn: ver. 07.38";
const MAJOR: &[u8] = b"vrpn: ver. 07.";
/// Numbers of the messages that describe names.
const SENDER_DESCRIPTION: i32 = -1;
const TYPE_DESCRIPTION: i32 = -2;
/// The server takes its leave.
const DISCONNECT: i32 = -5;
/// The type whose messages are wanted.
const POS_QUAT: &str = "vrpn_Tracker Pos_Quat";
/// Servers send nothing that is nearly as long.
const MESSAGE_LIMIT: usize = 1 << 16;
/// More names than this are no server's.
const NAMES_LIMIT: usize = 4096;

/// The server's bytes make no sense, or no use. Each text says what was seen.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum VrpnError {
    /// What answered is no VRPN server.
    #[error("is no VRPN server: it answered {answered:?}")]
    NoServer {
        /// Its first characters.
        answered: String,
    },
    /// Another major version.
    #[error("speaks {version:?}; Penumbra speaks version 07 of VRPN")]
    Version {
        /// What it says.
        version: String,
    },
    /// A message that cannot be.
    #[error("sent a message of {length} bytes, which no VRPN server sends")]
    Length {
        /// Declared length.
        length: i64,
    },
    /// It said good-bye.
    #[error("closed the connection")]
    Closed,
}

/// One connection's state. Push what the server sends; what is wanted comes out.
#[derive(Debug)]
pub struct Client {
    tracker: String,
    greeted: bool,
    buffer: Vec<u8>,
    /// Names by the server's numbers.
    senders: BTreeMap<i32, String>,
    types: BTreeMap<i32, String>,
}

impl Client {
    /// A client of the tracker with this name at the server.
    #[must_use]
    pub fn new(tracker: &str) -> Self {
        Self {
            tracker: tracker.to_owned(),
            greeted: false,
            buffer: Vec::new(),
            senders: BTreeMap::new(),
            types: BTreeMap::new(),
        }
    }

    /// What to send on connecting: the cookie, then this side's names for the tracker and
    /// the type.
    #[must_use]
    pub fn greeting(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        // Two blanks and the logging mode: none.
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

    /// Whether the server has shown its cookie.
    #[must_use]
    pub const fn greeted(&self) -> bool {
        self.greeted
    }

    /// Names of the server's devices, as far as it has told.
    pub fn senders(&self) -> impl Iterator<Item = &str> {
        self.senders.values().map(String::as_str)
    }

    /// Takes bytes, split anywhere, and appends to `wanted` every whole `Pos_Quat` message
    /// of the tracker, as it came.
    ///
    /// # Errors
    /// When the server is none, or another version's, or goes. The connection is of no use
    /// after that.
    pub fn push(&mut self, bytes: &[u8], wanted: &mut Vec<u8>) -> Result<(), VrpnError> {
        self.buffer.extend_from_slice(bytes);
        let mut start = 0;
        if !self.greeted {
            let Some(cookie) = self.buffer.get(..COOKIE_LEN) else {
                return self.foreign_so_far();
            };
            check_cookie(cookie)?;
            self.greeted = true;
            start = COOKIE_LEN;
        }
        // Names are copied out of the buffer while it is read.
        let buffer = std::mem::take(&mut self.buffer);
        let used = self.messages(buffer.get(start..).unwrap_or_default(), wanted);
        self.buffer = buffer;
        self.buffer.drain(..start + used?);
        Ok(())
    }

    /// Fewer bytes than a cookie: wrong ones tell already.
    fn foreign_so_far(&self) -> Result<(), VrpnError> {
        let shown = self.buffer.len().min(MAJOR.len());
        match self.buffer.get(..shown) == MAJOR.get(..shown) {
            true => Ok(()),
            false => check_cookie(&self.buffer),
        }
    }

    /// Takes all whole messages off the front; how many bytes they were.
    fn messages(&mut self, bytes: &[u8], wanted: &mut Vec<u8>) -> Result<usize, VrpnError> {
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
            self.take(message.get(..length).unwrap_or(message), wanted)?;
            rest = later;
        }
        Ok(bytes.len() - rest.len())
    }

    fn take(&mut self, message: &[u8], wanted: &mut Vec<u8>) -> Result<(), VrpnError> {
        let (Some(sender), Some(kind)) = (wire::int_at(message, 12), wire::int_at(message, 16))
        else {
            return Ok(());
        };
        let payload = message.get(MESSAGE_HEADER_LEN..).unwrap_or_default();
        match kind {
            SENDER_DESCRIPTION => note(&mut self.senders, sender, payload),
            TYPE_DESCRIPTION => note(&mut self.types, sender, payload),
            DISCONNECT => return Err(VrpnError::Closed),
            _ if self.is_wanted(sender, kind) && message.len() == POS_QUAT_LEN => {
                wanted.extend_from_slice(message);
            }
            _ => {}
        }
        Ok(())
    }

    fn is_wanted(&self, sender: i32, kind: i32) -> bool {
        self.senders
            .get(&sender)
            .is_some_and(|name| *name == self.tracker)
            && self.types.get(&kind).is_some_and(|name| name == POS_QUAT)
    }
}

fn note(names: &mut BTreeMap<i32, String>, number: i32, payload: &[u8]) {
    if let Some(name) = wire::name_in(payload).filter(|_| names.len() < NAMES_LIMIT) {
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
