//! USB/IP messages between the kernel's virtual host controller and a device.
//!
//! Source: Documentation/usb/usbip_protocol.rst of the kernel, from "USBIP_CMD_SUBMIT" on. All
//! numbers are big-endian except those of the setup packet, which is as on a USB cable.

use std::io::{self, Read};

const HEADER: usize = 48;
const CMD_SUBMIT: u32 = 1;
const CMD_UNLINK: u32 = 2;
const RET_SUBMIT: u32 = 3;
const RET_UNLINK: u32 = 4;

/// Status of a request that the device refuses: -EPIPE, which the kernel reads as STALL.
pub const STALLED: i32 = -32;
/// Status of an UNLINK that came in time: -ECONNRESET.
pub const UNLINKED: i32 = -104;

/// A request of the kernel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// A transfer.
    Submit(Submit),
    /// Cancels a transfer.
    Unlink {
        /// The number of this request.
        sequence: u32,
        /// The number of the transfer to cancel.
        target: u32,
    },
}

/// A transfer: its number, its endpoint and its data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submit {
    /// Number; later transfers have higher ones.
    pub sequence: u32,
    /// Whether the data go from the device to the host.
    pub to_host: bool,
    /// Endpoint; 0 is the control endpoint.
    pub endpoint: u32,
    /// Bytes that the host accepts or sends.
    pub length: usize,
    /// The setup packet, for the control endpoint.
    pub setup: Setup,
    /// Data from the host.
    pub data: Vec<u8>,
}

/// Setup packet of a control transfer (Universal Serial Bus 2.0, table 9-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Direction, type and recipient.
    pub kind: u8,
    /// Request code.
    pub request: u8,
    /// Its parameter.
    pub value: u16,
    /// Interface or endpoint, and the unit within it.
    pub index: u16,
    /// Maximum length of the data, bytes.
    pub length: u16,
}

impl From<[u8; 8]> for Setup {
    fn from(bytes: [u8; 8]) -> Self {
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Self {
            kind: bytes[0],
            request: bytes[1],
            value: word(2),
            index: word(4),
            length: word(6),
        }
    }
}

/// Reads one request.
///
/// # Errors
/// The socket is closed, or the data are no USB/IP request.
pub fn read_request(socket: &mut impl Read) -> io::Result<Request> {
    let mut header = [0; HEADER];
    socket.read_exact(&mut header)?;
    let sequence = word(&header, 4);
    match word(&header, 0) {
        CMD_UNLINK => Ok(Request::Unlink {
            sequence,
            target: word(&header, 20),
        }),
        CMD_SUBMIT => read_submit(socket, &header, sequence).map(Request::Submit),
        other => Err(io::Error::other(format!("no USB/IP command: {other}"))),
    }
}

fn read_submit(socket: &mut impl Read, header: &[u8; 48], sequence: u32) -> io::Result<Submit> {
    let to_host = word(header, 12) == 1;
    let length = word(header, 24) as usize;
    let mut data = vec![0; if to_host { 0 } else { length }];
    socket.read_exact(&mut data)?;
    let mut setup = [0; 8];
    setup.copy_from_slice(&header[40..]);
    Ok(Submit {
        sequence,
        to_host,
        endpoint: word(header, 16),
        length,
        setup: setup.into(),
        data,
    })
}

/// Encodes the answer to a transfer: status, number of bytes transferred, and data for the host.
#[must_use]
pub fn submit_reply(sequence: u32, status: i32, actual: usize, data: &[u8]) -> Vec<u8> {
    let mut message = reply(RET_SUBMIT, sequence, status);
    message[24..28].copy_from_slice(&(actual as u32).to_be_bytes());
    message.extend_from_slice(data);
    message
}

/// Encodes the answer to an UNLINK: [`UNLINKED`], or 0 if the transfer was answered before.
#[must_use]
pub fn unlink_reply(sequence: u32, status: i32) -> Vec<u8> {
    reply(RET_UNLINK, sequence, status)
}

fn reply(command: u32, sequence: u32, status: i32) -> Vec<u8> {
    let mut message = vec![0; HEADER];
    message[0..4].copy_from_slice(&command.to_be_bytes());
    message[4..8].copy_from_slice(&sequence.to_be_bytes());
    message[20..24].copy_from_slice(&status.to_be_bytes());
    message
}

fn word(header: &[u8; HEADER], at: usize) -> u32 {
    u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]])
}
