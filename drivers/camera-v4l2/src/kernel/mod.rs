//! An open video device of the kernel: the only module with unsafe code.
//!
//! It uses the crate `v4l` where its calls are safe with every driver, and its raw bindings
//! elsewhere; each file gives the reasons. Buffers are handled here, not by the streams of
//! `v4l` 0.14: after a time-out, those queue a buffer that the kernel still owns, they return
//! complete buffers instead of the bytes used, and they panic if the stream cannot be stopped.

// The kernel writes to addresses that it is given, and shares memory with this process. No safe
// function does that.
#![allow(unsafe_code)]

mod controls;
mod formats;
mod ioctl;
mod mapping;

use crate::device::{FilledBuffer, OwnedBuffer, Readiness, VideoDevice};
use ioctl::{Argument, Command, retrying};
use mapping::Mapping;
use penumbra_interface::MonotonicTime;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::BorrowedFd;
use rustix::fs::{FileType, major, stat};
use rustix::io::{Errno, FdFlags, Result, fcntl_setfd};
use std::ffi::c_int;
use std::path::Path;
use std::time::Duration;
use v4l::buffer::Flags;
use v4l::{Device, v4l_sys as sys};

/// The type of buffers that this driver streams: captured pictures in one plane.
const BUFFER_TYPE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
/// The major number of all video4linux devices (kernel, admin-guide/devices.txt).
const VIDEO_MAJOR: u32 = 81;

/// An open video device. Dropping it closes the device file, which stops its stream.
pub(crate) struct V4l2Device {
    device: Device,
    buffers: Vec<Mapping>,
}

impl V4l2Device {
    /// Opens a device file for calls that do not block.
    ///
    /// # Errors
    /// [`Errno::NOTTY`] for files other than video4linux devices, which are not opened.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        // Opening another device may have effects: a watchdog starts. Also, the crate `v4l`
        // panics if closing a file fails, which it never does for video4linux devices, and on
        // paths with a zero byte, which `stat` refuses.
        let file = stat(path)?;
        let is_device = FileType::from_raw_mode(file.st_mode) == FileType::CharacterDevice;
        if !is_device || major(file.st_rdev) != VIDEO_MAJOR {
            return Err(Errno::NOTTY);
        }
        let device = Self {
            device: retrying(|| Device::with_path(path))?,
            buffers: Vec::new(),
        };
        // `with_path` lets child processes inherit the file, which would keep the camera busy.
        fcntl_setfd(device.fd(), FdFlags::CLOEXEC)?;
        Ok(device)
    }

    fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: `self.device`, which the result borrows, keeps the descriptor open.
        unsafe { BorrowedFd::borrow_raw(self.device.handle().fd()) }
    }

    fn send<T: Argument>(&self, command: &Command<T>, argument: &mut T) -> Result<()> {
        command.send(&self.device.handle(), argument)
    }

    fn request_buffers(&self, count: u32) -> Result<u32> {
        let mut request = sys::v4l2_requestbuffers {
            count,
            type_: BUFFER_TYPE,
            memory: sys::v4l2_memory_V4L2_MEMORY_MMAP,
            ..sys::v4l2_requestbuffers::zeroed()
        };
        self.send(&ioctl::REQBUFS, &mut request)?;
        Ok(request.count)
    }

    fn map(&self, index: u32) -> Result<Mapping> {
        let mut buffer = buffer(index);
        self.send(&ioctl::QUERYBUF, &mut buffer)?;
        // SAFETY: every bit pattern is a valid integer. Drivers set this member for buffers
        // that are to be mapped.
        let offset = unsafe { buffer.m.offset };
        Mapping::new(self.fd(), buffer.length as usize, offset.into())
    }
}

/// The argument of the buffer commands.
fn buffer(index: u32) -> sys::v4l2_buffer {
    sys::v4l2_buffer {
        index,
        type_: BUFFER_TYPE,
        memory: sys::v4l2_memory_V4L2_MEMORY_MMAP,
        ..sys::v4l2_buffer::zeroed()
    }
}

impl VideoDevice for V4l2Device {
    fn start_stream(&mut self, buffers: u32) -> Result<u32> {
        let count = self.request_buffers(buffers)?;
        self.buffers = (0..count).map(|i| self.map(i)).collect::<Result<_>>()?;
        for index in 0..count {
            self.queue(OwnedBuffer::from_kernel(index))?;
        }
        self.send(&ioctl::STREAMON, &mut (BUFFER_TYPE as c_int))?;
        Ok(count)
    }

    fn stop_stream(&mut self) -> Result<()> {
        let stopped = self.send(&ioctl::STREAMOFF, &mut (BUFFER_TYPE as c_int));
        self.buffers.clear();
        // No program can set the format of a device that has buffers.
        let freed = self.request_buffers(0);
        stopped.and(freed.map(|_| ()))
    }

    // `v4l::device::Handle::poll` does not tell which events occurred.
    fn wait(&self, timeout: Duration) -> Result<Readiness> {
        let fd = self.fd();
        let mut polled = [PollFd::new(&fd, PollFlags::IN | PollFlags::PRI)];
        // A timeout that exceeds a Timespec is as good as none.
        let timeout = Timespec::try_from(timeout).ok();
        poll(&mut polled, timeout.as_ref())?;
        let got = polled[0].revents();
        Ok(Readiness {
            frame: got.contains(PollFlags::IN),
            event: got.contains(PollFlags::PRI),
            error: got.intersects(PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL),
        })
    }

    fn dequeue(&mut self) -> Result<FilledBuffer> {
        let mut buffer = buffer(0);
        self.send(&ioctl::DQBUF, &mut buffer)?;
        if buffer.index as usize >= self.buffers.len() {
            // The driver is at fault, which must not make us panic.
            return Err(Errno::IO);
        }
        Ok(FilledBuffer {
            buffer: OwnedBuffer::from_kernel(buffer.index),
            bytes_used: buffer.bytesused as usize,
            flags: Flags::from(buffer.flags),
            sequence: buffer.sequence,
            timestamp: time(buffer.timestamp),
        })
    }

    fn queue(&mut self, owned: OwnedBuffer) -> Result<()> {
        self.send(&ioctl::QBUF, &mut buffer(owned.index()))
    }

    fn bytes<'a>(&'a self, owned: &'a OwnedBuffer, len: usize) -> &'a [u8] {
        let Some(mapping) = self.buffers.get(owned.index() as usize) else {
            return &[];
        };
        // SAFETY: an `OwnedBuffer` exists only while the kernel does not own the buffer. The
        // slice borrows it, so it cannot be queued meanwhile, and `self`, so the stream cannot be
        // stopped.
        unsafe { mapping.bytes(len) }
    }
}

/// A time stamp of the driver. On 32-bit systems it has two parts of 32 or of 64 bits, as the C
/// library was built; the size of the argument in the command's number tells the kernel which.
#[allow(clippy::unnecessary_cast)] // necessary for parts of 32 bits
fn time(stamp: sys::timeval) -> MonotonicTime {
    let seconds = (stamp.tv_sec as i64).saturating_mul(1_000_000_000);
    let micros = (stamp.tv_usec as i64).saturating_mul(1_000);
    MonotonicTime::from_nanos(seconds.saturating_add(micros))
}

/// A text of the driver: up to the first zero byte, and not always valid UTF-8.
fn text<const N: usize>(bytes: [u8; N]) -> String {
    let len = bytes.iter().position(|&b| b == 0).unwrap_or(N);
    String::from_utf8_lossy(&bytes[..len]).trim().to_owned()
}

#[cfg(test)]
mod tests;
