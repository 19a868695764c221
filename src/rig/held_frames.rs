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

    /// Returns the first frame if `is_settled` is true of its instant, or if the frames take too
    /// much memory.
    pub fn pop(
        &mut self,
        is_settled: impl FnOnce(MonotonicTime) -> bool,
    ) -> Option<Box<PreparedFrame>> {
        let first = self.frames.front()?;
        if self.bytes <= MAX_BYTES && !is_settled(first.frame.captured_at) {
            return None;
        }
        let frame = self.frames.pop_front()?;
        self.bytes -= frame.picture.rgba.len();
        Some(frame)
    }
}
