//! A file that survives a power cut up to its last flush.

use std::fs::File;
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;

/// A file whose `flush` returns when its bytes are on the disk, not only in the system's memory:
/// [`File`]'s own does nothing.
#[derive(Debug)]
pub struct SyncedFile(File);

impl SyncedFile {
    /// Wraps a file.
    #[must_use]
    pub const fn new(file: File) -> Self {
        Self(file)
    }
}

impl Write for SyncedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        match self.0.sync_data() {
            // Not a disk, e.g. a pipe or a device.
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::InvalidInput | ErrorKind::Unsupported
                ) =>
            {
                Ok(())
            }
            outcome => outcome,
        }
    }
}

impl Seek for SyncedFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.seek(to)
    }
}

/// Writes the folder of a new file to the disk, so that the file has its name there. A system that
/// cannot do that (not every file system opens folders) is left to do it when it will.
pub fn sync_folder_of(path: &Path) {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let folder = File::open(folder.unwrap_or(Path::new(".")));
    let _ = folder.and_then(|folder| folder.sync_all());
}
