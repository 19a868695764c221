//! The kernel's interface. The only module with unsafe code: structures that the kernel
//! fills in, and memory that it shares with us.

// The kernel is told addresses and writes there; no safe function does that.
#![allow(unsafe_code)]

mod abi;
mod command;
mod controls;
mod mapping;
mod modes;

use crate::video::{Filled, Held, Ready, Video};
use abi::{BUF_TYPE_VIDEO_CAPTURE, Buffer, MEMORY_MMAP, RequestBuffers};
use bytemuck::Zeroable;
use mapping::Mapping;
use penumbra_interface::MonotonicTime;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags, open};
use rustix::io::{Errno, Result};
use std::path::Path;
use std::time::Duration;

/// A video device file that is open. Dropping it closes it, which stops a stream.
pub(crate) struct Node {
    fd: OwnedFd,
    buffers: Vec<Mapping>,
}

impl Node {
    /// Opens a device file without waiting for it.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::io::retry_on_intr(|| open(path, flags, Mode::empty()))?;
        Ok(Self {
            fd,
            buffers: Vec::new(),
        })
    }

    fn buffer(index: u32) -> Buffer {
        Buffer {
            index,
            kind: BUF_TYPE_VIDEO_CAPTURE,
            memory: MEMORY_MMAP,
            ..Buffer::zeroed()
        }
    }

    fn request_buffers(&self, count: u32) -> Result<u32> {
        let mut request = RequestBuffers {
            count,
            kind: BUF_TYPE_VIDEO_CAPTURE,
            memory: MEMORY_MMAP,
            ..RequestBuffers::zeroed()
        };
        command::REQBUFS.call(&self.fd, &mut request)?;
        Ok(request.count)
    }

    fn map(&self, index: u32) -> Result<Mapping> {
        let mut buffer = Self::buffer(index);
        command::QUERYBUF.call(&self.fd, &mut buffer)?;
        Mapping::new(&self.fd, buffer.length as usize, buffer.offset[0].into())
    }
}

impl Video for Node {
    fn start(&mut self, buffers: u32) -> Result<u32> {
        let count = self.request_buffers(buffers)?;
        self.buffers = (0..count).map(|i| self.map(i)).collect::<Result<_>>()?;
        for index in 0..count {
            self.queue(Held::received(index))?;
        }
        command::STREAMON.call(&self.fd, &mut (BUF_TYPE_VIDEO_CAPTURE as i32))?;
        Ok(count)
    }

    fn stop(&mut self) -> Result<()> {
        let stopped = command::STREAMOFF.call(&self.fd, &mut (BUF_TYPE_VIDEO_CAPTURE as i32));
        self.buffers.clear();
        // Buffers that are not given back keep other programs from choosing a format.
        let freed = self.request_buffers(0);
        stopped.and(freed.map(|_| ()))
    }

    fn wait(&self, timeout: Duration) -> Result<Ready> {
        let wanted = PollFlags::IN | PollFlags::PRI;
        let mut fds = [PollFd::new(&self.fd, wanted)];
        // Longer than a Timespec holds is as good as for ever.
        let timeout = Timespec::try_from(timeout).ok();
        poll(&mut fds, timeout.as_ref())?;
        let got = fds[0].revents();
        let error = got.intersects(PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL);
        Ok(Ready {
            frame: got.contains(PollFlags::IN),
            event: got.contains(PollFlags::PRI),
            error,
        })
    }

    fn dequeue(&mut self) -> Result<Filled> {
        let mut buffer = Self::buffer(0);
        command::DQBUF.call(&self.fd, &mut buffer)?;
        if buffer.index as usize >= self.buffers.len() {
            // No driver does; indexing with it must not bring the rig down all the same.
            return Err(Errno::IO);
        }
        let seconds = buffer.seconds.saturating_mul(1_000_000_000);
        let nanos = seconds.saturating_add(buffer.micros.saturating_mul(1_000));
        Ok(Filled {
            held: Held::received(buffer.index),
            used: buffer.bytesused as usize,
            flags: buffer.flags,
            sequence: buffer.sequence,
            stamp: MonotonicTime::from_nanos(nanos),
        })
    }

    fn queue(&mut self, held: Held) -> Result<()> {
        command::QBUF.call(&self.fd, &mut Self::buffer(held.index()))
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

/// Text that a driver filled in: up to the first zero, whatever its encoding.
fn text(bytes: &[u8]) -> String {
    let len = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..len]).trim().to_owned()
}
