//! The MCAP file: positions of its chunks, its attachments, and the bytes of one chunk.

use super::SessionError;
use super::records::{
    self, CHUNK_HEADER_MAX, Channel, ChunkHeader, ChunkIndex, FOOTER, MAGIC, RECORD_HEADER, op,
    record_header, records_in,
};
use bytes::Bytes;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A file inside a session: calibration, virtual object, phantom object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Plain relative path with `/`, e.g. `object/object.glb`.
    pub name: String,
    /// E.g. `application/json`.
    pub media_type: String,
    /// Contents of the file.
    pub data: Bytes,
}

/// Maximum size of an attachment, bytes.
pub(super) const MAX_ATTACHMENT_BYTES: u64 = 256 << 20;
/// Maximum total size of the attachments, bytes: they are kept in memory.
pub(super) const MAX_ATTACHMENTS_BYTES: u64 = 1 << 30;
/// Maximum size of a chunk, compressed or not, bytes.
pub(super) const MAX_CHUNK_BYTES: u64 = 512 << 20;
/// Maximum size of the summary at the end of a file, bytes.
const MAX_SUMMARY_BYTES: u64 = 256 << 20;
/// Maximum number of damaged parts that are kept.
const MAX_DAMAGED_PARTS: usize = 1024;
/// Maximum size of a record of another kind, bytes.
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// A complete chunk.
#[derive(Clone, Debug)]
pub(super) struct ChunkLocation {
    /// Offset of its record in the file.
    pub record_at: u64,
    /// Offset of its compressed data in the file.
    pub offset: u64,
    pub header: ChunkHeader,
}

/// Result of one pass over the records of a file, without opening its chunks.
#[derive(Debug)]
pub(super) struct Container {
    pub path: PathBuf,
    pub len: u64,
    /// Complete chunks, sorted by the time of their first message.
    pub chunks: Vec<ChunkLocation>,
    /// Attachments in file order.
    pub attachments: Vec<Attachment>,
    /// Channels listed outside the chunks (a finished file lists all).
    pub channels: BTreeMap<u16, Channel>,
    /// The end of a finished file is missing.
    pub truncated: bool,
    /// Unreadable parts of the file.
    pub damage: Vec<DamagedPart>,
}

/// An unreadable part of a file.
#[derive(Clone, Debug)]
pub(super) struct DamagedPart {
    /// Offset of the part in the file.
    pub offset: u64,
    /// Offset of the index of its messages in the file.
    pub index_at: u64,
    /// Offset of its first message in the decompressed chunk.
    pub from: u64,
    /// Log times of its first and its last message, if they are known.
    pub times: Option<(u64, u64)>,
    pub reason: String,
}

impl Container {
    /// Scans the file at `path`.
    pub fn scan(path: &Path) -> Result<Self, SessionError> {
        let (mut file, len) = open(path)?;
        let mut container = Self {
            path: path.to_owned(),
            len,
            chunks: Vec::new(),
            attachments: Vec::new(),
            channels: BTreeMap::new(),
            truncated: true,
            damage: Vec::new(),
        };
        container.check_magic(&mut file)?;
        let mut at = MAGIC.len() as u64;
        while let Some(end) = container.visit(&mut file, at)? {
            at = end;
        }
        container.add_unvisited_chunks(&mut file)?;
        // Stable: chunks that begin at the same instant stay in file order.
        container
            .chunks
            .sort_by_key(|chunk| chunk.header.start_time);
        Ok(container)
    }

    fn check_magic(&self, file: &mut impl Read) -> Result<(), SessionError> {
        let path = self.path.clone();
        if self.len == 0 {
            return Err(SessionError::Empty { path });
        }
        let mut magic = [0; MAGIC.len()];
        match file.read_exact(&mut magic) {
            Ok(()) if magic == MAGIC => Ok(()),
            Err(source) if source.kind() != io::ErrorKind::UnexpectedEof => {
                Err(SessionError::Io { path, source })
            }
            _ => Err(SessionError::NotMcap { path }),
        }
    }

    /// Registers the record that starts at `at`. Returns the record's end; `None` if the file ends
    /// there or is truncated.
    fn visit(&mut self, file: &mut BufReader<File>, at: u64) -> Result<Option<u64>, SessionError> {
        let body = at + RECORD_HEADER as u64;
        if body > self.len {
            return Ok(None);
        }
        let head = self.read(file, at, RECORD_HEADER as u64)?;
        let Some((opcode, body_len)) = record_header(&head) else {
            return Ok(None);
        };
        let Some(end) = body.checked_add(body_len).filter(|end| *end <= self.len) else {
            return Ok(None);
        };
        match opcode {
            op::CHUNK => self.add_chunk(file, body, body_len)?,
            op::ATTACHMENT => self.add_attachment(file, body, body_len)?,
            op::CHANNEL if body_len <= MAX_RECORD_BYTES => {
                let bytes = self.read(file, body, body_len)?;
                let channel = records::channel(&bytes);
                self.channels.extend(channel.map(|c| (c.id, c)));
            }
            op::FOOTER => {
                let magic = self.read(file, end, (self.len - end).min(MAGIC.len() as u64))?;
                self.truncated = *magic != MAGIC;
                return Ok(None);
            }
            // Not an opcode: zeros that a file system left after losing the end of the file.
            0 => return Ok(None),
            _ => {}
        }
        Ok(Some(end))
    }

