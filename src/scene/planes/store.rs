//! Bakes on disk: a compact file that is trusted only if all of it is right, and a cache of
//! such files named by what they were made of.
//!
//! The file, all numbers little-endian: magic, version of the format (u32), key (32 bytes),
//! length of the content (u64), the content compressed by zstd, CRC-32 of everything before
//! it (u32). The content is laid out by `store/content.rs`.

mod cache;
mod content;
mod key;

pub use cache::{CACHE_LIMIT, cache_path, default_cache_folder, load, save, trim};
pub use key::key;

use super::Bake;
use std::io::Read;
use thiserror::Error;

const MAGIC: [u8; 8] = *b"penubake";
/// Of the format. Another one is read by no other version of Penumbra.
const VERSION: u32 = 1;
const HEADER: usize = MAGIC.len() + 4 + 32 + 8;
const CHECKSUM: usize = 4;
/// Bytes of a file, and of what is in it.
const LARGEST_FILE: u64 = 1 << 30;
const LARGEST_CONTENT: u64 = 1 << 31;
/// Visibilities are mostly 0 and 255; more than this costs time and gains little.
const LEVEL: i32 = 6;

/// Why a bake cannot be read or written.
#[derive(Debug, Error)]
pub enum StoreError {
    /// The operating system refused.
    #[error("{file}: {doing} failed ({source}); check the folder's permissions and the free space")]
    Io {
        /// Path.
        file: String,
        /// What was tried.
        doing: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is no bake of this version, or it is damaged.
    #[error("{reason}; it is made anew")]
    Damaged {
        /// What is wrong.
        reason: String,
    },
    /// A bake whose own parts do not fit together, or that is too large.
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

/// The file's bytes.
///
/// # Errors
///
/// A bake whose parts do not fit together, or that is too large.
pub fn to_bytes(bake: &Bake) -> Result<Vec<u8>, StoreError> {
    let unfit = |reason: String| StoreError::Unfit { reason };
    content::check(bake).map_err(unfit)?;
    let raw = content::write(bake);
    if raw.len() as u64 > LARGEST_CONTENT {
        return Err(unfit(format!(
            "it has {} MB, more than {}; ask for fewer planes or a lower resolution",
            raw.len() >> 20,
            LARGEST_CONTENT >> 20
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

/// The bake in a file's bytes.
///
/// # Errors
///
/// [`StoreError::Damaged`] for anything but what [`to_bytes`] of this version wrote.
pub fn from_bytes(bytes: &[u8]) -> Result<Bake, StoreError> {
    let (key, length, packed) = envelope(bytes)?;
    let wrong = |e: std::io::Error| damaged(format!("its content cannot be unpacked ({e})"));
    let mut raw = Vec::new();
    // Grows with what is there, whatever length the header claims.
    zstd::stream::read::Decoder::new(packed)
        .and_then(|d| d.take(length + 1).read_to_end(&mut raw))
        .map_err(wrong)?;
    if raw.len() as u64 != length {
        return Err(damaged("its content is not as long as it says"));
    }
    let bake = content::read(&raw, key).map_err(damaged)?;
    content::check(&bake).map_err(damaged)?;
    Ok(bake)
}

/// Key, length of the content, and the packed content of a file whose checksum is right.
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
    if length > LARGEST_CONTENT {
        return Err(damaged("it claims more content than a bake can have"));
    }
    Ok((key, length, packed))
}

#[cfg(test)]
mod tests;
