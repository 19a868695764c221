//! Tags in a picture.

use super::contour::Walker;
use super::edge::{Grey, Lens, refine};
use super::homography::from_square;
use super::quad::{is_convex, quad};
use super::threshold::Black;
use super::{Family, decode};
use glam::DVec2;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_picture::Picture;

/// Below this share of 256 of the way from dark to bright a pixel is black. Half of it puts
/// outlines where edges are.
const HALF: u8 = 128;
/// For tags whose corners touch black squares: half of the way would join them as soon as
/// the picture is the least blurred.
const APART: u8 = 77;
/// Outlines that are looked at closely, the largest first: a picture full of texture must not
/// hold up the frame that it belongs to.
const MOST_CANDIDATES: usize = 400;
/// Bits that may be wrong where it is known which tag there must be: chance would get half of
/// at least 16 wrong.
const FORETOLD_WRONG: u32 = 3;
/// Less clear ones are taken for chance. See [`TagSeen::margin`].
const LEAST_MARGIN: f32 = 0.25;

/// A tag in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagSeen {
    /// Its family.
    pub family: Family,
    /// Its number there.
    pub id: u32,
    /// Corners of the black border, clockwise as the tag is read, from the top left; pixels.
    pub corners: [DVec2; 4],
    /// How clearly its modules are black or white: 1 as clearly as the borders, 0 not at all.
    pub margin: f32,
    /// Bits that were read wrong and put right.
    pub wrong_bits: u32,
}

impl TagSeen {
    /// Pixels squared within the border.
    #[must_use]
    pub fn area(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        0.5 * (c - a).perp_dot(d - b).abs()
    }
}

/// Finds tags. Keeps its buffers from picture to picture.
#[derive(Clone, Debug)]
pub struct Detector {
    families: Vec<Family>,
    linear: Box<[f32; 256]>,
    grey: Vec<u8>,
    black: Black,
    walker: Walker,
    outline: Vec<DVec2>,
    quads: Vec<[DVec2; 4]>,
    seen: Vec<TagSeen>,
    most: usize,
    touching: bool,
}

impl Detector {
    /// Finds tags of these families in pictures of a camera with this response.
    #[must_use]
    pub fn new(families: &[Family], response: &Response) -> Self {
        Self {
            families: families.to_vec(),
            linear: Box::new(*response.linear_from_code()),
            grey: Vec::new(),
            black: Black::default(),
            walker: Walker::default(),
            outline: Vec::new(),
            quads: Vec::new(),
            seen: Vec::new(),
            most: MOST_CANDIDATES,
            touching: false,
        }
    }

    /// Looks at no more than the `most` largest outlines of a picture, where more tags than
    /// usual are expected.
    #[must_use]
    pub const fn with_most_candidates(mut self, most: usize) -> Self {
        self.most = most;
        self
    }

    /// Tags whose corners touch black squares, as an AprilGrid's do. Kalibr's are always taken
    /// for such.
    #[must_use]
    pub const fn with_touching_corners(mut self) -> Self {
        self.touching = true;
        self
    }

    /// The tags in a picture, each once, by family and number. `camera`, where known, tells how
    /// the lens bends their sides.
    pub fn detect(&mut self, picture: &Picture, camera: Option<&PinholeCamera>) -> &[TagSeen] {
        let mut grey = std::mem::take(&mut self.grey);
        grey_of(picture, &mut grey);
        self.detect_grey(
            &grey,
            picture.width as usize,
            picture.height as usize,
            camera,
        );
        self.grey = grey;
        &self.seen
    }

