//! The four-character codes by which V4L2 names pixel formats.

use penumbra_interface::{BayerPattern, PixelFormat};

/// The formats that Penumbra reads, best for measuring light first: uncompressed before JPEG,
/// which quantises colour; grey last. The codes of Bayer formats are those of `videodev2.h`.
pub(crate) const KNOWN: [([u8; 4], PixelFormat); 11] = [
    (*b"YUYV", PixelFormat::Yuyv),
    (*b"NV12", PixelFormat::Nv12),
    (*b"RGB3", PixelFormat::Rgb8),
    (*b"RGGB", PixelFormat::Bayer8(BayerPattern::Rggb)),
    (*b"BA81", PixelFormat::Bayer8(BayerPattern::Bggr)),
    (*b"GRBG", PixelFormat::Bayer8(BayerPattern::Grbg)),
    (*b"GBRG", PixelFormat::Bayer8(BayerPattern::Gbrg)),
    (*b"MJPG", PixelFormat::Jpeg),
    (*b"JPEG", PixelFormat::Jpeg),
    (*b"GREY", PixelFormat::Grey8),
    (*b"Y800", PixelFormat::Grey8),
];

/// The pixel format of a code; `None` if Penumbra cannot read it.
pub(crate) fn pixel_format(fourcc: [u8; 4]) -> Option<PixelFormat> {
    let known = KNOWN.iter().find(|(code, _)| *code == fourcc)?;
    Some(known.1)
}

/// A code as text, with dots for unprintable bytes. Short codes are padded with spaces, which
/// are left out.
pub(crate) fn to_text(fourcc: [u8; 4]) -> String {
    let printable = |byte: u8| match byte {
        b' ' => ' ',
        byte if byte.is_ascii_graphic() => char::from(byte),
        _ => '.',
    };
    let padded: String = fourcc.map(printable).iter().collect();
    padded.trim_end().to_owned()
}

/// The code of a text of at most four bytes.
pub(crate) fn from_text(text: &str) -> Option<[u8; 4]> {
    let mut fourcc = [b' '; 4];
    let start = fourcc.get_mut(..text.len())?;
    start.copy_from_slice(text.as_bytes());
    Some(fourcc)
}

/// Bytes of one row without padding and number of rows (those of chroma planes included) of a
/// picture; `None` for compressed formats.
pub(crate) fn packed_rows(format: PixelFormat, width: u32, height: u32) -> Option<(u32, u32)> {
    match format {
        PixelFormat::Jpeg | PixelFormat::Png => None,
        PixelFormat::Yuyv => Some((width.saturating_mul(2), height)),
        PixelFormat::Rgb8 => Some((width.saturating_mul(3), height)),
        PixelFormat::Nv12 => Some((width, height.saturating_add(height / 2))),
        PixelFormat::Grey8 | PixelFormat::Bayer8(_) => Some((width, height)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn to_text_and_from_text_are_inverse() {
        for (fourcc, format) in KNOWN {
            assert_eq!(from_text(&to_text(fourcc)), Some(fourcc));
            assert!(pixel_format(fourcc).is_some_and(|f| f == format));
        }
        assert_eq!(from_text("Y16"), Some(*b"Y16 "));
        assert_eq!(from_text("TOO LONG"), None);
        assert_eq!(to_text([0, b'A', 7, b'B']), ".A.B");
    }
}
