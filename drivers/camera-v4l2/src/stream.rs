//! The buffer loop: waits, takes the newest picture out of the kernel's buffers, gives the
//! buffers back, and counts what is lost, damaged or passed over.

use crate::fourcc;
use crate::jpeg::Jpeg;
use crate::pool::Pool;
use crate::stamps::{Sequence, Stamps};
use crate::trouble;
use crate::video::{Filled, Geometry, Video};
use bytes::Bytes;
use penumbra_interface::{
    CameraCounters, Clock, DeviceError, MonotonicTime, PixelFormat, StampSource,
};
use rustix::io::{Errno, retry_on_intr};
use std::sync::Arc;
use std::time::Duration;
use v4l::buffer::Flags;

/// So many wake-ups in a row without a picture mean that the driver is broken, not slow;
/// polling on would spin.
const MAX_VAIN: u32 = 50;

/// A picture out of the stream, before anything is known of its exposure.
#[derive(Clone, Debug)]
pub(crate) struct Taken {
    pub data: Bytes,
    pub sequence: u64,
    pub stamp: MonotonicTime,
    pub stamp_source: StampSource,
    pub arrived_at: MonotonicTime,
}

/// What a wait gave.
#[derive(Debug)]
pub(crate) enum Next {
    Picture(Taken),
    /// A control event waits.
    Event,
    Nothing,
}

/// How the pictures of a stream are laid out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub format: PixelFormat,
    pub width: u32,
    pub height: u32,
    /// Bytes from row to row; 0 = tight or coded.
    pub stride: u32,
    /// Fewer bytes are no whole picture; 0 for coded ones.
    least: usize,
}

impl Layout {
    /// Of what the driver says it streams; `None` for a format that Penumbra cannot read.
    pub(crate) fn of(geometry: &Geometry) -> Option<Self> {
        let format = fourcc::pixel_format(geometry.fourcc)?;
        let (width, height) = (geometry.width, geometry.height);
        let (stride, least) = match fourcc::tight(format, width, height) {
            None => (0, 0),
            Some((row, rows)) => {
                let stride = geometry.bytes_per_line.max(row);
                // The last row's padding may be cut off.
                let least = u64::from(stride) * u64::from(rows.saturating_sub(1));
                (
                    stride,
                    usize::try_from(least + u64::from(row)).unwrap_or(usize::MAX),
                )
            }
        };
        let is_tight = fourcc::tight(format, width, height).is_none_or(|(row, _)| row == stride);
        Some(Self {
            format,
            width,
            height,
            stride: if is_tight { 0 } else { stride },
            least,
        })
    }
}

/// A picture that nothing speaks against, still in the kernel's buffer.
struct Good {
    filled: Filled,
    sequence: u64,
    /// Where the parts lie, if it is a JPEG.
    jpeg: Option<Jpeg>,
}

/// A stream that runs.
pub(crate) struct Stream<V: Video> {
    pub(crate) video: V,
    device: String,
    clock: Arc<dyn Clock>,
    layout: Layout,
    silence: Duration,
    pool: Pool,
    sequence: Sequence,
    pub(crate) stamps: Stamps,
    /// Whether any JPEG had its end marker: then one without is damaged, and not the habit
    /// of a camera that never sends it.
    ends_seen: bool,
    /// JPEGs taken without an end marker.
    pub(crate) unended: u64,
    pub(crate) counters: CameraCounters,
    last_sign: MonotonicTime,
    buffers: u32,
}

