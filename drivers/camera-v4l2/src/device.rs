//! The video device as the rest of the driver sees it: plain types, and traits that the kernel
//! interface implements and, in tests, a fake device that fails on demand.

use penumbra_interface::{CameraFormat, MonotonicTime};
use rustix::io::{Errno, Result};
use std::time::Duration;
use v4l::{buffer, control};

/// The events that ended a wait. All false: it timed out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Readiness {
    /// A buffer can be dequeued, or dequeuing returns the error.
    pub frame: bool,
    /// A control event can be read.
    pub event: bool,
    /// The device is unplugged or does not stream.
    pub error: bool,
}

/// The right to read one buffer, which the kernel does not own at present.
///
/// There is one value for each such buffer. It cannot be copied, and queueing the buffer
/// consumes it, so no buffer is queued twice or read while the kernel writes to it.
#[derive(Debug)]
pub(crate) struct OwnedBuffer {
    index: u32,
}

impl OwnedBuffer {
    /// Only for buffers that the kernel has just allocated or given back.
    pub(crate) const fn from_kernel(index: u32) -> Self {
        Self { index }
    }

    pub(crate) const fn index(&self) -> u32 {
        self.index
    }
}

/// A buffer with a frame in it.
#[derive(Debug)]
pub(crate) struct FilledBuffer {
    pub buffer: OwnedBuffer,
    /// Bytes of the frame. Whatever follows them is left from older frames.
    pub bytes_used: usize,
    pub flags: buffer::Flags,
    /// The driver's frame counter, which starts at 0 with the stream.
    pub sequence: u32,
    /// The driver's time stamp. `flags` define its clock and its instant.
    pub timestamp: MonotonicTime,
}

/// The type of a control's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ControlKind {
    Integer,
    Boolean,
    Menu,
    Button,
    Integer64,
    Bitmask,
    IntegerMenu,
    /// Text, arrays and types of newer kernels, none of which is a single number.
    Other,
}

/// A control as the driver describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ControlDescription {
    pub id: u32,
    /// The driver's name: `Exposure Time, Absolute`.
    pub title: String,
    pub kind: ControlKind,
    pub min: i64,
    pub max: i64,
    pub step: i64,
    pub default: i64,
    pub flags: control::Flags,
}

/// Another program changed a control that is subscribed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ControlEvent {
    pub id: u32,
    /// False if only its flags or its range changed.
    pub value_changed: bool,
}

/// Size, pixel format and rate of a stream, as the driver reports them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CaptureFormat {
    pub width: u32,
    pub height: u32,
    pub fourcc: [u8; 4],
    pub bytes_per_line: u32,
    pub frames_per_second: Option<f64>,
}

/// Capabilities of the device, as reported by the driver.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Capabilities {
    pub driver: String,
    /// The name of the product.
    pub card: String,
    /// Where the device is connected.
    pub bus: String,
    /// Captures pictures in one plane.
    pub captures: bool,
    /// Captures pictures in several planes, which this driver does not read.
    pub multiplanar: bool,
    /// Streams through buffers, as opposed to `read()`.
    pub streams: bool,
}

/// Reading and writing controls.
pub(crate) trait Controls {
    fn describe_controls(&self) -> Vec<ControlDescription>;
    /// The present flags of one control.
    fn control_flags(&self, id: u32) -> Result<control::Flags>;
    fn read_control(&self, id: u32, kind: ControlKind) -> Result<i64>;
    fn write_control(&mut self, id: u32, kind: ControlKind, value: i64) -> Result<()>;
    /// Asks for an event whenever another program changes the control.
    fn subscribe_control(&mut self, id: u32) -> Result<()>;
    fn next_event(&mut self) -> Result<Option<ControlEvent>>;
}

/// Choosing what is streamed.
pub(crate) trait Formats {
    fn capabilities(&self) -> Result<Capabilities>;
    fn formats(&self) -> Vec<CameraFormat>;
    fn format(&self) -> Result<CaptureFormat>;
    /// Requests a format and returns the one that the driver set instead.
    fn set_format(&mut self, wanted: &CaptureFormat) -> Result<CaptureFormat>;
}

/// A device that streams.
pub(crate) trait VideoDevice: Controls + Formats + Send {
    /// Allocates and maps buffers, queues all of them, and starts the stream. Returns the
    /// number of buffers, which the driver may have changed.
    fn start_stream(&mut self, buffers: u32) -> Result<u32>;
    /// Stops the stream and frees the buffers.
    fn stop_stream(&mut self) -> Result<()>;
    /// Waits for a frame or an event.
    fn wait(&self, timeout: Duration) -> Result<Readiness>;
    /// Takes the next filled buffer from the kernel; [`Errno::AGAIN`] if there is none.
    fn dequeue(&mut self) -> Result<FilledBuffer>;
    /// Gives a buffer back to the kernel, to be filled again.
    fn queue(&mut self, buffer: OwnedBuffer) -> Result<()>;
    /// The first `len` bytes of a buffer.
    fn bytes<'a>(&'a self, buffer: &'a OwnedBuffer, len: usize) -> &'a [u8];
}

/// Whether an error means that the device is no longer there.
pub(crate) const fn is_disconnected(error: Errno) -> bool {
    matches!(error, Errno::NODEV | Errno::NXIO | Errno::SHUTDOWN)
}
