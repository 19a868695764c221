//! Finds a completely or partly visible AprilGrid or ChArUco board in pictures.

use super::board::{Board, Correspondence};
use super::detect::{Grey, SMOOTHING, refine_corner};
use super::layout::DetectedTag;
use super::layout::{Fit, Layout, fit};
use super::tags::{correspondences, predict_missing_tags};
use glam::DVec2;
use penumbra_camera::Response;
use penumbra_fiducials::{Detector, Family, TagObservation, read_predicted};
use std::collections::BTreeMap;

/// Maximum number of outlines examined in a picture; sufficient for the largest boards.
const MAX_CANDIDATES: usize = 20_000;
/// Maximum number of pictures without the board's tags in which other families are searched.
const MAX_SEARCHED: usize = 40;
/// Minimum number of tags of another family that are not false detections.
const MIN_OTHER_TAGS: usize = 3;
/// Maximum number of searches for missed tags beside detected ones.
const MAX_ROUNDS: usize = 6;

/// A tag board detected in a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TagBoardDetection {
    /// Points found.
    pub points: Vec<Correspondence>,
    /// Number of detected tags of the board.
    pub tags: usize,
    /// Number of tags of the board's family whose numbers are not on the board.
    pub foreign_tags: usize,
    /// The tags' positions are those of another board.
    pub is_inconsistent: bool,
    /// Number of columns of that other board, if determined.
    pub other_columns: Option<u32>,
    /// Another family, of which there are tags instead.
    pub other_family: Option<Family>,
}

/// Finds the points of one board; reuses its buffers.
#[derive(Clone, Debug)]
pub struct TagFinder {
    board: Board,
    family: Family,
    layout: Layout,
    /// Number of pictures that determine the layout, by [`Layout::white_first`].
    layout_votes: BTreeMap<bool, usize>,
    response: Response,
    detector: Detector,
    /// Detector of all other families, created on first use.
    other_families: Option<Detector>,
    /// Number of pictures searched for other families.
    searched: usize,
    codes: Vec<u8>,
}

impl TagFinder {
    /// Creates a finder for `board`; `None` for a chessboard.
    #[must_use]
    pub fn new(board: &Board) -> Option<Self> {
        let (family, layout) = (board.family()?, Layout::from_board(board)?);
        let response = Response::srgb();
        let detector = Detector::new(&[family], &response).with_max_candidates(MAX_CANDIDATES);
        Some(Self {
            board: *board,
            family,
            layout,
            layout_votes: BTreeMap::new(),
            detector: if matches!(board, Board::AprilGrid { .. }) {
                detector.with_touching_corners()
            } else {
                detector
            },
            response,
            other_families: None,
            searched: 0,
            codes: Vec::new(),
        })
    }

    /// Finds the board's points in a picture.
    pub fn find(&mut self, picture: &Grey) -> TagBoardDetection {
        let size = (picture.width, picture.height);
        self.codes.clear();
        let code = |v: &f32| v.round().clamp(0.0, 255.0) as u8;
        self.codes.extend(picture.data.iter().map(code));
        let found = self.detector.detect_grey(&self.codes, size.0, size.1, None);
        let tags: Vec<DetectedTag> = found
            .iter()
            .map(|tag| detected_tag(&self.board, tag))
            .collect();
        if tags.is_empty() {
            return TagBoardDetection {
                other_family: self.search_other_families(size),
                ..TagBoardDetection::default()
            };
        }
        let foreign_tags = tags.iter().filter(|t| t.id >= self.board.tag_count());
        let foreign_tags = foreign_tags.count();
        let fit = fit(&self.board, &tags, self.layout);
        if fit.is_inconsistent {
            return TagBoardDetection {
                foreign_tags,
                is_inconsistent: true,
                other_columns: fit.other_columns,
                ..TagBoardDetection::default()
            };
        }
        self.update_layout(&fit);
        let smooth = picture.blurred(SMOOTHING);
        let refine = |predicted, window| refine_corner(&smooth, predicted, window);
        let tags = self.with_missed_tags(fit.tags, fit.layout, size, &refine);
        TagBoardDetection {
            points: correspondences(&self.board, fit.layout, &tags, refine),
            tags: tags.len(),
            foreign_tags,
            ..TagBoardDetection::default()
        }
    }

    /// Uses the layout of most pictures for pictures that do not determine it.
    fn update_layout(&mut self, fit: &Fit) {
        if fit.pairs > 0 {
            *self.layout_votes.entry(fit.layout.white_first).or_default() += 1;
        }
        let most_frequent = self.layout_votes.iter().max_by_key(|(_, n)| **n);
        if let Some((&white_first, _)) = most_frequent {
            self.layout.white_first = white_first;
        }
    }

    /// Adds missed tags at the positions that their neighbours predict: in oblique views and at the
    /// rim of a fisheye's picture, sides are too short or too curved for outline detection.
    fn with_missed_tags(
        &self,
        mut tags: Vec<DetectedTag>,
        layout: Layout,
        size: (usize, usize),
        refine: &impl Fn(DVec2, f64) -> Option<DVec2>,
    ) -> Vec<DetectedTag> {
        for _ in 0..MAX_ROUNDS {
            let known = tags.len();
            let predicted = predict_missing_tags(&self.board, layout, &tags, refine);
            tags.extend(predicted.into_iter().filter_map(|tag| {
                let picture = (self.codes.as_slice(), size);
                let which = (self.family, tag.id);
                let corners = reorder_corners(&self.board, tag.corners);
                let found = read_predicted(picture, &self.response, corners, which)?;
                Some(detected_tag(&self.board, &found))
            }));
            if tags.len() == known {
                break;
            }
        }
        tags
    }

    /// Searches the picture for several tags of another family.
    fn search_other_families(&mut self, (width, height): (usize, usize)) -> Option<Family> {
        if self.searched >= MAX_SEARCHED {
            return None;
        }
        self.searched += 1;
        let others = Family::ALL.into_iter().filter(|f| *f != self.family);
        let others: Vec<Family> = others.collect();
        let detector = self.other_families.get_or_insert_with(|| {
            Detector::new(&others, &self.response).with_max_candidates(MAX_CANDIDATES)
        });
        let found = detector.detect_grey(&self.codes, width, height, None);
        let count = |family: Family| found.iter().filter(|t| t.family == family).count();
        let most_frequent = others.into_iter().max_by_key(|f| count(*f))?;
        (count(most_frequent) >= MIN_OTHER_TAGS).then_some(most_frequent)
    }
}

/// Reorders a tag's corners between the tag's own top left and the board's; its own inverse.
fn reorder_corners(board: &Board, corners: [DVec2; 4]) -> [DVec2; 4] {
    let [a, b, c, d] = corners;
    if board.has_rotated_tags() {
        [c, d, a, b]
    } else {
        corners
    }
}

fn detected_tag(board: &Board, tag: &TagObservation) -> DetectedTag {
    DetectedTag {
        id: tag.id,
        corners: reorder_corners(board, tag.corners),
    }
}

#[cfg(test)]
mod tests;