impl<V: Video> Stream<V> {
    /// Starts the stream.
    pub(crate) fn start(
        mut video: V,
        device: &str,
        layout: Layout,
        (buffers, silence): (u32, Duration),
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DeviceError> {
        let buffers = video
            .start(buffers.clamp(2, 32))
            .map_err(|e| trouble::on_setup(device, "starting the stream", e))?;
        Ok(Self {
            video,
            device: device.to_owned(),
            layout,
            silence,
            pool: Pool::default(),
            sequence: Sequence::default(),
            stamps: Stamps::default(),
            ends_seen: false,
            unended: 0,
            counters: CameraCounters::default(),
            last_sign: clock.now(),
            clock,
            buffers,
        })
    }

    /// Waits up to `timeout` for a picture or an event.
    pub(crate) fn next(&mut self, timeout: Duration) -> Result<Next, DeviceError> {
        let until = self.clock.now() + timeout;
        for _ in 0..MAX_VAIN {
            let now = self.clock.now();
            let left = u64::try_from(until.nanos_since(now)).unwrap_or(0);
            let ready = match self.video.wait(Duration::from_nanos(left)) {
                Ok(ready) => ready,
                // The time that is left is worked out anew.
                Err(Errno::INTR) => continue,
                Err(error) => return Err(trouble::on_stream(&self.device, "waiting", error)),
            };
            if ready.event {
                return Ok(Next::Event);
            }
            if ready.frame || ready.error {
                if let Some(taken) = self.newest()? {
                    return Ok(Next::Picture(taken));
                }
                if ready.error {
                    return Err(self.broken("the driver reports an error while waiting"));
                }
            }
            if self.clock.now() >= until {
                return self.heard().map(|()| Next::Nothing);
            }
        }
        Err(self.broken("it says that pictures are there, and none are"))
    }

    /// An error where the camera has been silent for too long.
    fn heard(&self) -> Result<(), DeviceError> {
        let silent = self.clock.now().nanos_since(self.last_sign);
        let silent = Duration::from_nanos(u64::try_from(silent).unwrap_or(0));
        if silent < self.silence {
            return Ok(());
        }
        Err(DeviceError::Silent {
            device: self.device.clone(),
            millis: u64::try_from(silent.as_millis()).unwrap_or(u64::MAX),
        })
    }

    fn broken(&self, reason: &str) -> DeviceError {
        DeviceError::Broken {
            device: self.device.clone(),
            reason: reason.to_owned(),
        }
    }

    /// Takes all filled buffers; the newest good one is copied out, the others are given
    /// back unread.
    fn newest(&mut self) -> Result<Option<Taken>, DeviceError> {
        let mut newest: Option<Good> = None;
        // More than there are buffers come only if the camera fills them faster than this
        // loop turns; the rest is for the next call.
        for _ in 0..=self.buffers {
            let filled = match retry_on_intr(|| self.video.dequeue()) {
                Ok(filled) => filled,
                Err(Errno::AGAIN) => break,
                Err(error) => {
                    return Err(trouble::on_stream(&self.device, "reading a picture", error));
                }
            };
            match self.judge(filled) {
                Err(damaged) => self.give_back(damaged)?,
                Ok(good) => {
                    if let Some(older) = newest.replace(good) {
                        self.counters.superseded += 1;
                        self.give_back(older.filled)?;
                    }
                }
            }
        }
        newest.map(|good| self.take(good)).transpose()
    }

    fn give_back(&mut self, filled: Filled) -> Result<(), DeviceError> {
        self.video
            .queue(filled.held)
            .map_err(|e| trouble::on_stream(&self.device, "giving a buffer back", e))
    }

    /// Counts a picture; it is handed back if it is damaged.
    fn judge(&mut self, filled: Filled) -> Result<Good, Filled> {
        self.last_sign = self.clock.now();
        let (sequence, lost) = self.sequence.follow(filled.sequence);
        self.counters.lost += lost;
        let flagged = filled.flags.contains(Flags::ERROR);
        let is_whole = !flagged && filled.used > 0 && filled.used >= self.layout.least;
        let jpeg = match self.layout.format {
            PixelFormat::Jpeg if is_whole => self.find_jpeg(&filled).map(Some),
            _ => Some(None),
        };
        match jpeg {
            Some(jpeg) if is_whole => Ok(Good {
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

    /// A JPEG that is whole, as far as its markers tell.
    fn find_jpeg(&mut self, filled: &Filled) -> Option<Jpeg> {
        let found = Jpeg::find(self.video.bytes(&filled.held, filled.used)).ok()?;
        self.ends_seen |= found.ended;
        (found.ended || !self.ends_seen).then_some(found)
    }

    /// Copies a picture out of its buffer, which goes back to the kernel.
    fn take(&mut self, good: Good) -> Result<Taken, DeviceError> {
        let Good {
            filled,
            sequence,
            jpeg,
        } = good;
        let arrived_at = self.clock.now();
        let (stamp, stamp_source) = self.stamps.read(&filled, arrived_at);
        self.unended += u64::from(jpeg.is_some_and(|found| !found.ended));
        let bytes = self.video.bytes(&filled.held, filled.used);
        let data = self.pool.bytes(|buffer| match jpeg {
            Some(found) => found.write(bytes, buffer),
            None => buffer.extend_from_slice(bytes),
        });
        self.give_back(filled)?;
        Ok(Taken {
            data,
            sequence,
            stamp,
            stamp_source,
            arrived_at,
        })
    }
}

impl<V: Video> Drop for Stream<V> {
    fn drop(&mut self) {
        // The device may be gone, and closing it stops the stream anyway.
        let _ = self.video.stop();
    }
}

#[cfg(test)]
mod tests;
