//! Camera frames, not decoded.

use crate::time::MonotonicTime;
use bytes::Bytes;
use std::sync::Arc;

/// Encoding of the bytes of a frame.
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
    /// R, G, B, 3 bytes a pixel.
    Rgb8,
    /// One grey byte a pixel.
    Grey8,
    /// One byte a pixel: the raw mosaic of the sensor.
    Bayer8(BayerPattern),
}

/// Colours of the four pixels that a Bayer mosaic repeats, by rows from the top left.
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
    /// All patterns.
    pub const ALL: [Self; 4] = [Self::Rggb, Self::Bggr, Self::Grbg, Self::Gbrg];

    /// Column and row (0 or 1) of red in the repeated square; blue is diagonally opposite.
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

/// Exposure of a frame, as the camera reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Shutter time, microseconds.
    pub exposure_micros: f64,
    /// Analogue and digital gain, linear (1 = none).
    pub gain: f64,
}

/// The control values during the exposure of a frame, by name; see [`Frame::controls`].
pub type ControlsInForce = Arc<[(Arc<str>, i64)]>;

/// One frame, not decoded. Cheap to clone: the bytes are shared.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The bytes of the frame, without unused bytes of the device's buffer.
    pub data: Bytes,
    /// Encoding of `data`.
    pub format: PixelFormat,
    /// Width in pixels; 0 for JPEG and PNG, which contain it.
    pub width: u32,
    /// Height in pixels; 0 for JPEG and PNG, which contain it.
    pub height: u32,
    /// Bytes from one row to the next; 0 if rows are contiguous, or for JPEG and PNG.
    pub stride: u32,
    /// The device's counter; if it skips n numbers, n frames were lost.
    pub sequence: u64,
    /// Middle of the exposure.
    pub captured_at: MonotonicTime,
    /// When the driver received the bytes.
    pub arrived_at: MonotonicTime,
    /// The exposure, if the camera reports it.
    pub exposure: Option<Exposure>,
    /// For bracketed exposures, stops relative to the base exposure: 0 is the base, −4 is
    /// sixteen times darker.
    pub bracket_ev: f64,
    /// The control values during its exposure, in the device's units; `None` if the device
    /// does not report them. Shared between frames until one changes.
    pub controls: Option<ControlsInForce>,
}
