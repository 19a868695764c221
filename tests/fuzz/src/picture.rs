//! Pictures of cameras and files.

use bytes::Bytes;
use penumbra_interface::{BayerPattern, Frame, MonotonicTime, PixelFormat};
use penumbra_picture::{Picture, PictureError, YuvEncoding, decode_within};

/// Maximum of a camera's picture here: 1920×1080.
const MAX_PIXELS: u64 = 1920 * 1080;
const FORMATS: [PixelFormat; 10] = [
    PixelFormat::Jpeg,
    PixelFormat::Png,
    PixelFormat::Yuyv,
    PixelFormat::Nv12,
    PixelFormat::Rgb8,
    PixelFormat::Grey8,
    PixelFormat::Bayer8(BayerPattern::Rggb),
    PixelFormat::Bayer8(BayerPattern::Bggr),
    PixelFormat::Bayer8(BayerPattern::Grbg),
    PixelFormat::Bayer8(BayerPattern::Gbrg),
];

/// A camera's frame, or a picture file: the first byte chooses its format, the next three state its
/// size and stride.
pub fn picture(data: &[u8]) {
    let Some((&[choice, width, height, stride], content)) = data.split_first_chunk::<4>() else {
        return;
    };
    let Some(format) = FORMATS.get(usize::from(choice) % (FORMATS.len() + 1)) else {
        check(Picture::from_file_bytes(content));
        return;
    };
    let frame = Frame {
        data: Bytes::copy_from_slice(content),
        format: *format,
        width: width.into(),
        height: height.into(),
        stride: u32::from(stride) * 4,
        sequence: 0,
        captured_at: MonotonicTime::default(),
        arrived_at: MonotonicTime::default(),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    };
    let mut picture = Picture::default();
    let decoded = decode_within(MAX_PIXELS, &frame, &YuvEncoding::default(), &mut picture);
    check(decoded.map(|()| picture));
}

fn check(decoded: Result<Picture, PictureError>) {
    match decoded {
        Ok(picture) => {
            let pixels = u64::from(picture.width) * u64::from(picture.height);
            assert_eq!(picture.rgba.len() as u64, 4 * pixels);
        }
        Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
    }
}
