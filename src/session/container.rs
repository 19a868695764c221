//! The MCAP file: positions of its chunks, its attachments, and the bytes of one chunk.

use super::SessionError;
use super::records::{
    self, CHUNK_HEADER_MAX, Channel, ChunkHeader, MAGIC, RECORD_HEADER, op, record_header,
};
use bytes::Bytes;
use std::collections::BTreeMap;
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
/// Maximum size of a record of another kind, bytes.
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// A complete chunk.
#[derive(Clone, Debug)]
pub(super) struct ChunkLocation {
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
    pub damage: Vec<SessionError>,
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
            self.damage.push(self.damaged(body, "a chunk's header"));
            return Ok(());
        };
        let bytes = header.compressed_size.max(header.uncompressed_size);
        self.check_size("a chunk", bytes, MAX_CHUNK_BYTES)?;
        let offset = body + header.len;
        self.chunks.push(ChunkLocation { offset, header });
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
            self.damage.push(self.damaged(body, "an attachment"));
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

    /// Returns the records of a chunk, decompressed and checked.
    pub fn unpack(
        &self,
        file: &mut (impl Read + Seek),
        chunk: &ChunkLocation,
    ) -> Result<Bytes, SessionError> {
        let packed = self.read(file, chunk.offset, chunk.header.compressed_size)?;
        let size = chunk.header.uncompressed_size;
        let unpacked = decompress(&chunk.header.compression, packed, size)
            .map_err(|reason| self.damaged(chunk.offset, &reason))?;
        let crc = chunk.header.uncompressed_crc;
        if unpacked.len() as u64 != size {
            return Err(self.damaged(chunk.offset, "a chunk of another size than stated"));
        }
        if crc != 0 && crc != crc32fast::hash(&unpacked) {
            return Err(self.damaged(chunk.offset, "a chunk's checksum is wrong"));
        }
        Ok(unpacked)
    }

    /// Reads `len` bytes at `at`; the caller has checked `len` against the file or a limit.
    fn read(
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

    pub fn damaged(&self, offset: u64, reason: &str) -> SessionError {
        SessionError::Damaged {
            path: self.path.clone(),
            offset,
            reason: reason.to_owned(),
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
