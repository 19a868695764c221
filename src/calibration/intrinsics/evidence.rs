//! Checks over all pictures that the board is the given one.

use super::board::Board;
use super::detect::{ChessSighting, NoChessboard, Placement};
use super::finding::Finding;
use super::tag_finder::TagSighting;
use penumbra_fiducials::Family;
use std::collections::BTreeMap;

/// Of the sightings, so many must be of one other size to say that the board is.
const OTHER_SIZE: f64 = 0.6;

/// Evidence from pictures of a chessboard about the given board.
#[derive(Clone, Debug, Default)]
pub(super) struct ChessEvidence {
    /// Pictures of boards with more corners, by their size.
    larger: BTreeMap<(u32, u32), usize>,
    /// Pictures of the whole board.
    whole: usize,
    /// Pictures of a part, by its size.
    partial: BTreeMap<(u32, u32), usize>,
}

impl ChessEvidence {
    pub fn note(&mut self, found: &Result<ChessSighting, NoChessboard>) {
        match found {
            Ok(sighting) if sighting.placement == Placement::Unknown => {
                *self.partial.entry(sighting.extent).or_default() += 1;
            }
            Ok(_) => self.whole += 1,
            Err(NoChessboard::Larger { columns, rows }) => {
                *self.larger.entry((*columns, *rows)).or_default() += 1;
            }
            Err(NoChessboard::NotSeen) => {}
        }
    }

    /// That the board is the one that was said.
    pub fn check(&self) -> Result<(), Finding> {
        let larger: usize = self.larger.values().sum();
        let partial: usize = self.partial.values().sum();
        let seen = larger + partial + self.whole;
        let other = |counts: &BTreeMap<(u32, u32), usize>| {
            let (&(columns, rows), _) = counts.iter().max_by_key(|(_, n)| **n)?;
            Some(Finding::OtherBoard { columns, rows })
        };
        if larger > self.whole + partial
            && let Some(finding) = other(&self.larger)
        {
            return Err(finding);
        }
        // Visible parts of a board vary in size; one size repeatedly means a smaller board.
        let commonest = self.partial.values().copied().max().unwrap_or(0);
        let alike = commonest as f64 >= OTHER_SIZE * seen as f64;
        if self.whole == 0
            && commonest >= 3
            && alike
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
    /// Pictures whose tags lie as said.
    agreeing: usize,
    /// Pictures whose tags do not, by the columns that they would have.
    contradicting: BTreeMap<Option<u32>, usize>,
    /// Pictures with tags of another family instead.
    strangers: BTreeMap<Family, usize>,
    /// Pictures with tags that the board does not have.
    beside: usize,
}

impl TagEvidence {
    pub fn note(&mut self, seen: &TagSighting) {
        self.agreeing += usize::from(seen.tags > 0);
        self.beside += usize::from(seen.beside > 0);
        if seen.contradicts {
            *self.contradicting.entry(seen.other_columns).or_default() += 1;
        }
        if let Some(family) = seen.other_family {
            *self.strangers.entry(family).or_default() += 1;
        }
    }

    /// That the board is the one that was said.
    pub fn check(&self, board: &Board) -> Result<(), Finding> {
        let most = |counts: &BTreeMap<Option<u32>, usize>| {
            counts.iter().max_by_key(|(_, n)| **n).map(|(c, _)| *c)
        };
        let contradicting: usize = self.contradicting.values().sum();
        if contradicting > self.agreeing
            && let Some(columns) = most(&self.contradicting)
        {
            return Err(Finding::OtherLayout { columns });
        }
        let strangers = self.strangers.iter().max_by_key(|(_, n)| **n);
        if let (Some((&seen, &n)), Some(said)) = (strangers, board.family())
            && n > self.agreeing
        {
            return Err(Finding::OtherFamily { seen, said });
        }
        Ok(())
    }

    /// What speaks against the board without making its points wrong.
    pub fn doubt(&self) -> Option<Finding> {
        let pictures = self.beside;
        (3 * pictures > self.agreeing).then_some(Finding::TagsBeside { pictures })
    }
}
