//! The four letters by which V4L2 names formats.

use penumbra_interface::{BayerPattern, PixelFormat};

/// Formats that Penumbra reads, the better for measuring light first: uncompressed before
/// JPEG, which quantises colour; grey last. Bayer's letters: the kernel's `videodev2.h`.
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

/// How Penumbra reads a format; `None` if it does not.
pub(crate) fn pixel_format(fourcc: [u8; 4]) -> Option<PixelFormat> {
    let known = KNOWN.iter().find(|(letters, _)| *letters == fourcc)?;
    Some(known.1)
}

/// The letters as text; unprintable ones as dots.
pub(crate) fn text(fourcc: [u8; 4]) -> String {
    let shown = |b: u8| if b.is_ascii_graphic() { b as char } else { '.' };
    // Formats of two or three letters are padded with spaces.
    let padded: String = fourcc
        .map(|b| if b == b' ' { ' ' } else { shown(b) })
        .iter()
        .collect();
    padded.trim_end().to_owned()
}

/// The letters of a text of at most four.
pub(crate) fn letters(text: &str) -> Option<[u8; 4]> {
    let mut letters = [b' '; 4];
    letters
        .get_mut(..text.len())?
        .copy_from_slice(text.as_bytes());
    Some(letters)
}

/// Bytes of a row of a raw format without padding, and rows of bytes per picture (chroma
/// planes count); `None` for coded ones.
pub(crate) fn tight(format: PixelFormat, width: u32, height: u32) -> Option<(u32, u32)> {
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
    fn letters_and_text_are_inverse() {
        for (fourcc, format) in KNOWN {
            assert_eq!(letters(&text(fourcc)), Some(fourcc));
            assert!(pixel_format(fourcc).is_some_and(|f| f == format));
        }
        assert_eq!(letters("Y16"), Some(*b"Y16 "));
        assert_eq!(letters("TOO LONG"), None);
        assert_eq!(text([0, b'A', 7, b'B']), ".A.B");
    }
}