    /// The same in a grey picture, `width` pixels in a row. Nothing is found where the size is
    /// not the picture's, or past 65,000 pixels a side.
    pub fn detect_grey(
        &mut self,
        codes: &[u8],
        width: usize,
        height: usize,
        camera: Option<&PinholeCamera>,
    ) -> &[TagSeen] {
        self.seen.clear();
        if width.max(height) > 65_000 || codes.len() != width * height {
            return &self.seen;
        }
        let grey = Grey {
            width,
            height,
            codes,
            linear: &self.linear,
        };
        for share in [HALF, APART] {
            let touching = self.touching;
            let looked_for = |f: &&Family| (share == APART) == (touching || f.border() > 1);
            if !self.families.iter().any(|f| looked_for(&f)) {
                continue;
            }
            self.black.decide(codes, (width, height), share);
            let quads = &mut self.quads;
            quads.clear();
            self.walker.walk(&self.black, &mut self.outline, |outline| {
                quads.extend(quad(outline))
            });
            keep_largest(quads, self.most);
            for corners in quads.iter() {
                let mut families = self.families.iter().filter(looked_for);
                let tag = families.find_map(|f| look(&grey, Lens(camera), corners, *f));
                self.seen.extend(tag);
            }
        }
        keep_best(&mut self.seen);
        &self.seen
    }
}

/// Whether the tag of that number is at `corners`, which other tags foretold; then as it is
/// read there. `codes` are a picture of that width and height in the encoding of `response`.
#[must_use]
pub fn confirm(
    (codes, (width, height)): (&[u8], (usize, usize)),
    response: &Response,
    corners: [DVec2; 4],
    (family, id): (Family, u32),
) -> Option<TagSeen> {
    let grey = Grey {
        width,
        height,
        codes,
        linear: response.linear_from_code(),
    };
    if codes.len() != width * height || !is_convex(&corners) {
        return None;
    }
    let (word, margin) = decode::bits(&grey, &from_square(1.0, &corners)?, family)?;
    let wrong_bits = family.wrong_bits(word, id)?;
    (margin >= LEAST_MARGIN && wrong_bits <= FORETOLD_WRONG).then_some(TagSeen {
        family,
        id,
        corners,
        margin,
        wrong_bits,
    })
}

fn keep_largest(quads: &mut Vec<[DVec2; 4]>, most: usize) {
    let area = |[a, b, c, d]: &[DVec2; 4]| (*c - *a).perp_dot(*d - *b).abs();
    if quads.len() > most && most > 0 {
        quads.select_nth_unstable_by(most - 1, |a, b| area(b).total_cmp(&area(a)));
        quads.truncate(most);
    }
}

fn look(grey: &Grey, lens: Lens, corners: &[DVec2; 4], family: Family) -> Option<TagSeen> {
    // Sides too small or too near to something else to be found again stay as they are.
    let refined = refine(grey, lens, corners, family.modules()).filter(is_convex);
    let read = |corners: [DVec2; 4]| {
        let (word, margin) = decode::read(grey, &from_square(1.0, &corners)?, family)?;
        (margin >= LEAST_MARGIN).then_some((corners, word, margin))
    };
    let (found, word, margin) = refined.and_then(read).or_else(|| read(*corners))?;
    Some(TagSeen {
        family,
        id: word.id,
        corners: std::array::from_fn(|i| found[(i + word.turns) % 4]),
        margin,
        wrong_bits: word.wrong,
    })
}

/// Of tags that are the same one at the same place the clearest; of the same number at two places
/// both stay: who knows that a tag is there once only may judge.
fn keep_best(seen: &mut Vec<TagSeen>) {
    seen.sort_unstable_by(|a, b| {
        (a.family, a.id)
            .cmp(&(b.family, b.id))
            .then(b.margin.total_cmp(&a.margin))
    });
    let middle = |t: &TagSeen| t.corners.iter().sum::<DVec2>() / 4.0;
    seen.dedup_by(|b, a| {
        let near = middle(a).distance(middle(b)) < 0.5 * a.area().sqrt();
        (a.family, a.id) == (b.family, b.id) && near
    });
}

/// Luma of a picture: the green counts most, and all three keep noise down.
pub fn grey_of(picture: &Picture, grey: &mut Vec<u8>) {
    grey.clear();
    grey.extend(picture.rgba.chunks_exact(4).map(|p| {
        let sum = 77 * u32::from(p[0]) + 150 * u32::from(p[1]) + 29 * u32::from(p[2]);
        (sum >> 8) as u8
    }));
}

#[cfg(test)]
mod tests;
