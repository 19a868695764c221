//! Buffer memory that the driver fills and this process reads.

use rustix::fd::AsFd;
use rustix::io::Result;
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;

/// One of the driver's buffers, mapped for reading.
pub struct Mapping {
    start: *mut c_void,
    len: usize,
}

// SAFETY: only this value uses the mapping, which is not bound to a thread.
unsafe impl Send for Mapping {}

impl Mapping {
    /// Maps `len` bytes at `offset`, both from `VIDIOC_QUERYBUF`.
    pub fn new(fd: impl AsFd, len: usize, offset: u64) -> Result<Self> {
        let (access, flags) = (ProtFlags::READ, MapFlags::SHARED);
        // SAFETY: the kernel chooses the address, so no existing mapping is replaced.
        let start = unsafe { mmap(std::ptr::null_mut(), len, access, flags, fd, offset)? };
        Ok(Self { start, len })
    }

    /// The first `len` bytes, or all if there are fewer.
    ///
    /// # Safety
    /// The kernel must not own the buffer while the slice lives, because it would write to
    /// memory behind a shared reference.
    pub unsafe fn bytes(&self, len: usize) -> &[u8] {
        // SAFETY: `start` maps `self.len` readable bytes until `self` is dropped, and by the
        // contract above they are not written meanwhile.
        unsafe { std::slice::from_raw_parts(self.start.cast(), len.min(self.len)) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: `new` has mapped this range, and no slice of it outlives `self`. Unmapping an
        // existing mapping does not fail, and there would be no remedy.
        let _ = unsafe { munmap(self.start, self.len) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::mm::mmap_anonymous;

    /// Memory that belongs to no file, because Miri maps no files.
    #[test]
    fn a_mapping_shows_all_of_its_memory_and_no_more_and_ends_with_it() {
        let (access, len) = (ProtFlags::READ | ProtFlags::WRITE, 8192);
        // SAFETY: the system chooses the address, so no existing mapping is replaced.
        let start = unsafe { mmap_anonymous(std::ptr::null_mut(), len, access, MapFlags::PRIVATE) };
        let mapping = Mapping {
            start: start.unwrap(),
            len,
        };
        // SAFETY: the range has just been mapped for writing, and nobody reads it yet.
        unsafe { mapping.start.cast::<u8>().write_bytes(7, len) };
        // SAFETY: nobody writes to the memory any more.
        let (some, all) = unsafe { (mapping.bytes(3), mapping.bytes(usize::MAX)) };
        assert_eq!((some, all), (&[7; 3][..], &[7; 8192][..]));
        // As its owner does, another thread reads and unmaps it.
        let read_elsewhere = std::thread::scope(|scope| {
            let reader = scope.spawn(move || {
                // SAFETY: as above.
                unsafe { mapping.bytes(usize::MAX) }.to_vec()
            });
            reader.join().unwrap()
        });
        assert_eq!(read_elsewhere, [7; 8192]);
    }
}
