//! Numbers, lengths and names as VRPN sends them.

/// Length of the cookie that both sides send first, bytes.
pub const COOKIE_LEN: usize = 24;
/// Length of the header before a message's payload, bytes: five big-endian 32-bit numbers
/// (length, seconds, microseconds, sender, type), padded to a multiple of eight.
pub const MESSAGE_HEADER_LEN: usize = 24;
/// Length of a `Pos_Quat` message with its header, bytes.
pub const POS_QUAT_LEN: usize = MESSAGE_HEADER_LEN + 64;

/// The big-endian 32-bit number at the offset `at`.
pub(super) fn int_at(bytes: &[u8], at: usize) -> Option<i32> {
    let bytes = bytes.get(at..)?.first_chunk()?;
    Some(i32::from_be_bytes(*bytes))
}

/// The big-endian double at the offset `at`. It may be infinite or not a number.
pub(super) fn double_at(bytes: &[u8], at: usize) -> Option<f64> {
    let bytes = bytes.get(at..)?.first_chunk()?;
    Some(f64::from_be_bytes(*bytes))
}

/// The length of a message on the wire: rounded up to a multiple of eight.
pub(super) const fn padded(len: usize) -> usize {
    len.next_multiple_of(8)
}

/// A message with this payload, at time 0.
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

/// A name as the payload of a description: its length, its characters and a zero, which the
/// length includes.
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
