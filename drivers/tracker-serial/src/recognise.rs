//! Names the protocol of received bytes, for messages about a port at which another one was
//! expected.

use crate::format::{AnyDecoder, PROTOCOLS};
use penumbra_interface::MonotonicTime;

/// Records that identify a protocol: two may occur by chance.
const ENOUGH: u64 = 3;

/// Describes `received` in one line where records of the protocol `expected` were expected,
/// and says what to do.
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
            "sends text that is not of protocol {expected:?}, such as {:?}; is it another \
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
    // Of equals the first one in PROTOCOLS: a plain name comes before its variants.
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
