//! Frames of a recording that wait for the light of their instant, which depends on the next
//! environment picture.

use crate::frame::PreparedFrame;
use penumbra_interface::MonotonicTime;
use std::collections::VecDeque;

/// Maximum size of all pictures that wait, bytes: 200 frames of 640×480, 32 of 1920×1080.
const MAX_BYTES: usize = 256 << 20;

/// The waiting frames, in the order of the recording.
#[derive(Default)]
pub(super) struct HeldFrames {
    frames: VecDeque<Box<PreparedFrame>>,
    bytes: usize,
}

impl HeldFrames {
    /// Adds a frame.
    pub fn push(&mut self, frame: Box<PreparedFrame>) {
        self.bytes += frame.picture.rgba.len();
        self.frames.push_back(frame);
    }

    /// Returns the instant of the first frame, and by how much the last one is later, nanoseconds.
    pub fn span(&self) -> Option<(MonotonicTime, i64)> {
        let at = |frame: &PreparedFrame| frame.frame.captured_at;
        let (first, last) = (at(self.frames.front()?), at(self.frames.back()?));
        Some((first, last.nanos_since(first)))
    }

    /// Returns when the picture of the first frame arrived.
    pub fn first_arrival(&self) -> Option<MonotonicTime> {
        Some(self.frames.front()?.frame.scene.arrived_at)
    }

    /// Whether the frames take too much memory.
    pub const fn is_full(&self) -> bool {
        self.bytes > MAX_BYTES
    }

    /// Returns the first frame.
    pub fn pop(&mut self) -> Option<Box<PreparedFrame>> {
        let frame = self.frames.pop_front()?;
        self.bytes -= frame.picture.rgba.len();
        Some(frame)
    }
}
