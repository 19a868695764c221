//! A camera's picture as its bytes arrived.

use crate::{ControlsInForce, MonotonicTime};
use bytes::Bytes;

/// How a frame's bytes spell a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// A JPEG file, one per frame (MJPEG).
    Jpeg,
    /// A PNG file, one per frame.
    Png,
    /// 4:2:2 packed, Y0 U Y1 V, 2 bytes a pixel.
    Yuyv,
    /// 4:2:0, a plane of Y, then interleaved U V at half size; 1.5 bytes a pixel.
    Nv12,
    /// R G B, 3 bytes a pixel.
    Rgb8,
    /// One grey byte a pixel.
    Grey8,
    /// One byte a pixel, of one colour: a sensor's raw mosaic.
    Bayer8(BayerPattern),
}

/// Colours of the four pixels that a mosaic repeats, by rows from the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BayerPattern {
    /// R G over G B.
    Rggb,
    /// B G over G R.
    Bggr,
    /// G R over B G.
    Grbg,
    /// G B over R G.
    Gbrg,
}

impl BayerPattern {
    /// All four.
    pub const ALL: [Self; 4] = [Self::Rggb, Self::Bggr, Self::Grbg, Self::Gbrg];

    /// Column and row, 0 or 1, of red in the repeated square; blue is diagonally opposite.
    #[must_use]
    pub const fn red(self) -> (u32, u32) {
        match self {
            Self::Rggb => (0, 0),
            Self::Grbg => (1, 0),
            Self::Gbrg => (0, 1),
            Self::Bggr => (1, 1),
        }
    }
}

/// What the camera says its sensor did for a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Shutter time, microseconds.
    pub exposure_micros: f64,
    /// Analogue and digital gain, linear (1 = none).
    pub gain: f64,
}

/// One picture, undecoded. Cheap to clone: the bytes are shared.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The picture's bytes, cut to what the device said it used.
    pub data: Bytes,
    /// How `data` spells the picture.
    pub format: PixelFormat,
    /// Width in pixels; 0 where the coded picture says it itself (JPEG, PNG).
    pub width: u32,
    /// Height in pixels; 0 where the coded picture says it itself.
    pub height: u32,
    /// Bytes from one row to the next; 0 = tightly packed or coded.
    pub stride: u32,
    /// The device's counter; a gap of n means n frames lost.
    pub sequence: u64,
    /// Middle of the exposure.
    pub captured_at: MonotonicTime,
    /// When the bytes reached us.
    pub arrived_at: MonotonicTime,
    /// What the camera reports of its exposure, if it does.
    pub exposure: Option<Exposure>,
    /// Bracketed exposure: stops relative to the camera's base exposure (0 = base,
    /// -4 = sixteen times darker).
    pub bracket_ev: f64,
    /// The controls in force while it was exposed, in the device's units; `None` where the
    /// device does not say. Shared between frames until one changes.
    pub controls: Option<ControlsInForce>,
}
