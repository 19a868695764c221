//! Video for Linux, as little of it as the tests of the guest need.
//!
//! Source: include/uapi/linux/videodev2.h of the kernel, on a 64-bit machine.
#![allow(unsafe_code)] // ioctl and mmap: each block says why it is sound

mod abi;

use abi::{
    BUFFERS, Buffer, CAPTURE, Control, DQBUF, DQEVENT, EVENT_CONTROL, Event, EventSubscription,
    FLAG_ERROR, FLAG_MONOTONIC, Format, G_CTRL, MAPPED, QBUF, QUERYBUF, REQBUFS, RequestBuffers,
    S_CTRL, S_FMT, STREAMOFF, STREAMON, SUBSCRIBE_EVENT, mapped,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, Result};
use rustix::ioctl::{Opcode, Setter, Updater, ioctl};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ffi::c_void;
use std::fs::{File, OpenOptions};
use std::path::Path;
use std::time::Duration;

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
/// How many frames are lost. This and what follows are faults that vivid can be told to have
/// (drivers/media/test-drivers/vivid/vivid-ctrls.c).
pub const VIVID_LOST_PERCENT: u32 = 0x00f0_f040;
/// Until the last program has closed it.
pub const VIVID_DISCONNECT: u32 = 0x00f0_f041;
/// On the next frame.
pub const VIVID_BUFFER_ERROR: u32 = 0x00f0_f042;
/// On the next frame; the stream has to be begun anew.
pub const VIVID_FATAL_ERROR: u32 = 0x00f0_f046;

/// A camera that is open.
pub struct Camera(File);

impl Camera {
    /// Opens a node.
    pub fn open(path: &Path) -> std::io::Result<Self> {
        OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .map(Self)
    }

    fn update<const REQUEST: Opcode, T>(&self, value: &mut T) -> Result<()> {
        // SAFETY: every REQUEST in this file is made from the type that goes with it.
        unsafe { ioctl(&self.0, Updater::<REQUEST, T>::new(value)) }
    }

    fn write<const REQUEST: Opcode, T>(&self, value: T) -> Result<()> {
        // SAFETY: as above; these requests only read the value.
        unsafe { ioctl(&self.0, Setter::<REQUEST, T>::new(value)) }
    }

    /// Sets size and format; the driver must take exactly these.
    pub fn set_format(&self, width: u32, height: u32, fourcc: &[u8; 4]) -> Result<()> {
        let pixel_format = u32::from_le_bytes(*fourcc);
        let mut format = Format {
            kind: CAPTURE,
            _align: 0,
            width,
            height,
            pixel_format,
            rest: [0; 47],
        };
        self.update::<S_FMT, _>(&mut format)?;
        let got = (format.width, format.height, format.pixel_format);
        assert_eq!(
            got,
            (width, height, pixel_format),
            "the driver takes another format"
        );
        Ok(())
    }

    /// A control's value.
    pub fn get(&self, id: u32) -> Result<i32> {
        let mut control = Control { id, value: 0 };
        self.update::<G_CTRL, _>(&mut control)
            .map(|()| control.value)
    }

    /// Sets a control.
    pub fn set(&self, id: u32, value: i32) -> Result<()> {
        self.update::<S_CTRL, _>(&mut Control { id, value })
    }

    /// From now on tells when anyone else changes a control: see [`Camera::next_change`].
    pub fn watch(&self, id: u32) -> Result<()> {
        self.write::<SUBSCRIBE_EVENT, _>(EventSubscription {
            kind: EVENT_CONTROL,
            id,
            rest: [0; 6],
        })
    }

    /// Which watched control was changed, if one was.
    pub fn next_change(&self, timeout: Duration) -> Result<Option<u32>> {
        if !self
            .ready(PollFlags::PRI, timeout)?
            .contains(PollFlags::PRI)
        {
            return Ok(None);
        }
        let mut event = Event {
            kind: 0,
            rest: [0; 33],
        };
        self.update::<DQEVENT, _>(&mut event)?;
        // Eight bytes aligned union of 64 bytes after the type; then pending, sequence, a time
        // of two 64-bit words, and the id.
        Ok((event.kind == EVENT_CONTROL).then(|| event.rest[23]))
    }

