//! What bytes look like, for the user of a port on which something else was expected.

use crate::AnyDecoder;
use penumbra_interface::MonotonicTime;

/// Records of a protocol that was never asked for: two may happen by chance.
const ENOUGH: u64 = 3;

/// Names what `heard` looks like when `wanted` was expected, and what to do, in one line.
#[must_use]
pub fn recognise(heard: &[u8], wanted: &str) -> String {
    if let Some(found) = protocol_of(heard) {
        return format!(
            "sends records of protocol {found:?}, not of {wanted:?}; set protocol = {found:?}"
        );
    }
    let printable = heard
        .iter()
        .filter(|byte| (b' '..=b'~').contains(byte) || b"\r\n\t".contains(byte))
        .count();
    if printable * 10 >= heard.len() * 9 {
        format!(
            "sends printable lines that are not of {wanted:?}, such as {:?}; is it another device?",
            first_line(heard)
        )
    } else {
        format!(
            "sends {} bytes of which no protocol's records can be made; try another baud rate",
            heard.len()
        )
    }
}

/// The protocol of which `heard` has the most records, by bytes.
#[must_use]
pub fn protocol_of(heard: &[u8]) -> Option<&'static str> {
    let judged = crate::PROTOCOLS.iter().filter_map(|name| {
        let mut decoder = AnyDecoder::for_protocol(name)?;
        decoder.push(heard, MonotonicTime::default(), |_| {});
        let counters = decoder.counters();
        let used = (heard.len() as u64).saturating_sub(counters.skipped_bytes);
        (counters.records >= ENOUGH && used * 2 >= heard.len() as u64).then_some((used, *name))
    });
    // The first of equals: the plain name stands before its variants.
    judged
        .rev()
        .max_by_key(|(used, _)| *used)
        .map(|(_, name)| name)
}

/// The first whole line, at most 60 characters of it.
fn first_line(heard: &[u8]) -> String {
    let text = String::from_utf8_lossy(heard);
    let whole = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let line = whole.take(2).last().unwrap_or_default();
    line.chars().take(60).collect()
}

#[cfg(test)]
mod tests;
