//! The pictures that a step observes, reduced in size for a browser.

use bytes::Bytes;
use penumbra_picture::Picture;
use penumbra_status::stream::JpegEncoder;
use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

/// Maximum width and height of a preview, pixels.
const MAX_SIZE: (u32, u32) = (1280, 960);
/// Number of previews that are kept: a client that learns of a revision requests it a moment later.
const KEPT_PREVIEWS: usize = 4;
/// JPEG quality, per cent.
const JPEG_QUALITY: u8 = 80;

/// The newest previews.
#[derive(Default)]
pub(super) struct Previews {
    newest: VecDeque<Arc<Preview>>,
    revision: u64,
}

/// A preview; encoded at the first request.
pub(super) struct Preview {
    revision: u64,
    picture: Picture,
    jpeg: OnceLock<Option<Bytes>>,
}

impl Previews {
    /// Adds a preview and returns its revision, which is unique.
    pub fn push(&mut self, picture: Picture) -> u64 {
        self.revision += 1;
        while self.newest.len() >= KEPT_PREVIEWS {
            self.newest.pop_front();
        }
        self.newest.push_back(Arc::new(Preview {
            revision: self.revision,
            picture,
            jpeg: OnceLock::new(),
        }));
        self.revision
    }

    /// Returns the preview of a revision, or the newest if that one is not kept or `None` was
    /// given.
    pub fn get(&self, revision: Option<u64>) -> Option<Arc<Preview>> {
        let requested = revision.and_then(|r| self.newest.iter().find(|p| p.revision == r));
        requested.or_else(|| self.newest.back()).cloned()
    }

    /// Removes all previews.
    pub fn clear(&mut self) {
        self.newest.clear();
    }
}

impl Preview {
    /// Returns the preview as a JPEG file; `None` if it cannot be encoded.
    pub fn jpeg(&self) -> Option<Bytes> {
        let encode = || {
            JpegEncoder::new(JPEG_QUALITY)
                .ok()?
                .encode(&self.picture)
                .ok()
        };
        self.jpeg.get_or_init(encode).clone()
    }
}

/// Returns the picture, reduced by an integer factor if it is larger than [`MAX_SIZE`].
pub(super) fn downscale(picture: &Picture) -> Picture {
    let factor_of = |size: u32, max: u32| size.div_ceil(max).max(1);
    let factor = factor_of(picture.width, MAX_SIZE.0).max(factor_of(picture.height, MAX_SIZE.1));
    if factor == 1 {
        return picture.clone();
    }
    let (width, height) = (picture.width / factor, picture.height / factor);
    let mut small = Picture {
        width,
        height,
        rgba: Vec::with_capacity(4 * (width * height) as usize),
    };
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0_u32; 3];
            for j in 0..factor {
                for i in 0..factor {
                    let rgb = picture.rgb(x * factor + i, y * factor + j);
                    sum = std::array::from_fn(|c| sum[c] + u32::from(rgb[c]));
                }
            }
            let [r, g, b] = sum.map(|s| (s / (factor * factor)) as u8);
            small.rgba.extend([r, g, b, 255]);
        }
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32) -> Picture {
        let pixels = 0..width * height;
        Picture {
            width,
            height,
            rgba: pixels
                .flat_map(|i| [(i % width) as u8, 9, 200, 255])
                .collect(),
        }
    }

    #[test]
    fn downscales_large_pictures_and_keeps_their_colours() {
        let small = downscale(&picture(2560, 20));
        assert_eq!((small.width, small.height), (1280, 10));
        assert_eq!(small.rgb(3, 4), [6, 9, 200]);
        assert_eq!(downscale(&picture(640, 480)), picture(640, 480));
    }

    #[test]
    fn returns_recent_revisions_and_otherwise_the_newest() {
        let mut previews = Previews::default();
        assert!(previews.get(None).is_none());
        for i in 1..=6 {
            assert_eq!(previews.push(picture(8, 8)), i);
        }
        let revision = |requested| previews.get(requested).unwrap().revision;
        assert_eq!(
            (revision(None), revision(Some(3)), revision(Some(1))),
            (6, 3, 6)
        );
        let jpeg = previews.get(None).unwrap().jpeg().unwrap();
        assert_eq!(jpeg[..2], [0xff, 0xd8]);
        previews.clear();
        assert!(previews.get(Some(6)).is_none());
        previews.push(Picture::default());
        assert!(previews.get(None).unwrap().jpeg().is_none());
    }
}
