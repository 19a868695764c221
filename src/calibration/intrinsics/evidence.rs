//! Checks over all pictures whether the board is the given one.

use super::board::Board;
use super::detect::{ChessboardDetection, NoChessboard, Placement};
use super::findings::Finding;
use super::tag_finder::TagBoardDetection;
use penumbra_fiducials::Family;
use std::collections::BTreeMap;

/// Minimum share of detections with one other size to conclude that the board has that size.
const MIN_OTHER_SIZE: f64 = 0.6;

/// Evidence from pictures of a chessboard about the given board.
#[derive(Clone, Debug, Default)]
pub(super) struct ChessEvidence {
    /// Number of pictures of boards with more corners, by size.
    larger: BTreeMap<(u32, u32), usize>,
    /// Number of pictures of the complete board.
    complete: usize,
    /// Number of pictures of a part of the board, by size of the part.
    partial: BTreeMap<(u32, u32), usize>,
}

impl ChessEvidence {
    pub fn add(&mut self, found: &Result<ChessboardDetection, NoChessboard>) {
        match found {
            Ok(detection) if detection.placement == Placement::Unknown => {
                *self.partial.entry(detection.extent).or_default() += 1;
            }
            Ok(_) => self.complete += 1,
            Err(NoChessboard::Larger { columns, rows }) => {
                *self.larger.entry((*columns, *rows)).or_default() += 1;
            }
            Err(NoChessboard::NotSeen) => {}
        }
    }

    /// Checks that the board is the given one.
    pub fn check(&self) -> Result<(), Finding> {
        let larger: usize = self.larger.values().sum();
        let partial: usize = self.partial.values().sum();
        let detected = larger + partial + self.complete;
        let other = |counts: &BTreeMap<(u32, u32), usize>| {
            let (&(columns, rows), _) = counts.iter().max_by_key(|(_, n)| **n)?;
            Some(Finding::OtherBoard { columns, rows })
        };
        if larger > self.complete + partial
            && let Some(finding) = other(&self.larger)
        {
            return Err(finding);
        }
        // Visible parts of a board vary in size; one size repeatedly means a smaller board.
        let largest_count = self.partial.values().copied().max().unwrap_or(0);
        let is_dominant = largest_count as f64 >= MIN_OTHER_SIZE * detected as f64;
        if self.complete == 0
            && largest_count >= 3
            && is_dominant
            && let Some(finding) = other(&self.partial)
        {
            return Err(finding);
        }
        Ok(())
    }
}

/// Evidence from pictures of a board of tags about the given board.
#[derive(Clone, Debug, Default)]
pub(super) struct TagEvidence {
    /// Number of pictures whose tags have the positions of the board.
    consistent: usize,
    /// Number of pictures whose tags have other positions, by the columns of that board.
    inconsistent: BTreeMap<Option<u32>, usize>,
    /// Number of pictures with tags of another family instead.
    other_families: BTreeMap<Family, usize>,
    /// Number of pictures with tags that are not on the board.
    foreign_tags: usize,
}

impl TagEvidence {
    pub fn add(&mut self, detected: &TagBoardDetection) {
        self.consistent += usize::from(detected.tags > 0);
        self.foreign_tags += usize::from(detected.foreign_tags > 0);
        if detected.is_inconsistent {
            *self.inconsistent.entry(detected.other_columns).or_default() += 1;
        }
        if let Some(family) = detected.other_family {
            *self.other_families.entry(family).or_default() += 1;
        }
    }

    /// Checks that the board is the given one.
    pub fn check(&self, board: &Board) -> Result<(), Finding> {
        let most_frequent = |counts: &BTreeMap<Option<u32>, usize>| {
            counts.iter().max_by_key(|(_, n)| **n).map(|(c, _)| *c)
        };
        let inconsistent: usize = self.inconsistent.values().sum();
        if inconsistent > self.consistent
            && let Some(columns) = most_frequent(&self.inconsistent)
        {
            return Err(Finding::OtherLayout { columns });
        }
        let other_families = self.other_families.iter().max_by_key(|(_, n)| **n);
        if let (Some((&detected, &n)), Some(given)) = (other_families, board.family())
            && n > self.consistent
        {
            return Err(Finding::OtherFamily { detected, given });
        }
        Ok(())
    }

    /// Returns a finding if many pictures show tags that are not on the board; its points are
    /// valid.
    pub fn foreign_tags_finding(&self) -> Option<Finding> {
        let pictures = self.foreign_tags;
        (3 * pictures > self.consistent).then_some(Finding::ForeignTags { pictures })
    }
}
