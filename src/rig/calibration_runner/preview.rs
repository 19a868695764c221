//! The pictures that a step is shown, small enough for a browser.

use bytes::Bytes;
use penumbra_picture::Picture;
use penumbra_status::stream::JpegEncoder;
use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

/// Largest width and height of a preview, pixels.
const LARGEST: (u32, u32) = (1280, 960);
/// Previews that can be had: who was told of one asks for it a moment later.
const KEPT: usize = 4;
/// JPEG quality.
const QUALITY: u8 = 80;

/// The newest previews.
#[derive(Default)]
pub(super) struct Previews {
    newest: VecDeque<Arc<Preview>>,
    revision: u64,
}

/// One of them; encoded when it is first asked for.
pub(super) struct Preview {
    revision: u64,
    picture: Picture,
    jpeg: OnceLock<Option<Bytes>>,
}

impl Previews {
    /// One more; answers its revision, which never comes twice.
    pub fn push(&mut self, picture: Picture) -> u64 {
        self.revision += 1;
        while self.newest.len() >= KEPT {
            self.newest.pop_front();
        }
        self.newest.push_back(Arc::new(Preview {
            revision: self.revision,
            picture,
            jpeg: OnceLock::new(),
        }));
        self.revision
    }

    /// That of a revision, or the newest.
    pub fn get(&self, revision: Option<u64>) -> Option<Arc<Preview>> {
        let wanted = revision.and_then(|r| self.newest.iter().find(|p| p.revision == r));
        wanted.or_else(|| self.newest.back()).cloned()
    }

    /// None any more.
    pub fn clear(&mut self) {
        self.newest.clear();
    }
}

impl Preview {
    /// As a JPEG file; none if it cannot be one.
    pub fn jpeg(&self) -> Option<Bytes> {
        let encode = || JpegEncoder::new(QUALITY).ok()?.encode(&self.picture).ok();
        self.jpeg.get_or_init(encode).clone()
    }
}

/// The picture, made smaller by a whole number where it is larger than a preview.
pub(super) fn preview_of(picture: &Picture) -> Picture {
    let times = |size: u32, most: u32| size.div_ceil(most).max(1);
    let factor = times(picture.width, LARGEST.0).max(times(picture.height, LARGEST.1));
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
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
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
    fn large_pictures_become_small_ones_and_keep_their_colours() {
        let small = preview_of(&picture(2560, 20));
        assert_eq!((small.width, small.height), (1280, 10));
        assert_eq!(small.rgb(3, 4), [6, 9, 200]);
        assert_eq!(preview_of(&picture(640, 480)), picture(640, 480));
    }

    #[test]
    fn a_revision_can_be_had_for_a_while_and_then_the_newest() {
        let mut previews = Previews::default();
        assert!(previews.get(None).is_none());
        for i in 1..=6 {
            assert_eq!(previews.push(picture(8, 8)), i);
        }
        let revision = |asked| previews.get(asked).unwrap().revision;
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
