//! What the driver asks of the kernel, in plain types: implemented by the kernel's
//! interface and, in tests, by a camera that fails on purpose.

use penumbra_interface::{CameraFormat, MonotonicTime};
use rustix::io::{Errno, Result};
use std::time::Duration;
use v4l::{buffer, control};

/// What a wait ended with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Ready {
    /// A buffer can be dequeued, or the attempt says what is wrong.
    pub frame: bool,
    /// A control event waits.
    pub event: bool,
    /// The driver says that waiting is of no use: unplugged, or no stream.
    pub error: bool,
}

/// A buffer that is ours to read. There is one for each buffer that the kernel does not
/// own; it cannot be copied, and queueing it gives it up. So no buffer is queued twice, and
/// none is read while the kernel writes to it.
#[derive(Debug)]
pub(crate) struct Held {
    index: u32,
}

impl Held {
    /// Only for those who got buffer `index` from the kernel just now.
    pub(crate) const fn received(index: u32) -> Self {
        Self { index }
    }

    pub(crate) const fn index(&self) -> u32 {
        self.index
    }
}

/// A buffer that the camera filled.
#[derive(Debug)]
pub(crate) struct Filled {
    /// The buffer.
    pub held: Held,
    /// Bytes of the picture; the rest of the buffer is old.
    pub used: usize,
    pub flags: buffer::Flags,
    /// The driver's counter, from 0 at the start of the stream.
    pub sequence: u32,
    /// The driver's stamp, whose clock `flags` tell.
    pub stamp: MonotonicTime,
}

/// Kinds of control values that can be set as a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ControlKind {
    Integer,
    Boolean,
    Menu,
    Button,
    Integer64,
    Bitmask,
    IntegerMenu,
    /// Text, arrays and whatever comes later: not settable here.
    Other,
}

/// A control as the driver describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ControlDescription {
    pub id: u32,
    /// As the driver spells it: `Exposure Time, Absolute`.
    pub title: String,
    pub kind: ControlKind,
    pub min: i64,
    pub max: i64,
    pub step: i64,
    pub default: i64,
    pub flags: control::Flags,
}

/// Somebody changed a control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ControlEvent {
    pub id: u32,
    /// Whether its value changed; otherwise its flags or range.
    pub value_changed: bool,
    pub value: i64,
}

/// What is streamed, as the driver says it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Geometry {
    pub width: u32,
    pub height: u32,
    pub fourcc: [u8; 4],
    pub bytes_per_line: u32,
    pub frames_per_second: Option<f64>,
}

/// Who the driver says it is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Capabilities {
    pub driver: String,
    pub card: String,
    pub bus: String,
    pub captures: bool,
    pub multiplanar: bool,
    pub streams: bool,
}

/// Setting and reading controls.
pub(crate) trait Controls {
    fn describe_controls(&self) -> Vec<ControlDescription>;
    /// The flags of one control now.
    fn control_flags(&self, id: u32) -> Result<control::Flags>;
    fn control(&self, id: u32, kind: ControlKind) -> Result<i64>;
    fn set_control(&mut self, id: u32, kind: ControlKind, value: i64) -> Result<()>;
    /// Asks for an event whenever somebody else changes the control.
    fn watch_control(&mut self, id: u32) -> Result<()>;
    fn next_event(&mut self) -> Result<Option<ControlEvent>>;
}

/// Choosing what is streamed.
pub(crate) trait Modes {
    fn capabilities(&self) -> Result<Capabilities>;
    fn formats(&self) -> Vec<CameraFormat>;
    fn geometry(&self) -> Result<Geometry>;
    /// Asks for a mode and answers with the one that the driver took.
    fn set_geometry(&mut self, wanted: &Geometry) -> Result<Geometry>;
}

/// Streaming.
pub(crate) trait Video: Controls + Modes + Send {
    /// Asks for buffers, maps them, gives all to the kernel and starts; answers how many.
    fn start(&mut self, buffers: u32) -> Result<u32>;
    /// Stops the stream; the kernel gives up all its buffers.
    fn stop(&mut self) -> Result<()>;
    /// Waits until there is something to do.
    fn wait(&self, timeout: Duration) -> Result<Ready>;
    /// The next filled buffer; [`Errno::AGAIN`] if there is none.
    fn dequeue(&mut self) -> Result<Filled>;
    /// Gives a buffer back to the kernel.
    fn queue(&mut self, held: Held) -> Result<()>;
    /// The first `used` bytes of a buffer that is ours.
    fn bytes<'a>(&'a self, held: &'a Held, used: usize) -> &'a [u8];
}

/// Whether an error says that the device is no longer there.
pub(crate) const fn is_gone(error: Errno) -> bool {
    matches!(error, Errno::NODEV | Errno::NXIO | Errno::SHUTDOWN)
}
