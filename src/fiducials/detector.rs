//! Detects tags in a picture.

use crate::contour::Walker;
use crate::decode;
use crate::edge::{Grey, Lens, refine};
use crate::family::Family;
use crate::homography::from_square;
use crate::quad::{is_convex, quad};
use crate::threshold::Black;
use glam::DVec2;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_picture::Picture;

/// Threshold of black pixels in 1/256 of the range from dark to bright. Half of the range puts
/// outlines on the edges.
const HALF: u8 = 128;
/// The threshold for tags whose corners touch black squares: with half of the range, the slightest
/// blur would join them.
const TOUCHING: u8 = 77;
/// Default maximum number of outlines that are decoded, the largest first: a picture full of
/// texture must not delay its frame.
const DEFAULT_MAX_CANDIDATES: usize = 400;
/// Maximum number of wrong bits where the tag is predicted: by chance, half of at least 16 bits
/// would be wrong.
const MAX_WRONG_BITS_PREDICTED: u32 = 3;
/// Minimum [`TagObservation::margin`]; tags below it are taken for chance.
const MIN_MARGIN: f32 = 0.25;

/// A detected tag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagObservation {
    /// Family.
    pub family: Family,
    /// Number in the family.
    pub id: u32,
    /// Corners of the black border, clockwise as the tag is read, from the top left; pixels.
    pub corners: [DVec2; 4],
    /// Contrast of its modules relative to that of its borders, 0 to 1.
    pub margin: f32,
    /// Number of corrected bits.
    pub wrong_bits: u32,
}

impl TagObservation {
    /// Area within the outside of the border, pixels squared.
    #[must_use]
    pub fn area(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        0.5 * (c - a).perp_dot(d - b).abs()
    }
}

/// Detects tags. Reuses its buffers from picture to picture.
#[derive(Clone, Debug)]
pub struct Detector {
    families: Vec<Family>,
    linear: Box<[f32; 256]>,
    grey: Vec<u8>,
    black: Black,
    walker: Walker,
    outline: Vec<DVec2>,
    quads: Vec<[DVec2; 4]>,
    seen: Vec<TagObservation>,
    max_candidates: usize,
    has_touching_corners: bool,
}

impl Detector {
    /// Creates a detector for tags of `families` in pictures of a camera with this tone curve.
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
            max_candidates: DEFAULT_MAX_CANDIDATES,
            has_touching_corners: false,
        }
    }

    /// Sets the maximum number of outlines that are decoded per picture, the largest first (400 by
    /// default).
    #[must_use]
    pub const fn with_max_candidates(mut self, max: usize) -> Self {
        self.max_candidates = max;
        self
    }

    /// Expects tags whose corners touch black squares, as on an AprilGrid. Always on for
    /// [`Family::Kalibr36h11`].
    #[must_use]
    pub const fn with_touching_corners(mut self) -> Self {
        self.has_touching_corners = true;
        self
    }

    /// Detects the tags in a picture, sorted by family and number. `camera` supplies the lens
    /// distortion, if known.
    pub fn detect(
        &mut self,
        picture: &Picture,
        camera: Option<&PinholeCamera>,
    ) -> &[TagObservation] {
        let mut grey = std::mem::take(&mut self.grey);
        luma(picture, &mut grey);
        self.detect_grey(
            &grey,
            picture.width as usize,
            picture.height as usize,
            camera,
        );
        self.grey = grey;
        &self.seen
    }

    /// As [`Self::detect`], in a grey picture of `width` × `height` codes, row by row. Finds nothing
    /// if the number of codes differs, or with more than 65,000 pixels along a side.
    pub fn detect_grey(
        &mut self,
        codes: &[u8],
        width: usize,
        height: usize,
        camera: Option<&PinholeCamera>,
    ) -> &[TagObservation] {
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
        for share in [HALF, TOUCHING] {
            let touching = self.has_touching_corners;
            let is_due = |f: &&Family| (share == TOUCHING) == (touching || f.border() > 1);
            if !self.families.iter().any(|f| is_due(&f)) {
                continue;
            }
            self.black.binarise(codes, (width, height), share);
            let quads = &mut self.quads;
            quads.clear();
            self.walker.walk(&self.black, &mut self.outline, |outline| {
                quads.extend(quad(outline))
            });
            keep_largest(quads, self.max_candidates);
            for corners in quads.iter() {
                let mut families = self.families.iter().filter(is_due);
                let tag = families.find_map(|f| read(&grey, Lens(camera), corners, *f));
                self.seen.extend(tag);
            }
        }
        keep_best(&mut self.seen);
        &self.seen
    }
}

