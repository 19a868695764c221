//! Numbers and lengths on the wire.

/// Bytes of the cookie that either side sends first.
pub const COOKIE_LEN: usize = 24;
/// Bytes before a message's payload: five big-endian 32-bit numbers (length, seconds,
/// microseconds, sender, type), padded to a multiple of eight.
pub const MESSAGE_HEADER_LEN: usize = 24;
/// Bytes of a `Pos_Quat` message, header and all.
pub const POS_QUAT_LEN: usize = MESSAGE_HEADER_LEN + 64;

/// The big-endian 32-bit number at `place`.
pub(super) fn int_at(bytes: &[u8], place: usize) -> Option<i32> {
    let bytes = bytes.get(place..)?.first_chunk()?;
    Some(i32::from_be_bytes(*bytes))
}

/// The big-endian double at `place`; whether it is finite is the caller's to judge.
pub(super) fn double_at(bytes: &[u8], place: usize) -> Option<f64> {
    let bytes = bytes.get(place..)?.first_chunk()?;
    Some(f64::from_be_bytes(*bytes))
}

/// Rounded up to a multiple of eight, as every message is.
pub(super) const fn padded(len: usize) -> usize {
    len.next_multiple_of(8)
}

/// A message with this payload.
pub(super) fn message(sender: i32, kind: i32, payload: &[u8]) -> Vec<u8> {
    let len = u32::try_from(MESSAGE_HEADER_LEN + payload.len()).unwrap_or(u32::MAX);
    let mut bytes = len.to_be_bytes().to_vec();
    bytes.extend([0; 8]);
    bytes.extend(sender.to_be_bytes());
    bytes.extend(kind.to_be_bytes());
    bytes.extend([0; 4]);
    bytes.extend(payload);
    bytes.resize(padded(bytes.len()), 0);
    bytes
}

/// A name as its length (with the closing zero) and its characters.
pub(super) fn name_payload(name: &str) -> Vec<u8> {
    let len = u32::try_from(name.len() + 1).unwrap_or(u32::MAX);
    let mut payload = len.to_be_bytes().to_vec();
    payload.extend(name.as_bytes());
    payload.push(0);
    payload
}

/// The name in the payload of a description.
pub(super) fn name_in(payload: &[u8]) -> Option<&str> {
    let len = usize::try_from(int_at(payload, 0)?).ok()?;
    let name = payload.get(4..)?.get(..len)?;
    str::from_utf8(name.strip_suffix(&[0]).unwrap_or(name)).ok()
}
