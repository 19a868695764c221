//! Decodes JPEG and PNG.

use crate::error::PictureError;
use crate::picture::{MAX_PIXELS, Picture};
use penumbra_interface::PixelFormat;
use std::io::Cursor;

/// Maximum number of scans of a progressive JPEG; more would be a denial of service.
const MAX_SCANS: u32 = 200;
/// Maximum number of pixels for which a byte of a JPEG stands: each block of 8×8 samples takes at
/// least one bit, and by the most unusual subsampling a picture of two components has a sample for
/// every two pixels. Arithmetic coding, which no camera uses, could take less.
const MAX_PIXELS_PER_BYTE: u64 = 8 * 64 * 2;
/// Maximum number of bytes for which a byte of a PNG stands: deflate's limit.
const MAX_DEFLATION: u64 = 1032;

pub(super) fn decode_jpeg(data: &[u8], picture: &mut Picture) -> Result<(), PictureError> {
    // A new decoder each time: it is cheap, and a reused one would decode a JPEG without tables with
    // those of the previous picture.
    let mut decoder = turbojpeg::Decompressor::new().map_err(damaged_jpeg)?;
    decoder.set_scan_limit(MAX_SCANS).map_err(damaged_jpeg)?;
    let header = decoder.read_header(data).map_err(damaged_jpeg)?;
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let (width, height) = (side(header.width), side(header.height));
    let needed = (u64::from(width) * u64::from(height)).div_ceil(MAX_PIXELS_PER_BYTE);
    check_length(PixelFormat::Jpeg, (width, height), data, needed)?;
    picture.resize(width, height)?;
    let target = turbojpeg::Image {
        pixels: picture.rgba.as_mut_slice(),
        width: header.width,
        pitch: 4 * header.width,
        height: header.height,
        format: turbojpeg::PixelFormat::RGBA,
    };
    match decoder.decompress(data, target) {
        Err(error) if !is_harmless(&error) => Err(damaged_jpeg(error)),
        _ => Ok(()),
    }
}

/// Width and height by a JPEG's header.
pub(super) fn jpeg_size(data: &[u8]) -> Result<(u32, u32), PictureError> {
    let mut decoder = turbojpeg::Decompressor::new().map_err(damaged_jpeg)?;
    let header = decoder.read_header(data).map_err(damaged_jpeg)?;
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    Ok((side(header.width), side(header.height)))
}

/// Width and height by a PNG's header.
pub(super) fn png_size(data: &[u8]) -> Result<(u32, u32), PictureError> {
    let mut decoder = png::Decoder::new(Cursor::new(data));
    let info = decoder
        .read_header_info()
        .map_err(|error| damaged(PixelFormat::Png, &error.to_string()))?;
    Ok((info.width, info.height))
}

/// Some webcams (e.g. Logitech C270) pad their MJPEG before a marker. libjpeg-turbo warns of it after
/// decoding the complete picture; with this error refused, such a camera would have no frames.
fn is_harmless(error: &turbojpeg::Error) -> bool {
    error.to_string().contains("extraneous bytes before marker")
}

fn damaged_jpeg(error: turbojpeg::Error) -> PictureError {
    damaged(PixelFormat::Jpeg, &error.to_string())
}

pub(super) fn decode_png(data: &[u8], picture: &mut Picture) -> Result<(), PictureError> {
    let refuse = |error: png::DecodingError| damaged(PixelFormat::Png, &error.to_string());
    let mut decoder = png::Decoder::new(Cursor::new(data));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let info = decoder.read_header_info().map_err(refuse)?;
    let row = u64::from(info.width) * info.bits_per_pixel() as u64;
    let needed = row.div_ceil(8).saturating_mul(u64::from(info.height)) / MAX_DEFLATION;
    check_length(PixelFormat::Png, (info.width, info.height), data, needed)?;
    picture.resize(info.width, info.height)?;
    let mut reader = decoder.read_info().map_err(refuse)?;
    let size = reader
        .output_buffer_size()
        .ok_or_else(|| damaged(PixelFormat::Png, "its rows are too long"))?;
    let mut samples = vec![0; size];
    let info = reader.next_frame(&mut samples).map_err(refuse)?;
    to_rgba(info.color_type, &samples, &mut picture.rgba)
}

/// Refuses a header that states more pixels than the file can hold: a damaged file of a few bytes must
/// not take the memory and the time of a large picture.
fn check_length(
    format: PixelFormat,
    (width, height): (u32, u32),
    data: &[u8],
    needed: u64,
) -> Result<(), PictureError> {
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(PictureError::TooLarge { width, height });
    }
    if needed <= data.len() as u64 {
        return Ok(());
    }
    let bytes = data.len();
    let reason =
        format!("its header states {width}×{height} pixels, which {bytes} bytes cannot hold");
    Err(damaged(format, &reason))
}

/// Converts the PNG's samples to RGBA without its alpha, because a camera has none.
fn to_rgba(colour: png::ColorType, samples: &[u8], rgba: &mut [u8]) -> Result<(), PictureError> {
    let channels = colour.samples();
    for (out, pixel) in rgba.chunks_exact_mut(4).zip(samples.chunks_exact(channels)) {
        let rgb = match *pixel {
            [grey] | [grey, _] => [grey; 3],
            [r, g, b] | [r, g, b, _] => [r, g, b],
            _ => return Err(damaged(PixelFormat::Png, "unknown colour type")),
        };
        out.copy_from_slice(&[rgb[0], rgb[1], rgb[2], 255]);
    }
    Ok(())
}

/// Error of a damaged picture, with the decoder's message in one line.
fn damaged(format: PixelFormat, reason: &str) -> PictureError {
    let reason = reason.split_whitespace().collect::<Vec<_>>().join(" ");
    PictureError::Damaged { format, reason }
}
