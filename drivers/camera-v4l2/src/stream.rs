//! The buffer loop: waits, takes the newest frame out of the kernel's buffers, returns the
//! buffers, and counts lost, damaged and superseded frames.

use crate::device::{CaptureFormat, FilledBuffer, VideoDevice};
use crate::error;
use crate::fourcc;
use crate::jpeg::Jpeg;
use crate::pool::Pool;
use crate::timestamps::{FrameCounter, Timestamps};
use bytes::Bytes;
use penumbra_interface::{
    CameraCounters, Clock, DeviceError, MonotonicTime, PixelFormat, StampSource,
};
use rustix::io::{Errno, retry_on_intr};
use std::sync::Arc;
use std::time::Duration;
use v4l::buffer::Flags;

/// A driver that reports a frame this many times in a row without delivering one is broken.
/// Waiting on would keep a processor busy.
const MAX_EMPTY_WAKE_UPS: u32 = 50;

/// A frame of the stream, before its exposure is known.
#[derive(Clone, Debug)]
pub(crate) struct StreamFrame {
    pub data: Bytes,
    pub sequence: u64,
    pub timestamp: MonotonicTime,
    pub timestamp_source: StampSource,
    pub arrived_at: MonotonicTime,
}

/// What ended a wait.
#[derive(Debug)]
pub(crate) enum StreamItem {
    Frame(StreamFrame),
    /// A control event can be read.
    ControlEvent,
    TimedOut,
}

/// How the frames of a stream are laid out in memory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameLayout {
    pub format: PixelFormat,
    pub width: u32,
    pub height: u32,
    /// Bytes from one row to the next; 0 if rows have no padding or the format is compressed.
    pub stride: u32,
    /// Bytes of a complete frame at least; 0 for compressed formats.
    min_bytes: usize,
}

impl FrameLayout {
    /// The layout of a format; `None` if Penumbra cannot read the format.
    pub(crate) fn of(capture: &CaptureFormat) -> Option<Self> {
        let format = fourcc::pixel_format(capture.fourcc)?;
        let (width, height) = (capture.width, capture.height);
        let (stride, min_bytes) = match fourcc::packed_rows(format, width, height) {
            None => (0, 0),
            Some((row, rows)) => {
                let stride = capture.bytes_per_line.max(row);
                // The last row may come without its padding.
                let bytes = u64::from(stride) * u64::from(rows.saturating_sub(1)) + u64::from(row);
                let is_packed = stride == row;
                (
                    if is_packed { 0 } else { stride },
                    usize::try_from(bytes).unwrap_or(usize::MAX),
                )
            }
        };
        Some(Self {
            format,
            width,
            height,
            stride,
            min_bytes,
        })
    }
}

/// A frame without known damage, still in the kernel's buffer.
struct CheckedFrame {
    filled: FilledBuffer,
    sequence: u64,
    /// For JPEG frames.
    jpeg: Option<Jpeg>,
}

/// A running stream. Dropping it stops the stream.
pub(crate) struct Stream<D: VideoDevice> {
    pub(crate) device: D,
    /// The device file, for error messages.
    name: String,
    clock: Arc<dyn Clock>,
    layout: FrameLayout,
    silence_limit: Duration,
    pool: Pool,
    counter: FrameCounter,
    pub(crate) timestamps: Timestamps,
    /// Whether any JPEG frame had an end marker. If so, one without it is damaged; if not,
    /// the camera never sends it.
    end_markers_seen: bool,
    /// JPEG frames that were accepted without an end marker.
    pub(crate) without_end_marker: u64,
    pub(crate) counters: CameraCounters,
    last_frame_at: MonotonicTime,
    buffers: u32,
}