    fn ready(&self, what: PollFlags, timeout: Duration) -> Result<PollFlags> {
        let mut polled = [PollFd::new(&self.0, what)];
        let limit = Timespec::try_from(timeout).expect("a short time");
        poll(&mut polled, Some(&limit))?;
        Ok(polled[0].revents())
    }

    /// Begins to stream.
    pub fn stream(&self) -> Result<Stream<'_>> {
        let mut request = RequestBuffers {
            count: BUFFERS,
            kind: CAPTURE,
            memory: MAPPED,
            rest: [0; 2],
        };
        self.update::<REQBUFS, _>(&mut request)?;
        let mut stream = Stream {
            camera: self,
            maps: Vec::new(),
        };
        for index in 0..request.count {
            let mut buffer = mapped(index);
            self.update::<QUERYBUF, _>(&mut buffer)?;
            stream.maps.push(Map::new(&self.0, &buffer)?);
            self.update::<QBUF, _>(&mut mapped(index))?;
        }
        self.write::<STREAMON, _>(CAPTURE)?;
        Ok(stream)
    }
}

/// Memory of the driver, mapped in.
struct Map {
    begin: *mut c_void,
    length: usize,
}

impl Map {
    fn new(file: &File, buffer: &Buffer) -> Result<Self> {
        let length = buffer.length as usize;
        let offset = buffer.offset & u64::from(u32::MAX);
        // SAFETY: a new mapping where the kernel likes; nobody else holds what it replaces.
        let begin = unsafe {
            mmap(
                std::ptr::null_mut(),
                length,
                ProtFlags::READ,
                MapFlags::SHARED,
                file,
                offset,
            )?
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
        // SAFETY: mapped by `new`, and `copy` gives no reference away.
        let _ = unsafe { munmap(self.begin, self.length) };
    }
}

/// One frame, copied.
#[derive(Debug)]
pub struct Frame {
    /// Its bytes.
    pub data: Vec<u8>,
    /// The driver's counter.
    pub sequence: u32,
    /// The driver's time stamp, microseconds of the monotonic clock.
    pub micros: i64,
    /// Whether the driver says that it arrived with errors.
    pub damaged: bool,
}

/// A camera that streams; dropping it stops it.
pub struct Stream<'a> {
    camera: &'a Camera,
    maps: Vec<Map>,
}

impl Stream<'_> {
    /// The next frame; `TIMEDOUT` if none comes.
    pub fn next(&mut self, timeout: Duration) -> Result<Frame> {
        if self.camera.ready(PollFlags::IN, timeout)?.is_empty() {
            return Err(Errno::TIMEDOUT);
        }
        let mut buffer = mapped(0);
        self.camera.update::<DQBUF, _>(&mut buffer)?;
        assert!(
            buffer.flags & FLAG_MONOTONIC != 0,
            "not stamped on the monotonic clock"
        );
        let frame = Frame {
            data: self.maps[buffer.index as usize].copy(buffer.used),
            sequence: buffer.sequence,
            micros: buffer.seconds * 1_000_000 + buffer.micros,
            damaged: buffer.flags & FLAG_ERROR != 0,
        };
        self.camera.update::<QBUF, _>(&mut mapped(buffer.index))?;
        Ok(frame)
    }

    /// So many frames, each later than the one before.
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

    /// The first error within so many frames.
    pub fn error_within(&mut self, count: usize) -> Option<Errno> {
        (0..count).find_map(|_| self.next(Duration::from_secs(3)).err())
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        // A camera that is gone says so here, too.
        let _ = self.camera.write::<STREAMOFF, _>(CAPTURE);
        self.maps.clear();
        let none = RequestBuffers {
            count: 0,
            kind: CAPTURE,
            memory: MAPPED,
            rest: [0; 2],
        };
        let _ = self.camera.update::<REQBUFS, _>(&mut { none });
    }
}
