//! MCAP records (<https://mcap.dev/spec>), parsed defensively: the `mcap` crate's parser may panic on
//! the lengths in a damaged file, this one returns `None`.

use std::collections::BTreeMap;

/// First and last bytes of a file.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// Bytes of an opcode and the length that follows it.
pub(super) const RECORD_HEADER: usize = 9;

/// The opcodes in use.
pub(super) mod op {
    pub const FOOTER: u8 = 0x02;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const ATTACHMENT: u8 = 0x09;
}

/// Reads little-endian fields off the front of a slice.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(taken)
    }

    fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.take(2)?.try_into().ok()?))
    }

    fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4)?.try_into().ok()?))
    }

    fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.take(8)?.try_into().ok()?))
    }

    fn string(&mut self) -> Option<String> {
        let len = self.u32()? as usize;
        String::from_utf8(self.take(len)?.to_vec()).ok()
    }
}

/// Opcode and body length of a record.
pub(super) fn record_header(bytes: &[u8]) -> Option<(u8, u64)> {
    let (&opcode, mut rest) = bytes.split_first().map(|(op, rest)| (op, Fields(rest)))?;
    Some((opcode, rest.u64()?))
}

/// Header of a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ChunkHeader {
    pub start_time: u64,
    pub end_time: u64,
    pub uncompressed_size: u64,
    pub uncompressed_crc: u32,
    pub compression: String,
    pub compressed_size: u64,
    /// Size of this header, bytes.
    pub len: u64,
}

/// Maximum size of a chunk header with a known compression, bytes.
pub(super) const CHUNK_HEADER_MAX: usize = 64;

pub(super) fn chunk_header(body: &[u8]) -> Option<ChunkHeader> {
    let mut fields = Fields(body);
    let header = ChunkHeader {
        start_time: fields.u64()?,
        end_time: fields.u64()?,
        uncompressed_size: fields.u64()?,
        uncompressed_crc: fields.u32()?,
        compression: fields.string()?,
        compressed_size: fields.u64()?,
        len: 0,
    };
    let len = (body.len() - fields.0.len()) as u64;
    Some(ChunkHeader { len, ..header })
}

/// Parses an attachment to name, media type and data; `None` if its checksum is wrong.
pub(super) fn attachment(body: &[u8]) -> Option<(String, String, &[u8])> {
    let mut fields = Fields(body);
    let _log_time = fields.u64()?;
    let _create_time = fields.u64()?;
    let name = fields.string()?;
    let media_type = fields.string()?;
    let data_len = usize::try_from(fields.u64()?).ok()?;
    let data = fields.take(data_len)?;
    let checked = body.len() - fields.0.len();
    let crc = fields.u32()?;
    (crc == 0 || crc == crc32fast::hash(&body[..checked])).then_some((name, media_type, data))
}

/// Description of a stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Channel {
    pub id: u16,
    pub topic: String,
    pub message_encoding: String,
    pub metadata: BTreeMap<String, String>,
}

pub(super) fn channel(body: &[u8]) -> Option<Channel> {
    let mut fields = Fields(body);
    let id = fields.u16()?;
    let _schema_id = fields.u16()?;
    let topic = fields.string()?;
    let message_encoding = fields.string()?;
    let map_len = fields.u32()? as usize;
    let mut map = Fields(fields.take(map_len)?);
    let mut metadata = BTreeMap::new();
    while !map.0.is_empty() {
        metadata.insert(map.string()?, map.string()?);
    }
    Some(Channel {
        id,
        topic,
        message_encoding,
        metadata,
    })
}

/// A message's header; its data start at [`MESSAGE_HEADER`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MessageHeader {
    pub channel_id: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
}

/// Bytes before a message's data.
pub(super) const MESSAGE_HEADER: usize = 22;

pub(super) fn message_header(body: &[u8]) -> Option<MessageHeader> {
    let mut fields = Fields(body);
    Some(MessageHeader {
        channel_id: fields.u16()?,
        sequence: fields.u32()?,
        log_time: fields.u64()?,
        publish_time: fields.u64()?,
    })
}

/// A message that an index states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct IndexedMessage {
    pub channel_id: u16,
    pub log_time: u64,
    /// Offset of its record in the decompressed chunk.
    pub offset: u64,
}

/// Parses the index of one stream in a chunk.
pub(super) fn message_index(body: &[u8]) -> impl Iterator<Item = IndexedMessage> + '_ {
    let mut fields = Fields(body);
    let channel_id = fields.u16();
    let len = fields.u32().map_or(0, |len| len as usize);
    let mut entries = Fields(fields.take(len).unwrap_or_default());
    std::iter::from_fn(move || {
        Some(IndexedMessage {
            channel_id: channel_id?,
            log_time: entries.u64()?,
            offset: entries.u64()?,
        })
    })
}

/// Position of a chunk by the summary at the end of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkIndex {
    pub start_time: u64,
    pub end_time: u64,
    /// Offset of its record in the file.
    pub offset: u64,
    /// Size of its record, bytes.
    pub len: u64,
}

pub(super) fn chunk_index(body: &[u8]) -> Option<ChunkIndex> {
    let mut fields = Fields(body);
    Some(ChunkIndex {
        start_time: fields.u64()?,
        end_time: fields.u64()?,
        offset: fields.u64()?,
        len: fields.u64()?,
    })
}

/// Size of a footer's body, bytes.
pub(super) const FOOTER: usize = 20;

/// Parses a footer to the offset of the summary (0 without one) and the summary's checksum (0 if it
/// is not known).
pub(super) fn footer(body: &[u8]) -> Option<(u64, u32)> {
    let mut fields = Fields(body);
    let summary_start = fields.u64()?;
    let _summary_offset_start = fields.u64()?;
    Some((summary_start, fields.u32()?))
}

/// Iterates over the records of a decompressed chunk. Ends with an error at a record that extends
/// beyond the chunk.
pub(super) fn records_in(chunk: &[u8]) -> impl Iterator<Item = Result<Placed, ()>> + '_ {
    let mut at = 0;
    std::iter::from_fn(move || {
        let rest = chunk.get(at..).filter(|rest| !rest.is_empty())?;
        let placed = record_header(rest).and_then(|(opcode, len)| {
            let start = at + RECORD_HEADER;
            let end = start.checked_add(usize::try_from(len).ok()?)?;
            (end <= chunk.len()).then_some(Placed { opcode, start, end })
        });
        at = placed.map_or(chunk.len(), |placed| placed.end);
        Some(placed.ok_or(()))
    })
}

/// Opcode and byte range of a record's body within a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Placed {
    pub opcode: u8,
    pub start: usize,
    pub end: usize,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn record_beyond_the_chunk_is_an_error() {
        let mut chunk = vec![op::MESSAGE, 2, 0, 0, 0, 0, 0, 0, 0, 7, 7];
        chunk.extend([op::MESSAGE, 255, 255, 255, 255, 255, 255, 255, 255, 7]);
        let found: Vec<_> = records_in(&chunk).collect();
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].unwrap().end, 11);
        assert!(found[1].is_err());
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = chunk_header(&bytes);
            let _ = channel(&bytes);
            let _ = message_header(&bytes);
            let _ = chunk_index(&bytes);
            let _ = footer(&bytes);
            prop_assert!(message_index(&bytes).count() * 16 <= bytes.len());
            if let Some((_, _, data)) = attachment(&bytes) {
                prop_assert!(data.len() <= bytes.len());
            }
            for placed in records_in(&bytes).flatten() {
                prop_assert!(placed.end <= bytes.len());
            }
        }
    }
}
