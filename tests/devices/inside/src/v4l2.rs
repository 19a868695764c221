//! The part of Video for Linux that the tests of the guest need.
//!
//! Devices and controls are accessed by the crate `v4l`, which may panic in a test; events and
//! buffers by its raw bindings, because its streams cannot continue after a time-out. Penumbra's
//! driver is not used, so that tests of the guest do not depend on it.
#![allow(unsafe_code)] // ioctl and mmap: each block gives its reason

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::BorrowedFd;
use rustix::io::{Errno, Result};
use rustix::ioctl::opcode;
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;
use std::mem::zeroed;
use std::path::Path;
use std::ptr::from_mut;
use std::time::Duration;
use v4l::buffer::Flags;
use v4l::control::{Control, Value};
use v4l::v4l2::vidioc::{self, _IOC_TYPE as Number};
use v4l::video::Capture;
use v4l::{Device, Format, FourCC, v4l_sys as sys};

/// 1 is automatic.
pub const AUTO_WHITE_BALANCE: u32 = 0x0098_090c;
/// In steps of the camera.
pub const GAIN: u32 = 0x0098_0913;
/// 1 is 50 Hz, 2 is 60 Hz.
pub const POWER_LINE_FREQUENCY: u32 = 0x0098_0918;
/// Kelvin.
pub const WHITE_BALANCE_TEMPERATURE: u32 = 0x0098_091a;
/// 1 is manual, 3 is aperture priority: automatic.
pub const AUTO_EXPOSURE: u32 = 0x009a_0901;
/// 100 µs.
pub const EXPOSURE_TIME: u32 = 0x009a_0902;
/// In steps of the camera.
pub const FOCUS: u32 = 0x009a_090a;
/// How many frames to lose. This and the following controls make `vivid` produce faults
/// (drivers/media/test-drivers/vivid/vivid-ctrls.c).
pub const VIVID_LOST_PERCENT: u32 = 0x00f0_f040;
/// Until the last program has closed the device.
pub const VIVID_DISCONNECT: u32 = 0x00f0_f041;
/// On the next frame.
pub const VIVID_BUFFER_ERROR: u32 = 0x00f0_f042;
/// On the next frame; the stream must then be started again.
pub const VIVID_FATAL_ERROR: u32 = 0x00f0_f046;

const CAPTURE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
const MMAP: u32 = sys::v4l2_memory_V4L2_MEMORY_MMAP;
const BUFFERS: u32 = 4;
// The crate `v4l` does not have the numbers of the event commands.
const DQEVENT: Number = opcode::read::<sys::v4l2_event>(b'V', 89) as Number;
const SUBSCRIBE_EVENT: Number = opcode::write::<sys::v4l2_event_subscription>(b'V', 90) as Number;

fn errno<T>(result: std::io::Result<T>) -> Result<T> {
    result.map_err(|error| Errno::from_io_error(&error).expect("an error of the kernel"))
}

/// An open camera.
pub struct Camera(Device);

impl Camera {
    /// Opens a device file.
    pub fn open(path: &Path) -> std::io::Result<Self> {
        Device::with_path(path).map(Self)
    }

    fn send<T>(&self, number: Number, argument: &mut T) -> Result<()> {
        // SAFETY: every call below passes the structure that belongs to the command's number.
        errno(unsafe { v4l::v4l2::ioctl(self.0.handle().fd(), number, from_mut(argument).cast()) })
    }

    fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the device, which the result borrows, keeps the descriptor open.
        unsafe { BorrowedFd::borrow_raw(self.0.handle().fd()) }
    }

    /// Sets size and format; the driver must accept exactly these.
    pub fn set_format(&self, width: u32, height: u32, fourcc: &[u8; 4]) -> Result<()> {
        let fourcc = FourCC::new(fourcc);
        let got = errno(self.0.set_format(&Format::new(width, height, fourcc)))?;
        let set = (got.width, got.height, got.fourcc);
        assert_eq!(
            set,
            (width, height, fourcc),
            "the driver sets another format"
        );
        Ok(())
    }

    /// The value of a control.
    pub fn get(&self, id: u32) -> Result<i32> {
        match errno(self.0.control(id))?.value {
            Value::Integer(value) => Ok(i32::try_from(value).expect("32 bits")),
            Value::Boolean(value) => Ok(value.into()),
            other => panic!("control {id:#x} is {other:?}"),
        }
    }

    /// Sets a control.
    pub fn set(&self, id: u32, value: i32) -> Result<()> {
        let value = Value::Integer(value.into());
        errno(self.0.set_control(Control { id, value }))
    }

    /// Subscribes to changes of a control by others: see [`Camera::next_change`].
    pub fn watch(&self, id: u32) -> Result<()> {
        let mut subscription = sys::v4l2_event_subscription {
            type_: sys::V4L2_EVENT_CTRL,
            id,
            // SAFETY: integers, which may be zero.
            ..unsafe { zeroed() }
        };
        self.send(SUBSCRIBE_EVENT, &mut subscription)
    }

    /// A control that another program has changed, if there is one.
    pub fn next_change(&self, timeout: Duration) -> Result<Option<u32>> {
        let ready = self.ready(PollFlags::PRI, timeout)?;
        if !ready.contains(PollFlags::PRI) {
            return Ok(None);
        }
        // SAFETY: integers, which may be zero.
        let mut event: sys::v4l2_event = unsafe { zeroed() };
        self.send(DQEVENT, &mut event)?;
        Ok((event.type_ == sys::V4L2_EVENT_CTRL).then_some(event.id))
    }

    fn ready(&self, what: PollFlags, timeout: Duration) -> Result<PollFlags> {
        let fd = self.fd();
        let mut polled = [PollFd::new(&fd, what)];
        let limit = Timespec::try_from(timeout).expect("a short time");
        poll(&mut polled, Some(&limit))?;
        Ok(polled[0].revents())
    }

    /// Starts a stream.
    pub fn stream(&self) -> Result<Stream<'_>> {
        let buffers = self.request_buffers(BUFFERS)?;
        let mut stream = Stream {
            camera: self,
            maps: Vec::new(),
        };
        for index in 0..buffers {
            let mut found = buffer(index);
            self.send(vidioc::VIDIOC_QUERYBUF, &mut found)?;
            stream.maps.push(Map::new(self.fd(), &found)?);
            self.send(vidioc::VIDIOC_QBUF, &mut buffer(index))?;
        }
        self.send(vidioc::VIDIOC_STREAMON, &mut { CAPTURE })?;
        Ok(stream)
    }

    fn request_buffers(&self, count: u32) -> Result<u32> {
        let mut request = sys::v4l2_requestbuffers {
            count,
            type_: CAPTURE,
            memory: MMAP,
            // SAFETY: integers, which may be zero.
            ..unsafe { zeroed() }
        };
        self.send(vidioc::VIDIOC_REQBUFS, &mut request)?;
        Ok(request.count)
    }
}