/// Reads the tag of a known family and number at `corners` (pixels), which were predicted from other
/// tags; `None` if it is not found. `codes` are a grey picture of the given width and height,
/// encoded with `response`.
#[must_use]
pub fn read_predicted(
    (codes, (width, height)): (&[u8], (usize, usize)),
    response: &Response,
    corners: [DVec2; 4],
    (family, id): (Family, u32),
) -> Option<TagObservation> {
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
    (margin >= MIN_MARGIN && wrong_bits <= MAX_WRONG_BITS_PREDICTED).then_some(TagObservation {
        family,
        id,
        corners,
        margin,
        wrong_bits,
    })
}

fn keep_largest(quads: &mut Vec<[DVec2; 4]>, max: usize) {
    let area = |[a, b, c, d]: &[DVec2; 4]| (*c - *a).perp_dot(*d - *b).abs();
    if quads.len() > max && max > 0 {
        quads.select_nth_unstable_by(max - 1, |a, b| area(b).total_cmp(&area(a)));
        quads.truncate(max);
    }
}

/// Refines the corners of a quadrilateral and reads the tag in it, if there is one.
fn read(grey: &Grey, lens: Lens, corners: &[DVec2; 4], family: Family) -> Option<TagObservation> {
    // Corners that cannot be refined (sides too short or too close to other edges) are used as
    // they are.
    let refined = refine(grey, lens, corners, family.modules()).filter(is_convex);
    let read = |corners: [DVec2; 4]| {
        let (word, margin) = decode::read(grey, &from_square(1.0, &corners)?, family)?;
        (margin >= MIN_MARGIN).then_some((corners, word, margin))
    };
    let (found, word, margin) = refined.and_then(read).or_else(|| read(*corners))?;
    Some(TagObservation {
        family,
        id: word.id,
        corners: std::array::from_fn(|i| found[(i + word.turns) % 4]),
        margin,
        wrong_bits: word.wrong,
    })
}

/// Keeps the clearest of several detections of one tag at one position. Detections of one number at
/// different positions are kept: only the caller knows whether a tag exists more than once.
fn keep_best(seen: &mut Vec<TagObservation>) {
    seen.sort_unstable_by(|a, b| {
        (a.family, a.id)
            .cmp(&(b.family, b.id))
            .then(b.margin.total_cmp(&a.margin))
    });
    let middle = |t: &TagObservation| t.corners.iter().sum::<DVec2>() / 4.0;
    seen.dedup_by(|b, a| {
        let near = middle(a).distance(middle(b)) < 0.5 * a.area().sqrt();
        (a.family, a.id) == (b.family, b.id) && near
    });
}

/// Fills `grey` with the luma of a picture (weights 77, 150, 29 of 256 for R, G, B, as in BT.601).
fn luma(picture: &Picture, grey: &mut Vec<u8>) {
    grey.clear();
    grey.extend(picture.rgba.chunks_exact(4).map(|p| {
        let sum = 77 * u32::from(p[0]) + 150 * u32::from(p[1]) + 29 * u32::from(p[2]);
        (sum >> 8) as u8
    }));
}

#[cfg(test)]
mod tests;
