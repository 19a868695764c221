//! The families of tags: how many modules, which words.

use super::codes::{TAG16H5, TAG25H9, TAG36H11};
use std::fmt;
use std::str::FromStr;

/// A family of AprilTags. All have a black border of one module within a white one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Family {
    /// 587 tags of 36 bits, any two at least 11 bits apart. The one to use.
    Tag36h11,
    /// 35 tags of 25 bits, at least 9 apart.
    Tag25h9,
    /// 30 tags of 16 bits, at least 5 apart: found where no tag is more often than the others.
    Tag16h5,
}

/// A word that was read, put right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Word {
    /// Number of the tag.
    pub id: u32,
    /// Bits that were read wrong.
    pub wrong: u32,
    /// Quarter turns, clockwise as the tag is read, from the tag to the corners' order.
    pub turns: usize,
}

impl Family {
    /// All that are known.
    pub const ALL: [Self; 3] = [Self::Tag36h11, Self::Tag25h9, Self::Tag16h5];

    /// Modules across the black border.
    #[must_use]
    pub const fn modules(self) -> u32 {
        match self {
            Self::Tag36h11 => 8,
            Self::Tag25h9 => 7,
            Self::Tag16h5 => 6,
        }
    }

    /// Bits of a word.
    pub(super) const fn bits(self) -> u32 {
        let side = self.modules() - 2;
        side * side
    }

    pub(super) const fn words(self) -> &'static [u64] {
        match self {
            Self::Tag36h11 => &TAG36H11,
            Self::Tag25h9 => &TAG25H9,
            Self::Tag16h5 => &TAG16H5,
        }
    }

    /// Bits that may be wrong. Fewer than the code could put right: every one more makes it
    /// likelier that something is taken for a tag.
    const fn most_wrong(self) -> u32 {
        match self {
            Self::Tag36h11 => 2,
            Self::Tag25h9 => 1,
            Self::Tag16h5 => 0,
        }
    }

    /// Column and row of a bit's module, from (1, 1) within the border. Version 3 of AprilTag
    /// goes along a quarter of the square and round, so that a quarter turn of the tag
    /// rotates its word.
    pub(super) const fn module(self, bit: u32) -> (u32, u32) {
        let last = self.modules() - 1;
        let quarter = self.bits() / 4;
        let (mut turns, mut rest) = (bit / quarter, bit % quarter);
        if turns == 4 {
            // An odd square's middle.
            return (last / 2, last / 2);
        }
        let mut ring = 1;
        while rest >= last - 2 * ring {
            rest -= last - 2 * ring;
            ring += 1;
        }
        let (mut x, mut y) = (ring + rest, ring);
        while turns > 0 {
            (x, y) = (last - y, x);
            turns -= 1;
        }
        (x, y)
    }

    /// The word of the same tag after a quarter turn.
    const fn turned(self, word: u64) -> u64 {
        let (bits, odd) = (self.bits(), self.bits() % 4);
        let (round, quarter) = (bits - odd, bits / 4);
        let middle = word & ((1 << odd) - 1);
        let ring = word >> odd;
        let ring = (ring << quarter) | (ring >> (round - quarter));
        ((ring & ((1 << round) - 1)) << odd) | middle
    }

    /// The tag whose word was read, if it is one.
    pub(super) fn look_up(self, read: u64) -> Option<Word> {
        let mut word = read;
        for turns in 0..4 {
            let wrong = |code: &u64| (code ^ word).count_ones();
            let found = self
                .words()
                .iter()
                .position(|c| wrong(c) <= self.most_wrong());
            if let Some(i) = found {
                return Some(Word {
                    id: i as u32,
                    wrong: wrong(&self.words()[i]),
                    turns,
                });
            }
            word = self.turned(word);
        }
        None
    }
}

/// No such family.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no family of tags that is known; use tag36h11, tag25h9 or tag16h5")]
pub struct UnknownFamily(String);

impl FromStr for Family {
    type Err = UnknownFamily;

    fn from_str(name: &str) -> Result<Self, UnknownFamily> {
        let known = Self::ALL.into_iter().find(|f| f.to_string() == name);
        known.ok_or_else(|| UnknownFamily(name.to_owned()))
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Tag36h11 => "tag36h11",
            Self::Tag25h9 => "tag25h9",
            Self::Tag16h5 => "tag16h5",
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_bit_has_a_module_of_its_own() {
        for family in Family::ALL {
            let all: HashSet<_> = (0..family.bits()).map(|b| family.module(b)).collect();
            assert_eq!(all.len() as u32, family.bits());
            let side = 1..family.modules() - 1;
            assert!(
                all.iter()
                    .all(|(x, y)| side.contains(x) && side.contains(y))
            );
        }
        // As AprilTag's own tables have them.
        assert_eq!(Family::Tag36h11.module(8), (3, 3));
        assert_eq!(Family::Tag36h11.module(9), (6, 1));
        assert_eq!(Family::Tag36h11.module(35), (3, 4));
        assert_eq!(Family::Tag25h9.module(24), (3, 3));
        assert_eq!(Family::Tag16h5.module(15), (2, 3));
    }

    #[test]
    fn words_are_as_far_apart_as_the_familys_name_says_however_they_are_turned() {
        for (family, apart) in [
            (Family::Tag36h11, 11),
            (Family::Tag25h9, 9),
            (Family::Tag16h5, 5),
        ] {
            let words = family.words();
            for (i, word) in words.iter().enumerate() {
                let mut turned = *word;
                for turn in 0..4 {
                    let others = words
                        .iter()
                        .enumerate()
                        .filter(|(k, _)| turn > 0 || *k != i);
                    let nearest = others.map(|(_, w)| (w ^ turned).count_ones()).min();
                    assert!(nearest.unwrap() >= apart, "{family} {i} {turn}");
                    turned = family.turned(turned);
                }
                assert_eq!(turned, *word);
            }
        }
    }

    #[test]
    fn a_word_with_wrong_bits_is_put_right_and_noise_is_no_tag() {
        let family = Family::Tag36h11;
        let word = family.words()[341] ^ 0b10_0000_0001;
        let found = family.look_up(word).unwrap();
        assert_eq!((found.id, found.wrong, found.turns), (341, 2, 0));
        assert_eq!(family.look_up(family.words()[341] ^ 0b111), None);
        assert_eq!(family.look_up(0), None);
        assert_eq!("tag25h9".parse::<Family>().unwrap(), Family::Tag25h9);
        assert!("tag36h10".parse::<Family>().is_err());
    }
}
