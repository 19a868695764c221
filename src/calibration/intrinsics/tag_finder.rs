//! Finds a board of tags in pictures: a completely or partly visible AprilGrid or ChArUco board.

use super::board::{Board, Correspondence};
use super::detect::{Grey, SMOOTHING, refine_corner};
use super::layout::{Fit, Layout, fit};
use super::tags::{SeenTag, correspondences, neighbours_foretold};
use glam::DVec2;
use penumbra_camera::Response;
use penumbra_fiducials::{Detector, Family, TagObservation, read_predicted};
use std::collections::BTreeMap;

/// Outlines looked at in a picture: the largest boards have that many tags, and there is time.
const MOST_CANDIDATES: usize = 20_000;
/// Pictures without the board's tags in which other families are looked for.
const MOST_SEARCHED: usize = 40;
/// Tags of another family that are no chance.
const LEAST_STRANGERS: usize = 3;
/// Rounds in which tags that were missed are looked for beside those that were found.
const ROUNDS: usize = 6;

/// The observation of a board in a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TagSighting {
    /// Points found.
    pub points: Vec<Correspondence>,
    /// The board's tags in it.
    pub tags: usize,
    /// Tags of the board's family that the board does not have.
    pub beside: usize,
    /// The tags lie as on another board.
    pub contradicts: bool,
    /// In so many columns, as far as that can be told.
    pub other_columns: Option<u32>,
    /// Tags of another family instead.
    pub other_family: Option<Family>,
}

/// Finds one board; reuses its buffers.
#[derive(Clone, Debug)]
pub struct TagFinder {
    board: Board,
    family: Family,
    layout: Layout,
    /// How often a picture told which way of drawing it the board has.
    ways: BTreeMap<bool, usize>,
    response: Response,
    detector: Detector,
    /// Of all other families, made when it is needed.
    strangers: Option<Detector>,
    searched: usize,
    codes: Vec<u8>,
}

impl TagFinder {
    /// Of a board of tags; `None` for a chessboard.
    #[must_use]
    pub fn new(board: &Board) -> Option<Self> {
        let (family, layout) = (board.family()?, Layout::of(board)?);
        let response = Response::srgb();
        let detector = Detector::new(&[family], &response).with_max_candidates(MOST_CANDIDATES);
        Some(Self {
            board: *board,
            family,
            layout,
            ways: BTreeMap::new(),
            detector: if matches!(board, Board::AprilGrid { .. }) {
                detector.with_touching_corners()
            } else {
                detector
            },
            response,
            strangers: None,
            searched: 0,
            codes: Vec::new(),
        })
    }

    /// Finds the board's points in a picture.
    pub fn find(&mut self, picture: &Grey) -> TagSighting {
        let size = (picture.width, picture.height);
        self.codes.clear();
        let code = |v: &f32| v.round().clamp(0.0, 255.0) as u8;
        self.codes.extend(picture.data.iter().map(code));
        let seen = self.detector.detect_grey(&self.codes, size.0, size.1, None);
        let tags: Vec<SeenTag> = seen.iter().map(|tag| seen_tag(&self.board, tag)).collect();
        if tags.is_empty() {
            return TagSighting {
                other_family: self.search(size),
                ..TagSighting::default()
            };
        }
        let beside = tags.iter().filter(|t| t.id >= self.board.tag_count());
        let beside = beside.count();
        let fit = fit(&self.board, &tags, self.layout);
        if fit.contradicts {
            return TagSighting {
                beside,
                contradicts: true,
                other_columns: fit.other_columns,
                ..TagSighting::default()
            };
        }
        self.learn(&fit);
        let smooth = picture.blurred(SMOOTHING);
        let refine = |foretold, window| refine_corner(&smooth, foretold, window);
        let tags = self.completed(fit.tags, fit.layout, size, &refine);
        TagSighting {
            points: correspondences(&self.board, fit.layout, &tags, refine),
            tags: tags.len(),
            beside,
            ..TagSighting::default()
        }
    }

    /// What most pictures say holds where one does not tell.
    fn learn(&mut self, fit: &Fit) {
        if fit.pairs > 0 {
            *self.ways.entry(fit.layout.white_first).or_default() += 1;
        }
        let usual = self.ways.iter().max_by_key(|(_, n)| **n);
        if let Some((&white_first, _)) = usual {
            self.layout.white_first = white_first;
        }
    }

    /// With the tags that were missed, where those beside them foretell them: at a slant or at
    /// the rim of a fisheye's picture sides are too short or too bent for outlines.
    fn completed(
        &self,
        mut tags: Vec<SeenTag>,
        layout: Layout,
        size: (usize, usize),
        refine: &impl Fn(DVec2, f64) -> Option<DVec2>,
    ) -> Vec<SeenTag> {
        for _ in 0..ROUNDS {
            let known = tags.len();
            let foretold = neighbours_foretold(&self.board, layout, &tags, refine);
            tags.extend(foretold.into_iter().filter_map(|tag| {
                let picture = (self.codes.as_slice(), size);
                let which = (self.family, tag.id);
                let corners = as_printed(&self.board, tag.corners);
                let found = read_predicted(picture, &self.response, corners, which)?;
                Some(seen_tag(&self.board, &found))
            }));
            if tags.len() == known {
                break;
            }
        }
        tags
    }

    /// Another family of which there are several tags.
    fn search(&mut self, (width, height): (usize, usize)) -> Option<Family> {
        if self.searched >= MOST_SEARCHED {
            return None;
        }
        self.searched += 1;
        let others = Family::ALL.into_iter().filter(|f| *f != self.family);
        let others: Vec<Family> = others.collect();
        let detector = self.strangers.get_or_insert_with(|| {
            Detector::new(&others, &self.response).with_max_candidates(MOST_CANDIDATES)
        });
        let seen = detector.detect_grey(&self.codes, width, height, None);
        let count = |family: Family| seen.iter().filter(|t| t.family == family).count();
        let most = others.into_iter().max_by_key(|f| count(*f))?;
        (count(most) >= LEAST_STRANGERS).then_some(most)
    }
}

/// A tag's corners from the board's top left on, if they were from the tag's own, and back.
fn as_printed(board: &Board, corners: [DVec2; 4]) -> [DVec2; 4] {
    let [a, b, c, d] = corners;
    if board.has_turned_tags() {
        [c, d, a, b]
    } else {
        corners
    }
}

fn seen_tag(board: &Board, seen: &TagObservation) -> SeenTag {
    SeenTag {
        id: seen.id,
        corners: as_printed(board, seen.corners),
    }
}

#[cfg(test)]
mod tests;
