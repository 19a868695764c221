//! Bakes on disk: a compact, completely checked file format, and a cache of such files named by their
//! keys.
//!
//! File layout, little-endian: magic, version of the format (u32), key (32 bytes), length of the
//! content (u64), content compressed by zstd, CRC-32 of everything before (u32). `store/content.rs`
//! defines the content.

mod cache;
mod content;
mod key;

pub use cache::{CACHE_LIMIT, cache_path, default_cache_folder, load, save, trim};
pub use key::key;

use super::Bake;
use std::io::Read;
use thiserror::Error;

const MAGIC: [u8; 8] = *b"penubake";
/// Version of the format; files of other versions are refused.
const VERSION: u32 = 1;
const HEADER: usize = MAGIC.len() + 4 + 32 + 8;
const CHECKSUM: usize = 4;
/// Maximum size of a file and of its unpacked content, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
const MAX_CONTENT_BYTES: u64 = 1 << 31;
/// zstd level: visibilities are mostly 0 and 255; higher levels take longer and gain little.
const LEVEL: i32 = 6;

/// Why a bake cannot be read or written.
#[derive(Debug, Error)]
pub enum StoreError {
    /// The operating system refused.
    #[error("{file}: {doing} failed ({source}); check the folder's permissions and the free space")]
    Io {
        /// Path.
        file: String,
        /// Operation.
        doing: &'static str,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is no bake of this version, or it is damaged.
    #[error("{reason}; it is baked again")]
    Damaged {
        /// What is wrong.
        reason: String,
    },
    /// The bake is inconsistent or too large.
    #[error("the bake cannot be stored: {reason}")]
    Unfit {
        /// What is wrong.
        reason: String,
    },
}

fn damaged(reason: impl Into<String>) -> StoreError {
    StoreError::Damaged {
        reason: reason.into(),
    }
}

/// Encodes a bake as the bytes of a file.
///
/// # Errors
///
/// The bake is inconsistent or too large.
pub fn to_bytes(bake: &Bake) -> Result<Vec<u8>, StoreError> {
    let unfit = |reason: String| StoreError::Unfit { reason };
    content::check(bake).map_err(unfit)?;
    let raw = content::write(bake);
    if raw.len() as u64 > MAX_CONTENT_BYTES {
        return Err(unfit(format!(
            "it has {} MB, more than {}; ask for fewer planes or a lower resolution",
            raw.len() >> 20,
            MAX_CONTENT_BYTES >> 20
        )));
    }
    let packed = zstd::bulk::compress(&raw, LEVEL).map_err(|e| unfit(e.to_string()))?;
    let mut out = Vec::with_capacity(HEADER + packed.len() + CHECKSUM);
    out.extend(MAGIC);
    out.extend(VERSION.to_le_bytes());
    out.extend(bake.key);
    out.extend((raw.len() as u64).to_le_bytes());
    out.extend(packed);
    out.extend(crc32fast::hash(&out).to_le_bytes());
    Ok(out)
}

/// Decodes the bytes of a file.
///
/// # Errors
///
/// [`StoreError::Damaged`] for anything but what [`to_bytes`] of this version wrote.
pub fn from_bytes(bytes: &[u8]) -> Result<Bake, StoreError> {
    let (key, length, packed) = envelope(bytes)?;
    let wrong = |e: std::io::Error| damaged(format!("its content cannot be unpacked ({e})"));
    let mut raw = Vec::new();
    // Grows with the data, whatever length the header says.
    zstd::stream::read::Decoder::new(packed)
        .and_then(|d| d.take(length + 1).read_to_end(&mut raw))
        .map_err(wrong)?;
    if raw.len() as u64 != length {
        return Err(damaged("the length of its content is wrong"));
    }
    let bake = content::read(&raw, key).map_err(damaged)?;
    content::check(&bake).map_err(damaged)?;
    Ok(bake)
}

/// Returns key, length of the content and packed content of a file with a correct checksum.
fn envelope(bytes: &[u8]) -> Result<([u8; 32], u64, &[u8]), StoreError> {
    let body = bytes.len().saturating_sub(CHECKSUM);
    let (body, checksum) = bytes.split_at(body);
    let (Some((header, packed)), Ok(checksum)) = (
        body.split_first_chunk::<HEADER>(),
        <[u8; 4]>::try_from(checksum),
    ) else {
        return Err(damaged("it is too short for a bake"));
    };
    if header[..8] != MAGIC {
        return Err(damaged("it is no bake of shadowing planes"));
    }
    let mut rest = content::Bytes::new(&header[8..]);
    let version = rest.u32().map_err(damaged)?;
    if version != VERSION {
        return Err(damaged(format!(
            "it is a bake of version {version}, and this Penumbra reads {VERSION}"
        )));
    }
    if crc32fast::hash(body) != u32::from_le_bytes(checksum) {
        return Err(damaged("its checksum is wrong: the file is damaged"));
    }
    let key = rest.array().map_err(damaged)?;
    let length = rest.u64().map_err(damaged)?;
    if length > MAX_CONTENT_BYTES {
        return Err(damaged("its content is larger than the maximum"));
    }
    Ok((key, length, packed))
}

#[cfg(test)]
mod tests;
