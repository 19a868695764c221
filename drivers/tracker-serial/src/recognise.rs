//! Recognises the protocol of received bytes, for messages about an unexpected protocol.

use crate::format::{AnyDecoder, PROTOCOLS};
use penumbra_interface::MonotonicTime;

/// Number of records that identify a protocol: two may occur by chance.
const ENOUGH: u64 = 3;

/// Describes `received`, which are not records of the protocol `expected`, in one line with a
/// remedy.
#[must_use]
pub fn recognise(received: &[u8], expected: &str) -> String {
    if let Some(found) = protocol_of(received) {
        return format!(
            "sends records of protocol {found:?}, not of {expected:?}; set protocol = {found:?}"
        );
    }
    let printable = received
        .iter()
        .filter(|byte| (b' '..=b'~').contains(byte) || b"\r\n\t".contains(byte))
        .count();
    if printable * 10 >= received.len() * 9 {
        format!(
            "sends text that is not of protocol {expected:?}, e.g. {:?}; is it another \
             device?",
            first_line(received)
        )
    } else {
        format!(
            "sends {} bytes that no known protocol can decode; try another baud rate",
            received.len()
        )
    }
}

/// The protocol whose records make up most of `received`, at least half of it.
#[must_use]
pub fn protocol_of(received: &[u8]) -> Option<&'static str> {
    let candidates = PROTOCOLS.iter().filter_map(|name| {
        let mut decoder = AnyDecoder::for_protocol(name)?;
        decoder.push(received, MonotonicTime::default(), |_| {});
        let counters = decoder.counters();
        let used = (received.len() as u64).saturating_sub(counters.skipped_bytes);
        (counters.records >= ENOUGH && used * 2 >= received.len() as u64).then_some((used, *name))
    });
    // The first one in PROTOCOLS of those with equal counts: a plain name precedes its variants.
    candidates
        .rev()
        .max_by_key(|(used, _)| *used)
        .map(|(_, name)| name)
}

/// The first complete line, at most 60 characters of it. The first line received may be the
/// rest of one.
fn first_line(received: &[u8]) -> String {
    let text = String::from_utf8_lossy(received);
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let line = lines.take(2).last().unwrap_or_default();
    line.chars().take(60).collect()
}

#[cfg(test)]
mod tests;