    fn add_chunk(
        &mut self,
        file: &mut BufReader<File>,
        body: u64,
        body_len: u64,
    ) -> Result<(), SessionError> {
        let head = self.read(file, body, body_len.min(CHUNK_HEADER_MAX as u64))?;
        let header = records::chunk_header(&head)
            .filter(|header| header.len.saturating_add(header.compressed_size) <= body_len);
        let Some(header) = header else {
            self.add_damage(body, body + body_len, None, "a chunk's header");
            return Ok(());
        };
        let bytes = header.compressed_size.max(header.uncompressed_size);
        self.check_size("a chunk", bytes, MAX_CHUNK_BYTES)?;
        let offset = body + header.len;
        self.chunks.push(ChunkLocation {
            record_at: body - RECORD_HEADER as u64,
            offset,
            header,
        });
        Ok(())
    }

    fn add_attachment(
        &mut self,
        file: &mut BufReader<File>,
        body: u64,
        body_len: u64,
    ) -> Result<(), SessionError> {
        self.check_size("an attachment", body_len, MAX_ATTACHMENT_BYTES)?;
        let held: u64 = self.attachments.iter().map(|a| a.data.len() as u64).sum();
        self.check_size("all attachments", held + body_len, MAX_ATTACHMENTS_BYTES)?;
        let bytes = self.read(file, body, body_len)?;
        let Some((name, media_type, data)) = records::attachment(&bytes) else {
            self.add_damage(body, body + body_len, None, "an attachment");
            return Ok(());
        };
        if !is_inside(&name) {
            let path = self.path.clone();
            return Err(SessionError::AttachmentName { path, name });
        }
        let data = bytes.slice_ref(data);
        self.attachments.push(Attachment {
            name,
            media_type,
            data,
        });
        Ok(())
    }

