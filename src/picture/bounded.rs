//! Reads files of limited size, also devices and pipes that never end.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Maximum size of a picture file, bytes.
pub const MAX_PICTURE_BYTES: u64 = 256 << 20;

/// Reads a file of at most `max_bytes`.
///
/// # Errors
/// It cannot be read, or is larger.
pub fn read_bounded(path: &Path, max_bytes: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut file = File::open(path)?;
    let is_large = file.metadata()?.len() > max_bytes;
    if !is_large {
        (&mut file).take(max_bytes + 1).read_to_end(&mut bytes)?;
    }
    if is_large || bytes.len() as u64 > max_bytes {
        let reason = format!("larger than the limit of {max_bytes} bytes");
        return Err(io::Error::new(ErrorKind::FileTooLarge, reason));
    }
    Ok(bytes)
}

/// Reads a text of at most `max_bytes`.
///
/// # Errors
/// It cannot be read, is larger, or is not UTF-8.
pub fn read_text_bounded(path: &Path, max_bytes: u64) -> io::Result<String> {
    let bytes = read_bounded(path, max_bytes)?;
    String::from_utf8(bytes).map_err(|_| io::Error::new(ErrorKind::InvalidData, "it is no text"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_files_are_refused_unread() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, [7; 100]).unwrap();
        assert_eq!(read_bounded(&path, 100).unwrap().len(), 100);
        let error = read_bounded(&path, 99).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
    }

    #[cfg(unix)]
    #[test]
    fn endless_device_is_refused() {
        let error = read_bounded(Path::new("/dev/zero"), 1000).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
    }
}