fn buffer(index: u32) -> sys::v4l2_buffer {
    sys::v4l2_buffer {
        index,
        type_: CAPTURE,
        memory: MMAP,
        // SAFETY: integers and unions of integers and pointers, which may be zero.
        ..unsafe { zeroed() }
    }
}

/// A buffer of the driver, mapped for reading.
struct Map {
    begin: *mut c_void,
    length: usize,
}

impl Map {
    fn new(fd: BorrowedFd<'_>, buffer: &sys::v4l2_buffer) -> Result<Self> {
        let length = buffer.length as usize;
        let (access, flags) = (ProtFlags::READ, MapFlags::SHARED);
        // SAFETY: every bit pattern is a valid integer, and the kernel chooses the address, so
        // no existing mapping is replaced.
        let begin = unsafe {
            let offset = buffer.m.offset.into();
            mmap(std::ptr::null_mut(), length, access, flags, fd, offset)?
        };
        Ok(Self { begin, length })
    }

    fn copy(&self, used: u32) -> Vec<u8> {
        assert!(
            used as usize <= self.length,
            "more bytes than the buffer has"
        );
        // SAFETY: mapped to `length`, and dequeued, so the driver does not write to it.
        unsafe { std::slice::from_raw_parts(self.begin.cast::<u8>(), used as usize) }.to_vec()
    }
}

impl Drop for Map {
    fn drop(&mut self) {
        // SAFETY: mapped by `new`, and `copy` returns no reference.
        let _ = unsafe { munmap(self.begin, self.length) };
    }
}

/// A copy of a frame.
#[derive(Debug)]
pub struct Frame {
    /// Its bytes.
    pub data: Vec<u8>,
    /// The driver's frame counter.
    pub sequence: u32,
    /// The driver's time stamp, microseconds of the monotonic clock.
    pub micros: i64,
    /// Whether the driver flags the frame as damaged.
    pub damaged: bool,
}

/// A running stream; dropping it stops it.
pub struct Stream<'a> {
    camera: &'a Camera,
    maps: Vec<Map>,
}

impl Stream<'_> {
    /// The next frame; `TIMEDOUT` if none arrives.
    pub fn next(&mut self, timeout: Duration) -> Result<Frame> {
        if self.camera.ready(PollFlags::IN, timeout)?.is_empty() {
            return Err(Errno::TIMEDOUT);
        }
        let mut filled = buffer(0);
        self.camera.send(vidioc::VIDIOC_DQBUF, &mut filled)?;
        let flags = Flags::from(filled.flags);
        assert!(
            flags.contains(Flags::TIMESTAMP_MONOTONIC),
            "not a time stamp of the monotonic clock"
        );
        let frame = Frame {
            data: self.maps[filled.index as usize].copy(filled.bytesused),
            sequence: filled.sequence,
            micros: filled.timestamp.tv_sec * 1_000_000 + filled.timestamp.tv_usec,
            damaged: flags.contains(Flags::ERROR),
        };
        self.camera
            .send(vidioc::VIDIOC_QBUF, &mut buffer(filled.index))?;
        Ok(frame)
    }

    /// The next frames, each of which must be later than the one before.
    pub fn take(&mut self, count: usize) -> Vec<Frame> {
        let frames: Vec<_> = (0..count)
            .map(|i| {
                self.next(Duration::from_secs(3))
                    .unwrap_or_else(|e| panic!("frame {i}: {e}"))
            })
            .collect();
        for pair in frames.windows(2) {
            assert!(pair[1].sequence > pair[0].sequence, "sequence");
            assert!(pair[1].micros > pair[0].micros, "time stamps");
        }
        frames
    }

    /// The first error within this many frames.
    pub fn error_within(&mut self, count: usize) -> Option<Errno> {
        (0..count).find_map(|_| self.next(Duration::from_secs(3)).err())
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        // Both fail if the camera is disconnected.
        let _ = self.camera.send(vidioc::VIDIOC_STREAMOFF, &mut { CAPTURE });
        self.maps.clear();
        let _ = self.camera.request_buffers(0);
    }
}