    /// Adds the chunks that the summary at the end of a finished file states and that the walk over
    /// the records has missed: a damaged length leads it astray.
    fn add_unvisited_chunks(&mut self, file: &mut BufReader<File>) -> Result<(), SessionError> {
        let Some(summary) = self.summary(file)? else {
            return Ok(());
        };
        self.truncated = false;
        let visited: BTreeSet<u64> = self.chunks.iter().map(|chunk| chunk.record_at).collect();
        for record in records_in(&summary).map_while(Result::ok) {
            let body = &summary[record.start..record.end];
            match record.opcode {
                op::CHANNEL => {
                    let channel = records::channel(body);
                    self.channels.extend(channel.map(|c| (c.id, c)));
                }
                op::CHUNK_INDEX => {
                    let index = records::chunk_index(body);
                    if let Some(index) = index.filter(|index| !visited.contains(&index.offset)) {
                        self.add_indexed_chunk(file, &index)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn add_indexed_chunk(
        &mut self,
        file: &mut BufReader<File>,
        index: &ChunkIndex,
    ) -> Result<(), SessionError> {
        let body = index.offset.saturating_add(RECORD_HEADER as u64);
        let end = index.offset.saturating_add(index.len);
        if body > end || end > self.len || self.damage.iter().any(|d| d.index_at == end) {
            return Ok(());
        }
        let head = self.read(file, index.offset, RECORD_HEADER as u64)?;
        if record_header(&head) == Some((op::CHUNK, end - body)) {
            return self.add_chunk(file, body, end - body);
        }
        let times = Some((index.start_time, index.end_time));
        self.add_damage(index.offset, end, times, "a chunk's length or kind");
        Ok(())
    }

    /// Returns the summary at the end of a finished file; `None` without one, or if it is damaged.
    fn summary(&self, file: &mut BufReader<File>) -> Result<Option<Bytes>, SessionError> {
        let end = (FOOTER + MAGIC.len()) as u64;
        let Some(body) = self.len.checked_sub(end) else {
            return Ok(None);
        };
        let footer_at = body.saturating_sub(RECORD_HEADER as u64);
        let tail = self.read(file, footer_at, self.len - footer_at)?;
        let header = record_header(&tail).filter(|_| tail.ends_with(&MAGIC));
        if header != Some((op::FOOTER, FOOTER as u64)) {
            return Ok(None);
        }
        let footer = &tail[RECORD_HEADER..RECORD_HEADER + FOOTER];
        let Some((start, crc)) = records::footer(footer).filter(|(start, _)| *start > 0) else {
            return Ok(None);
        };
        let Some(len) = footer_at
            .checked_sub(start)
            .filter(|l| *l <= MAX_SUMMARY_BYTES)
        else {
            return Ok(None);
        };
        let summary = self.read(file, start, len)?;
        // The checksum covers the footer up to itself.
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&summary);
        hasher.update(&tail[..RECORD_HEADER + FOOTER - size_of::<u32>()]);
        Ok((crc == 0 || crc == hasher.finalize()).then_some(summary))
    }

    /// Returns the records of a chunk, decompressed and checked.
    pub fn unpack(
        &self,
        file: &mut (impl Read + Seek),
        chunk: &ChunkLocation,
    ) -> Result<Result<Bytes, DamagedPart>, SessionError> {
        let ChunkLocation { offset, header, .. } = chunk;
        let packed = self.read(file, *offset, header.compressed_size)?;
        let damaged = |reason| Ok(Err(DamagedPart::of_chunk(*offset, header, 0, reason)));
        let size = header.uncompressed_size;
        let unpacked = match decompress(&header.compression, packed, size) {
            Ok(unpacked) => unpacked,
            Err(reason) => return damaged(reason),
        };
        let crc = header.uncompressed_crc;
        if unpacked.len() as u64 != size {
            return damaged("a chunk of another size than stated".to_owned());
        }
        if crc != 0 && crc != crc32fast::hash(&unpacked) {
            return damaged("a chunk's checksum is wrong".to_owned());
        }
        Ok(Ok(unpacked))
    }

    /// Reads `len` bytes at `at`; the caller has checked `len` against the file or a limit.
    pub fn read(
        &self,
        file: &mut (impl Read + Seek),
        at: u64,
        len: u64,
    ) -> Result<Bytes, SessionError> {
        let too_large = |_| io::Error::from(io::ErrorKind::OutOfMemory);
        let len = usize::try_from(len).map_err(|error| self.io(too_large(error)))?;
        let mut bytes = vec![0; len];
        file.seek(SeekFrom::Start(at))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(|source| self.io(source))?;
        Ok(bytes.into())
    }

    pub fn io(&self, source: io::Error) -> SessionError {
        let path = self.path.clone();
        SessionError::Io { path, source }
    }

    fn add_damage(&mut self, offset: u64, end: u64, times: Option<(u64, u64)>, reason: &str) {
        if self.damage.len() < MAX_DAMAGED_PARTS {
            self.damage.push(DamagedPart {
                offset,
                index_at: end,
                from: 0,
                times,
                reason: reason.to_owned(),
            });
        }
    }

    fn check_size(&self, what: &str, bytes: u64, limit: u64) -> Result<(), SessionError> {
        if bytes <= limit {
            return Ok(());
        }
        Err(SessionError::TooLarge {
            path: self.path.clone(),
            what: what.to_owned(),
            bytes,
            limit,
        })
    }
}

/// Opens a regular file; returns it with its length.
pub(super) fn open(path: &Path) -> Result<(BufReader<File>, u64), SessionError> {
    let io_error = |source: io::Error| {
        let path = path.to_owned();
        match source.kind() {
            io::ErrorKind::NotFound => SessionError::NotFound { path },
            _ => SessionError::Io { path, source },
        }
    };
    let file = File::open(path).map_err(io_error)?;
    let metadata = file.metadata().map_err(io_error)?;
    if !metadata.is_file() {
        let path = path.to_owned();
        return Err(SessionError::NotMcap { path });
    }
    Ok((BufReader::new(file), metadata.len()))
}

/// Decompresses at most one byte more than `size`, as a protection against decompression bombs.
fn decompress(compression: &str, packed: Bytes, size: u64) -> Result<Bytes, String> {
    let mut unpacked = Vec::new();
    let outcome = match compression {
        "" => return Ok(packed),
        "lz4" => lz4::Decoder::new(&packed[..])
            .and_then(|decoder| decoder.take(size + 1).read_to_end(&mut unpacked)),
        "zstd" => zstd::Decoder::new(&packed[..])
            .and_then(|decoder| decoder.take(size + 1).read_to_end(&mut unpacked)),
        other => return Err(format!("unknown compression {other:?}")),
    };
    outcome.map_err(|error| error.to_string())?;
    Ok(unpacked.into())
}

/// Returns whether a name is a plain relative path of `/`-separated parts.
pub(super) fn is_inside(name: &str) -> bool {
    let plain = |part: &str| !matches!(part, "" | "." | "..");
    name.len() <= 1024
        && name.split('/').all(plain)
        && !name.contains(['\\', ':'])
        && !name.contains(char::is_control)
}

#[cfg(test)]
mod tests {
    use super::is_inside;

    #[test]
    fn accepts_only_plain_relative_paths() {
        for name in [
            "rig.json",
            "object/object.glb",
            "a/b/c/d.ply",
            "..hidden",
            "a b",
        ] {
            assert!(is_inside(name), "{name}");
        }
        for name in [
            "",
            "/etc/passwd",
            "../x",
            "a/../b",
            "a//b",
            "a/.",
            "C:\\x",
            "a\0b",
            "a/",
        ] {
            assert!(!is_inside(name), "{name:?}");
        }
    }
}
