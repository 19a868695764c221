//! `penumbra.TrackerBytes`, encoded by hand: one protobuf field does not justify a compiler.

use bytes::Bytes;

/// Returns the schema for MCAP: protobuf's `message TrackerBytes { bytes data = 1; }` in package
/// `penumbra` as a serialised `FileDescriptorSet`.
pub(super) fn schema() -> Vec<u8> {
    // Field numbers are those of google/protobuf/descriptor.proto.
    const LABEL_OPTIONAL: [u8; 2] = [4 << 3, 1];
    const TYPE_BYTES: [u8; 2] = [5 << 3, 12];
    const NUMBER_ONE: [u8; 2] = [3 << 3, 1];
    let field = [
        &bytes_field(1, b"data")[..],
        &NUMBER_ONE,
        &LABEL_OPTIONAL,
        &TYPE_BYTES,
        &bytes_field(10, b"data"),
    ]
    .concat();
    let message = [bytes_field(1, b"TrackerBytes"), bytes_field(2, &field)].concat();
    let file = [
        bytes_field(1, b"penumbra/TrackerBytes.proto"),
        bytes_field(2, b"penumbra"),
        bytes_field(4, &message),
        bytes_field(12, b"proto3"),
    ]
    .concat();
    bytes_field(1, &file)
}

/// Encodes a `penumbra.TrackerBytes`.
pub(super) fn encode(data: &[u8]) -> Vec<u8> {
    bytes_field(1, data)
}

/// Decodes a `penumbra.TrackerBytes`; the bytes share the message's memory.
pub(super) fn decode(message: &Bytes) -> Result<Bytes, String> {
    let misread = || "not a penumbra.TrackerBytes".to_owned();
    if message.is_empty() {
        return Ok(Bytes::new());
    }
    let (tag, rest) = varint(message).ok_or_else(misread)?;
    let (len, rest) = varint(rest).ok_or_else(misread)?;
    let data = usize::try_from(len).ok().and_then(|len| rest.get(..len));
    match data {
        Some(data) if tag == 10 && data.len() == rest.len() => Ok(message.slice_ref(data)),
        _ => Err(misread()),
    }
}

/// Encodes a length-delimited field of a protobuf message.
fn bytes_field(number: u8, data: &[u8]) -> Vec<u8> {
    let mut field = vec![number << 3 | 2];
    let mut len = data.len();
    while len >= 0x80 {
        field.push(len as u8 | 0x80);
        len >>= 7;
    }
    field.push(len as u8);
    field.extend_from_slice(data);
    field
}

/// Splits a base-128 varint off the front.
fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let len = bytes.iter().take(9).position(|byte| byte & 0x80 == 0)? + 1;
    let (number, rest) = bytes.split_at(len);
    let value = number
        .iter()
        .rev()
        .fold(0_u64, |value, byte| value << 7 | u64::from(byte & 0x7f));
    Some((value, rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn tracker_bytes_round_trip(data in prop::collection::vec(any::<u8>(), 0..40_000)) {
            let message = Bytes::from(encode(&data));
            prop_assert_eq!(&decode(&message).unwrap()[..], &data[..]);
        }

        #[test]
        fn arbitrary_bytes_never_panic(data in prop::collection::vec(any::<u8>(), 0..60)) {
            if let Ok(found) = decode(&data.clone().into()) {
                prop_assert!(found.len() <= data.len());
            }
        }
    }
}
