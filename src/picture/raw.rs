//! Decodes uncompressed frames: YUYV, NV12, RGB8, Grey8, and the layout of Bayer frames.

use crate::bayer;
use crate::error::PictureError;
use crate::picture::Picture;
use penumbra_interface::{Frame, PixelFormat};
use serde::{Deserialize, Serialize};

/// Weights of R, G, B in luma.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum YuvMatrix {
    /// ITU-R BT.601: webcams and JFIF.
    #[default]
    Bt601,
    /// ITU-R BT.709: HD cameras and capture cards.
    Bt709,
}

/// Codes of black and white.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum YuvRange {
    /// Luma 16..=235, chroma 16..=240, as UVC cameras send.
    #[default]
    Limited,
    /// 0..=255.
    Full,
}

/// Encoding of R, G, B in YUYV and NV12.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct YuvEncoding {
    /// Weights of luma.
    pub matrix: YuvMatrix,
    /// Range of the codes.
    pub range: YuvRange,
}

/// Fraction bits of [`Converter`]: its error stays below 0.001 code.
const BITS: u32 = 20;

/// [`YuvEncoding`] as integers with [`BITS`] fraction bits, Y, U, V centred on zero.
struct Converter {
    luma_offset: i32,
    luma: i32,
    r_from_v: i32,
    g_from_u: i32,
    g_from_v: i32,
    b_from_u: i32,
}

impl Converter {
    // ┌ ITU-R BT.601 / BT.709, with Kg = 1 − Kr − Kb and y, cb, cr in 0..1, ±0.5:       ┐
    // │   r = y + 2(1−Kr)·cr                                                            │
    // │   g = y − 2·Kb(1−Kb)/Kg·cb − 2·Kr(1−Kr)/Kg·cr                                   │
    // │   b = y + 2(1−Kb)·cb                                                            │
    // └ limited range: y = (Y−16)/219, c = (C−128)/224; full: y = Y/255, c = (C−128)/255┘
    fn new(encoding: &YuvEncoding) -> Self {
        let (kr, kb) = match encoding.matrix {
            YuvMatrix::Bt601 => (0.299, 0.114),
            YuvMatrix::Bt709 => (0.2126, 0.0722),
        };
        let (luma_offset, luma, chroma) = match encoding.range {
            YuvRange::Limited => (16, 255.0 / 219.0, 255.0 / 224.0),
            YuvRange::Full => (0, 1.0, 1.0),
        };
        let kg = 1.0 - kr - kb;
        let fixed = |x: f64| (x * f64::from(1 << BITS)).round() as i32;
        Self {
            luma_offset,
            luma: fixed(luma),
            r_from_v: fixed(chroma * 2.0 * (1.0 - kr)),
            g_from_u: fixed(chroma * -2.0 * kb * (1.0 - kb) / kg),
            g_from_v: fixed(chroma * -2.0 * kr * (1.0 - kr) / kg),
            b_from_u: fixed(chroma * 2.0 * (1.0 - kb)),
        }
    }

    fn rgba(&self, y: u8, u: u8, v: u8) -> [u8; 4] {
        let y = (i32::from(y) - self.luma_offset) * self.luma + (1 << (BITS - 1));
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        let code = |x: i32| (x >> BITS).clamp(0, 255) as u8;
        [
            code(y + self.r_from_v * v),
            code(y + self.g_from_u * u + self.g_from_v * v),
            code(y + self.b_from_u * u),
            255,
        ]
    }
}

pub(super) fn decode(
    frame: &Frame,
    yuv: &YuvEncoding,
    picture: &mut Picture,
) -> Result<(), PictureError> {
    let layout = Layout::of(frame)?;
    picture.resize(frame.width, frame.height)?;
    layout.check_length(frame)?;
    if let PixelFormat::Bayer8(pattern) = frame.format {
        bayer::demosaic(&frame.data, layout.stride, pattern, picture);
        return Ok(());
    }
    let row_bytes = 4 * frame.width as usize;
    let converter = Converter::new(yuv);
    let (luma, chroma) = frame.data.split_at(layout.plane.min(frame.data.len()));
    for (y, out) in picture.rgba.chunks_exact_mut(row_bytes).enumerate() {
        let row = slice(luma, y * layout.stride, layout.row);
        match frame.format {
            PixelFormat::Yuyv => yuyv_row(&converter, row, out),
            PixelFormat::Nv12 => {
                let uv = slice(chroma, y / 2 * layout.stride, layout.row);
                nv12_row(&converter, row, uv, out);
            }
            PixelFormat::Rgb8 => rgb_row(row, out),
            _ => grey_row(row, out),
        }
    }
    Ok(())
}

