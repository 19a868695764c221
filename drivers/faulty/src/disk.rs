//! A disk that is full or slow.

use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// Faults of a disk, which are switched while files are written. Clones are the same disk.
#[derive(Clone, Debug, Default)]
pub struct FaultyDisk(Arc<Faults>);

#[derive(Debug, Default)]
struct Faults {
    is_full: AtomicBool,
    delay_millis: AtomicU64,
    flush_delay_millis: AtomicU64,
    flushed_bytes: AtomicU64,
}

impl FaultyDisk {
    /// Every write fails from now on, or no longer.
    pub fn set_full(&self, is_full: bool) {
        self.0.is_full.store(is_full, Ordering::Relaxed);
    }

    /// Every write takes at least this long.
    pub fn set_delay(&self, delay: Duration) {
        let millis = delay.as_millis() as u64;
        self.0.delay_millis.store(millis, Ordering::Relaxed);
    }

    /// Every flush takes at least this long.
    pub fn set_flush_delay(&self, delay: Duration) {
        let millis = delay.as_millis() as u64;
        self.0.flush_delay_millis.store(millis, Ordering::Relaxed);
    }

    /// Length of the file that was flushed last, as it was then: what a power cut leaves of a file
    /// that only grows.
    pub fn flushed_bytes(&self) -> u64 {
        self.0.flushed_bytes.load(Ordering::Relaxed)
    }

    /// A file on this disk.
    pub fn file<F>(&self, inner: F) -> FaultyFile<F>
    where
        F: Write + Seek,
    {
        let disk = Self(Arc::clone(&self.0));
        FaultyFile { inner, disk }
    }
}

/// A file on a faulty disk.
#[derive(Debug)]
pub struct FaultyFile<F> {
    inner: F,
    disk: FaultyDisk,
}

impl<F: Write + Seek> Write for FaultyFile<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Faults {
            is_full,
            delay_millis,
            ..
        } = &*self.disk.0;
        let delay = delay_millis.load(Ordering::Relaxed);
        if delay > 0 {
            std::thread::sleep(Duration::from_millis(delay));
        }
        if is_full.load(Ordering::Relaxed) {
            return Err(ErrorKind::StorageFull.into());
        }
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        let delay = self.disk.0.flush_delay_millis.load(Ordering::Relaxed);
        std::thread::sleep(Duration::from_millis(delay));
        self.inner.flush()?;
        let flushed = &self.disk.0.flushed_bytes;
        flushed.store(self.inner.stream_position()?, Ordering::Relaxed);
        Ok(())
    }
}

impl<F: Seek> Seek for FaultyFile<F> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flushed_bytes_are_those_of_the_last_flush() {
        let disk = FaultyDisk::default();
        let mut file = disk.file(io::Cursor::new(Vec::new()));
        file.write_all(b"ab").unwrap();
        assert_eq!(disk.flushed_bytes(), 0);
        file.flush().unwrap();
        file.write_all(b"c").unwrap();
        assert_eq!(disk.flushed_bytes(), 2);
    }

    #[test]
    fn full_disk_takes_nothing_until_it_has_space() {
        let disk = FaultyDisk::default();
        let mut file = disk.file(io::Cursor::new(Vec::new()));
        file.write_all(b"a").unwrap();
        disk.set_full(true);
        let error = file.write_all(b"b").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::StorageFull);
        disk.set_full(false);
        file.write_all(b"c").unwrap();
        assert_eq!(file.inner.into_inner(), b"ac");
    }
}