impl<D: VideoDevice> Stream<D> {
    /// Starts the stream with about `buffers` buffers. A camera that delivers nothing for
    /// `silence_limit` is reported as silent.
    pub(crate) fn start(
        mut device: D,
        name: &str,
        layout: FrameLayout,
        (buffers, silence_limit): (u32, Duration),
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DeviceError> {
        let buffers = device
            .start_stream(buffers.clamp(2, 32))
            .map_err(|e| error::setup_failed(name, "starting the stream", e))?;
        Ok(Self {
            device,
            name: name.to_owned(),
            layout,
            silence_limit,
            pool: Pool::default(),
            counter: FrameCounter::default(),
            timestamps: Timestamps::default(),
            end_markers_seen: false,
            without_end_marker: 0,
            counters: CameraCounters::default(),
            last_frame_at: clock.now(),
            clock,
            buffers,
        })
    }

    /// Waits up to `timeout` for a frame or a control event.
    pub(crate) fn next(&mut self, timeout: Duration) -> Result<StreamItem, DeviceError> {
        let until = self.clock.now() + timeout;
        for _ in 0..MAX_EMPTY_WAKE_UPS {
            let left = u64::try_from(until.nanos_since(self.clock.now())).unwrap_or(0);
            let ready = match self.device.wait(Duration::from_nanos(left)) {
                Ok(ready) => ready,
                // Not retried there, because the time left has changed.
                Err(Errno::INTR) => continue,
                Err(errno) => return Err(self.failed("waiting for a frame", errno)),
            };
            if ready.event {
                return Ok(StreamItem::ControlEvent);
            }
            if ready.frame || ready.error {
                if let Some(frame) = self.take_newest()? {
                    return Ok(StreamItem::Frame(frame));
                }
                if ready.error {
                    return Err(self.broken("the driver reports an error while waiting"));
                }
            }
            if self.clock.now() >= until {
                return self.check_silence().map(|()| StreamItem::TimedOut);
            }
        }
        Err(self.broken("the driver reports frames but delivers none"))
    }

    /// An error if the camera has delivered nothing for too long.
    fn check_silence(&self) -> Result<(), DeviceError> {
        let silent = self.clock.now().nanos_since(self.last_frame_at);
        let silent = Duration::from_nanos(u64::try_from(silent).unwrap_or(0));
        if silent < self.silence_limit {
            return Ok(());
        }
        Err(DeviceError::Silent {
            device: self.name.clone(),
            millis: u64::try_from(silent.as_millis()).unwrap_or(u64::MAX),
        })
    }

    fn failed(&self, step: &str, errno: Errno) -> DeviceError {
        error::stream_failed(&self.name, step, errno)
    }

    fn broken(&self, reason: &str) -> DeviceError {
        DeviceError::Broken {
            device: self.name.clone(),
            reason: reason.to_owned(),
        }
    }

    /// Dequeues all filled buffers. Copies the newest undamaged frame and returns the others
    /// unread.
    fn take_newest(&mut self) -> Result<Option<StreamFrame>, DeviceError> {
        let mut newest: Option<CheckedFrame> = None;
        // More frames than buffers arrive only if the camera is faster than this loop. They
        // are left for the next call.
        for _ in 0..=self.buffers {
            let filled = match retry_on_intr(|| self.device.dequeue()) {
                Ok(filled) => filled,
                Err(Errno::AGAIN) => break,
                Err(errno) => return Err(self.failed("reading a frame", errno)),
            };
            match self.check(filled) {
                Err(damaged) => self.requeue(damaged)?,
                Ok(good) => {
                    if let Some(older) = newest.replace(good) {
                        self.counters.superseded += 1;
                        self.requeue(older.filled)?;
                    }
                }
            }
        }
        newest.map(|frame| self.copy_out(frame)).transpose()
    }

    fn requeue(&mut self, filled: FilledBuffer) -> Result<(), DeviceError> {
        let queued = self.device.queue(filled.buffer);
        queued.map_err(|errno| self.failed("returning a buffer", errno))
    }

    /// Counts a frame. Returns its buffer as an error if the frame is damaged.
    fn check(&mut self, filled: FilledBuffer) -> Result<CheckedFrame, FilledBuffer> {
        self.last_frame_at = self.clock.now();
        let (sequence, lost) = self.counter.advance(filled.sequence);
        self.counters.lost += lost;
        let is_complete = !filled.flags.contains(Flags::ERROR)
            && filled.bytes_used > 0
            && filled.bytes_used >= self.layout.min_bytes;
        let jpeg = match self.layout.format {
            PixelFormat::Jpeg if is_complete => self.parse_jpeg(&filled).map(Some),
            _ => Some(None),
        };
        match jpeg {
            Some(jpeg) if is_complete => Ok(CheckedFrame {
                filled,
                sequence,
                jpeg,
            }),
            _ => {
                self.counters.damaged += 1;
                Err(filled)
            }
        }
    }

    /// The layout of a JPEG frame; `None` if its markers show damage.
    fn parse_jpeg(&mut self, filled: &FilledBuffer) -> Option<Jpeg> {
        let data = self.device.bytes(&filled.buffer, filled.bytes_used);
        let jpeg = Jpeg::parse(data).ok()?;
        self.end_markers_seen |= jpeg.has_end;
        (jpeg.has_end || !self.end_markers_seen).then_some(jpeg)
    }

    /// Copies a frame out of its buffer and returns the buffer to the kernel.
    fn copy_out(&mut self, frame: CheckedFrame) -> Result<StreamFrame, DeviceError> {
        let CheckedFrame {
            filled,
            sequence,
            jpeg,
        } = frame;
        let arrived_at = self.clock.now();
        let (timestamp, timestamp_source) = self.timestamps.interpret(&filled, arrived_at);
        self.without_end_marker += u64::from(jpeg.is_some_and(|jpeg| !jpeg.has_end));
        let bytes = self.device.bytes(&filled.buffer, filled.bytes_used);
        let data = self.pool.bytes(|buffer| match jpeg {
            Some(jpeg) => jpeg.write_complete(bytes, buffer),
            None => buffer.extend_from_slice(bytes),
        });
        self.requeue(filled)?;
        Ok(StreamFrame {
            data,
            sequence,
            timestamp,
            timestamp_source,
            arrived_at,
        })
    }
}

impl<D: VideoDevice> Drop for Stream<D> {
    fn drop(&mut self) {
        // The device may be disconnected, and closing it stops the stream anyway.
        let _ = self.device.stop_stream();
    }
}

#[cfg(test)]
mod tests;
