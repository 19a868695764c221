//! An open video device of the kernel: the only module with unsafe code.
//!
//! It stands on the crate `v4l` where its calls are safe with every driver, and on its raw
//! bindings elsewhere; each file says which and why. The buffer loop is our own: `Stream::next`
//! of `v4l` 0.14 queues a buffer again that the kernel still owns after every time-out, hands
//! out the whole buffer instead of the bytes used, and panics when a stream cannot be stopped.

// The kernel is given addresses and writes to them, and shares memory with us. No safe
// function does that.
#![allow(unsafe_code)]

mod controls;
mod formats;
mod ioctl;
mod mapping;

use crate::video::{Filled, Held, Ready, Video};
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

/// The kind of buffers that this driver streams: pictures in one plane.
const BUFFER_TYPE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
/// The major number of video4linux devices (kernel, admin-guide/devices.txt).
const VIDEO_MAJOR: u32 = 81;

/// An open video device. Dropping it closes the device file, which stops its stream.
pub(crate) struct Node {
    device: Device,
    buffers: Vec<Mapping>,
}

impl Node {
    /// Opens a device file; its calls will not block.
    ///
    /// # Errors
    /// [`Errno::NOTTY`] if the file is no video4linux device; it is then not opened.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        // Opening another kind of device may have effects (a watchdog starts), and the crate
        // `v4l` panics on paths with a zero byte and on files that cannot be closed without
        // an error, which video4linux devices always can.
        let file = stat(path)?;
        let is_device = FileType::from_raw_mode(file.st_mode) == FileType::CharacterDevice;
        if !is_device || major(file.st_rdev) != VIDEO_MAJOR {
            return Err(Errno::NOTTY);
        }
        let node = Self {
            device: retrying(|| Device::with_path(path))?,
            buffers: Vec::new(),
        };
        // `with_path` leaves the file open in child processes, where it would keep the camera
        // busy.
        fcntl_setfd(node.fd(), FdFlags::CLOEXEC)?;
        Ok(node)
    }

    fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the device keeps its descriptor open for as long as it lives, and the result
        // borrows it.
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
        // SAFETY: the driver filled in this member for buffers to be mapped; every bit pattern
        // is a valid integer.
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

impl Video for Node {
    fn start(&mut self, buffers: u32) -> Result<u32> {
        let count = self.request_buffers(buffers)?;
        self.buffers = (0..count).map(|i| self.map(i)).collect::<Result<_>>()?;
        for index in 0..count {
            self.queue(Held::received(index))?;
        }
        self.send(&ioctl::STREAMON, &mut (BUFFER_TYPE as c_int))?;
        Ok(count)
    }

    fn stop(&mut self) -> Result<()> {
        let stopped = self.send(&ioctl::STREAMOFF, &mut (BUFFER_TYPE as c_int));
        self.buffers.clear();
        // While a device has buffers, no program can set its format.
        let freed = self.request_buffers(0);
        stopped.and(freed.map(|_| ()))
    }

    // `v4l::device::Handle::poll` does not say which of the events came.
    fn wait(&self, timeout: Duration) -> Result<Ready> {
        let fd = self.fd();
        let mut polled = [PollFd::new(&fd, PollFlags::IN | PollFlags::PRI)];
        // A time that no Timespec can hold is as good as no limit.
        let timeout = Timespec::try_from(timeout).ok();
        poll(&mut polled, timeout.as_ref())?;
        let got = polled[0].revents();
        Ok(Ready {
            frame: got.contains(PollFlags::IN),
            event: got.contains(PollFlags::PRI),
            error: got.intersects(PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL),
        })
    }

    fn dequeue(&mut self) -> Result<Filled> {
        let mut buffer = buffer(0);
        self.send(&ioctl::DQBUF, &mut buffer)?;
        if buffer.index as usize >= self.buffers.len() {
            // A fault of the driver, which must not become a panic.
            return Err(Errno::IO);
        }
        Ok(Filled {
            held: Held::received(buffer.index),
            used: buffer.bytesused as usize,
            flags: Flags::from(buffer.flags),
            sequence: buffer.sequence,
            stamp: time(buffer.timestamp),
        })
    }

    fn queue(&mut self, held: Held) -> Result<()> {
        self.send(&ioctl::QBUF, &mut buffer(held.index()))
    }

    fn bytes<'a>(&'a self, held: &'a Held, used: usize) -> &'a [u8] {
        let Some(mapping) = self.buffers.get(held.index() as usize) else {
            return &[];
        };
        let used = used.min(mapping.len());
        // SAFETY: whoever has the `Held` of a buffer has dequeued it and not queued it since,
        // and the slice borrows it, so it cannot be queued meanwhile. `stop` needs `&mut`.
        unsafe { mapping.bytes(used) }
    }
}

/// A time stamp of the driver. On 32-bit systems the C library decides whether its parts have
/// 32 or 64 bits; the kernel learns which from the argument size in the command's number.
#[allow(clippy::unnecessary_cast)] // not unnecessary where the parts have 32 bits
fn time(stamp: sys::timeval) -> MonotonicTime {
    let seconds = (stamp.tv_sec as i64).saturating_mul(1_000_000_000);
    let micros = (stamp.tv_usec as i64).saturating_mul(1_000);
    MonotonicTime::from_nanos(seconds.saturating_add(micros))
}

/// A text of the driver: up to the first zero byte, whatever its encoding.
fn text<const N: usize>(bytes: [u8; N]) -> String {
    let len = bytes.iter().position(|&b| b == 0).unwrap_or(N);
    String::from_utf8_lossy(&bytes[..len]).trim().to_owned()
}
