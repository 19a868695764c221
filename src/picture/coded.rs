//! JPEG and PNG.

use super::{Picture, PictureError};
use penumbra_interface::PixelFormat;
use std::io::Cursor;

/// A progressive JPEG of more scans than this is an attack on time, not a picture.
const MAX_SCANS: u32 = 200;

pub(super) fn decode_jpeg(data: &[u8], picture: &mut Picture) -> Result<(), PictureError> {
    // A new one each time: it costs 0.1 µs, and a kept one would decode a JPEG that lacks its
    // tables with those of the picture before.
    let mut decoder = turbojpeg::Decompressor::new().map_err(damaged_jpeg)?;
    decoder.set_scan_limit(MAX_SCANS).map_err(damaged_jpeg)?;
    let header = decoder.read_header(data).map_err(damaged_jpeg)?;
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    picture.resize(side(header.width), side(header.height))?;
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

/// Some webcams (Logitech C270 and its family) pad their MJPEG before a marker.
/// libjpeg-turbo warns of it after having decoded the whole picture; refusing those
/// frames would leave such a camera without any.
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
    picture.resize(info.width, info.height)?;
    let mut reader = decoder.read_info().map_err(refuse)?;
    let size = reader
        .output_buffer_size()
        .ok_or_else(|| damaged(PixelFormat::Png, "its rows are too long"))?;
    let mut samples = vec![0; size];
    let info = reader.next_frame(&mut samples).map_err(refuse)?;
    spread(info.color_type, &samples, &mut picture.rgba)
}

/// Writes RGBA from what the PNG holds; its alpha is dropped, since a camera has none.
fn spread(colour: png::ColorType, samples: &[u8], rgba: &mut [u8]) -> Result<(), PictureError> {
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

/// One line, whatever the decoder wrote.
fn damaged(format: PixelFormat, reason: &str) -> PictureError {
    let reason = reason.split_whitespace().collect::<Vec<_>>().join(" ");
    PictureError::Damaged { format, reason }
}
