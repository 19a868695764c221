//! Memory that the driver fills and we read.

use rustix::fd::AsFd;
use rustix::io::Result;
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;

/// One buffer of the driver's, mapped for reading.
pub struct Mapping {
    start: *mut c_void,
    len: usize,
}

// SAFETY: the mapping belongs to this value alone and is not bound to a thread.
unsafe impl Send for Mapping {}

impl Mapping {
    /// Maps `len` bytes at `offset`, as `VIDIOC_QUERYBUF` gave them.
    pub fn new(fd: impl AsFd, len: usize, offset: u64) -> Result<Self> {
        let flags = MapFlags::SHARED;
        // SAFETY: the kernel chooses the address, so nothing that exists is overwritten.
        let start = unsafe {
            mmap(
                std::ptr::null_mut(),
                len,
                ProtFlags::READ,
                flags,
                fd,
                offset,
            )?
        };
        Ok(Self { start, len })
    }

    /// How much memory it is.
    pub const fn len(&self) -> usize {
        self.len
    }

    /// The first `used` bytes.
    ///
    /// # Safety
    /// The driver must not own the buffer for as long as the slice lives: it would write
    /// under a shared reference.
    pub unsafe fn bytes(&self, used: usize) -> &[u8] {
        // SAFETY: `start` maps `len` readable bytes until `self` is dropped, and by the
        // contract above nobody writes to them.
        unsafe { std::slice::from_raw_parts(self.start.cast(), used.min(self.len)) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `new` with this length; no slice outlives `self`. An error is
        // impossible for a range that is mapped, and nothing could be done about it.
        let _ = unsafe { munmap(self.start, self.len) };
    }
}
