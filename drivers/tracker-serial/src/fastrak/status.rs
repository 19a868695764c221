//! The answer to `S`: 55 bytes with the mode of the device (manual p. 69).

/// Length of a status record, bytes.
pub const STATUS_LEN: usize = 55;

/// A status record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Status {
    /// Station number, from 1.
    pub station: u8,
    /// Whether records are binary (`f`) rather than text (`F`).
    pub binary: bool,
    /// Whether positions are in centimetres (`u`) rather than inches (`U`).
    pub centimetres: bool,
    /// Whether the device sends continuously (`C`).
    pub continuous: bool,
    /// Result of the built-in test, three digits; `000` or blanks if it found no fault.
    pub self_test: [u8; 3],
    /// Version of the device's software, trimmed.
    pub version: String,
    /// The device's system identification text, trimmed.
    pub system: String,
}

impl Status {
    /// Parses exactly one status record. `None` if it is not one.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        is_status(bytes).then_some(())?;
        let flags = u16::from_str_radix(str::from_utf8(bytes.get(3..6)?).ok()?, 16).ok()?;
        Some(Self {
            station: bytes.get(1)? - b'0',
            binary: flags & 1 != 0,
            centimetres: flags & 2 != 0,
            continuous: flags & 8 != 0,
            self_test: bytes.get(6..9)?.try_into().ok()?,
            version: printable(bytes.get(15..21)?),
            system: printable(bytes.get(21..53)?),
        })
    }

    /// The first status record in `bytes`, at any position.
    #[must_use]
    pub fn find(bytes: &[u8]) -> Option<Self> {
        bytes.windows(STATUS_LEN).find_map(Self::parse)
    }
}

/// Whether `bytes` are exactly one status record, by the positions that are fixed.
pub(super) fn is_status(bytes: &[u8]) -> bool {
    let [b'2', station, b'S', flags @ ..] = bytes else {
        return false;
    };
    bytes.len() == STATUS_LEN
        && (b'1'..=b'4').contains(station)
        && flags.iter().take(3).all(u8::is_ascii_hexdigit)
        && bytes
            .iter()
            .take(STATUS_LEN - 2)
            .all(|b| (b' '..=b'~').contains(b))
        && bytes.ends_with(b"\r\n")
}

fn printable(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim().to_owned()
}
