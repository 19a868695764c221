//! The answer to `S`: 55 bytes that say in which mode the device is (manual p. 69).

/// Bytes of a status record.
pub const STATUS_LEN: usize = 55;

/// A status record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Status {
    /// Station that it is about, from 1.
    pub station: u8,
    /// Records are binary (`f`), not text (`F`).
    pub binary: bool,
    /// Positions are in centimetres (`u`), not in inches (`U`).
    pub centimetres: bool,
    /// The device sends by itself (`C`).
    pub continuous: bool,
    /// Three digits of the built-in test; `000` or blanks when it found nothing.
    pub self_test: [u8; 3],
    /// Version of the device's software, trimmed.
    pub version: String,
    /// What the owner wrote into the device, trimmed.
    pub system: String,
}

impl Status {
    /// Reads exactly one status record. `None` if it is none.
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

    /// The first status record in `bytes`, wherever it begins.
    #[must_use]
    pub fn find(bytes: &[u8]) -> Option<Self> {
        bytes.windows(STATUS_LEN).find_map(Self::parse)
    }
}

/// Whether `bytes` are one whole status record, by its fixed places.
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