/// Layout of the rows, bytes.
struct Layout {
    row: usize,
    stride: usize,
    /// Length of the first plane; unlimited if there is only one.
    plane: usize,
    needed: u64,
}

impl Layout {
    fn of(frame: &Frame) -> Result<Self, PictureError> {
        let (format, width, height) = (frame.format, frame.width, frame.height);
        if width == 0 || height == 0 {
            return Err(PictureError::NoSize {
                format,
                width,
                height,
            });
        }
        check_even(format, width, height)?;
        let row = u64::from(width)
            * match format {
                PixelFormat::Rgb8 => 3,
                PixelFormat::Yuyv => 2,
                _ => 1,
            };
        let stride = match frame.stride {
            0 => row,
            stride if u64::from(stride) < row => {
                return Err(PictureError::ShortStride {
                    format,
                    stride,
                    row,
                });
            }
            stride => u64::from(stride),
        };
        let rows = u64::from(height);
        let (rows, plane) = match format {
            PixelFormat::Nv12 => (rows + rows / 2, stride * rows),
            _ => (rows, u64::MAX),
        };
        Ok(Self {
            row: row as usize,
            stride: stride as usize,
            plane: usize::try_from(plane).unwrap_or(usize::MAX),
            // The last row's padding is often missing.
            needed: stride * (rows - 1) + row,
        })
    }

    fn check_length(&self, frame: &Frame) -> Result<(), PictureError> {
        if (frame.data.len() as u64) < self.needed {
            return Err(PictureError::TooShort {
                format: frame.format,
                width: frame.width,
                height: frame.height,
                got: frame.data.len(),
                needed: self.needed,
            });
        }
        Ok(())
    }
}

fn check_even(format: PixelFormat, width: u32, height: u32) -> Result<(), PictureError> {
    let side = match format {
        PixelFormat::Yuyv | PixelFormat::Nv12 if width % 2 == 1 => "width",
        PixelFormat::Nv12 if height % 2 == 1 => "height",
        _ => return Ok(()),
    };
    Err(PictureError::OddSize {
        format,
        width,
        height,
        side,
    })
}

/// Returns `length` bytes from `start`; empty if they are missing, which `check_length` excludes.
fn slice(data: &[u8], start: usize, length: usize) -> &[u8] {
    data.get(start..start.saturating_add(length))
        .unwrap_or_default()
}

fn yuyv_row(converter: &Converter, row: &[u8], out: &mut [u8]) {
    for (pair, four) in out.chunks_exact_mut(8).zip(row.chunks_exact(4)) {
        pair[..4].copy_from_slice(&converter.rgba(four[0], four[1], four[3]));
        pair[4..].copy_from_slice(&converter.rgba(four[2], four[1], four[3]));
    }
}

fn nv12_row(converter: &Converter, luma: &[u8], chroma: &[u8], out: &mut [u8]) {
    let pairs = luma.chunks_exact(2).zip(chroma.chunks_exact(2));
    for (pair, (y, uv)) in out.chunks_exact_mut(8).zip(pairs) {
        pair[..4].copy_from_slice(&converter.rgba(y[0], uv[0], uv[1]));
        pair[4..].copy_from_slice(&converter.rgba(y[1], uv[0], uv[1]));
    }
}

fn rgb_row(row: &[u8], out: &mut [u8]) {
    for (pixel, rgb) in out.chunks_exact_mut(4).zip(row.chunks_exact(3)) {
        pixel.copy_from_slice(&[rgb[0], rgb[1], rgb[2], 255]);
    }
}

fn grey_row(row: &[u8], out: &mut [u8]) {
    for (pixel, &grey) in out.chunks_exact_mut(4).zip(row) {
        pixel.copy_from_slice(&[grey, grey, grey, 255]);
    }
}
