//! The families of tags: number of modules and code words.

use super::codes::{
    ARUCO_4X4, ARUCO_5X5, ARUCO_6X6, ARUCO_7X7, ARUCO_ORIGINAL, MIP_36H12, TAG16H5, TAG25H9,
    TAG36H11,
};
use super::dictionary::{self, Dictionary};
use std::fmt;
use std::str::FromStr;

/// A family of square tags: AprilTags and dictionaries of ArUco markers. All have a black border of
/// one module within a white one, except [`Family::Kalibr36h11`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Family {
    /// 587 tags of 36 bits with a Hamming distance of at least 11. Recommended.
    Tag36h11,
    /// 35 tags of 25 bits with a Hamming distance of at least 9.
    Tag25h9,
    /// 30 tags of 16 bits with a Hamming distance of at least 5: more false detections than with
    /// the other families.
    Tag16h5,
    /// The tags of 36h11 with a black border of two modules, as on Kalibr's AprilGrid.
    Kalibr36h11,
    /// The first n ArUco markers of 4×4 bits; OpenCV has 50, 100, 250 and 1000.
    Aruco4x4(u16),
    /// The first n ArUco markers of 5×5 bits.
    Aruco5x5(u16),
    /// The first n ArUco markers of 6×6 bits.
    Aruco6x6(u16),
    /// The first n ArUco markers of 7×7 bits.
    Aruco7x7(u16),
    /// The 1024 markers of the original ArUco dictionary; each row is one of four words of 5 bits.
    ArucoOriginal,
    /// 250 markers of 36 bits with a Hamming distance of at least 12.
    ArucoMip36h12,
    /// A dictionary that a user brings.
    Custom(Dictionary),
}

/// Order of a word's bits over the modules.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout {
    /// Quarter by quarter around the square (AprilTag 3).
    Quarters,
    /// Row by row (ArUco).
    Rows,
}

/// A decoded word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Word {
    /// Number of the tag in its family.
    pub id: u32,
    /// Number of corrected bits.
    pub wrong: u32,
    /// Quarter turns, clockwise as the tag is read, from the tag to the corners' order.
    pub turns: usize,
}

impl Family {
    /// All built-in families; of the dictionaries of one size only the largest, which begins with the
    /// smaller ones.
    pub const ALL: [Self; 10] = [
        Self::Tag36h11,
        Self::Tag25h9,
        Self::Tag16h5,
        Self::Kalibr36h11,
        Self::Aruco4x4(1000),
        Self::Aruco5x5(1000),
        Self::Aruco6x6(1000),
        Self::Aruco7x7(1000),
        Self::ArucoOriginal,
        Self::ArucoMip36h12,
    ];

    /// Modules along a side of the word.
    const fn side(self) -> u32 {
        match self {
            Self::Tag16h5 | Self::Aruco4x4(_) => 4,
            Self::Tag25h9 | Self::Aruco5x5(_) | Self::ArucoOriginal => 5,
            Self::Aruco7x7(_) => 7,
            Self::Custom(dictionary) => dictionary.side(),
            Self::Tag36h11 | Self::Kalibr36h11 | Self::Aruco6x6(_) | Self::ArucoMip36h12 => 6,
        }
    }

    /// Width of the black border, modules.
    #[must_use]
    pub const fn border(self) -> u32 {
        if matches!(self, Self::Kalibr36h11) {
            2
        } else {
            1
        }
    }

    /// Modules across the black border.
    #[must_use]
    pub const fn modules(self) -> u32 {
        self.side() + 2 * self.border()
    }

    /// Number of bits of a word.
    pub(super) const fn bits(self) -> u32 {
        self.side() * self.side()
    }

    /// Number of tags.
    #[must_use]
    pub fn count(self) -> u32 {
        self.words().len() as u32
    }

    pub(super) fn words(self) -> &'static [u64] {
        let first = |all: &'static [u64], count: u16| &all[..all.len().min(usize::from(count))];
        match self {
            Self::Tag36h11 | Self::Kalibr36h11 => &TAG36H11,
            Self::Tag25h9 => &TAG25H9,
            Self::Tag16h5 => &TAG16H5,
            Self::Aruco4x4(n) => first(&ARUCO_4X4, n),
            Self::Aruco5x5(n) => first(&ARUCO_5X5, n),
            Self::Aruco6x6(n) => first(&ARUCO_6X6, n),
            Self::Aruco7x7(n) => first(&ARUCO_7X7, n),
            Self::ArucoOriginal => &ARUCO_ORIGINAL,
            Self::ArucoMip36h12 => &MIP_36H12,
            Self::Custom(dictionary) => dictionary.words(),
        }
    }

    /// Maximum number of bits that are corrected. The code could correct more, but each makes false
    /// detections more likely.
    const fn max_wrong_bits(self) -> u32 {
        match self {
            Self::Tag36h11 | Self::Kalibr36h11 | Self::Aruco6x6(_) | Self::ArucoMip36h12 => 2,
            Self::Aruco7x7(_) => 3,
            Self::Custom(dictionary) => dictionary.max_wrong_bits(),
            Self::Tag25h9 | Self::Aruco5x5(_) => 1,
            Self::Tag16h5 | Self::Aruco4x4(_) | Self::ArucoOriginal => 0,
        }
    }

    const fn layout(self) -> Layout {
        match self {
            Self::Tag36h11 | Self::Tag25h9 | Self::Tag16h5 | Self::Kalibr36h11 => Layout::Quarters,
            _ => Layout::Rows,
        }
    }

    /// Column and row of a bit's module, counted from the outermost column and row of the black border.
    pub(super) const fn module(self, bit: u32) -> (u32, u32) {
        let (x, y) = match self.layout() {
            Layout::Rows => (bit % self.side(), bit / self.side()),
            Layout::Quarters => in_quarters(self.side(), bit),
        };
        (x + self.border(), y + self.border())
    }

    /// Returns whether a tag's module is white. Modules outside the word are black.
    #[must_use]
    pub fn is_white(self, id: u32, column: u32, row: u32) -> bool {
        let word = self.words().get(id as usize).copied().unwrap_or(0);
        let bits = self.bits();
        (0..bits)
            .any(|bit| self.module(bit) == (column, row) && (word >> (bits - 1 - bit)) & 1 == 1)
    }

    /// Returns the word of the same tag rotated by 90°.
    fn rotated(self, word: u64) -> u64 {
        let bits = self.bits();
        match self.layout() {
            Layout::Quarters => {
                let odd = bits % 4;
                let (round, quarter) = (bits - odd, bits / 4);
                let middle = word & ((1 << odd) - 1);
                let ring = word >> odd;
                let ring = (ring << quarter) | (ring >> (round - quarter));
                ((ring & ((1 << round) - 1)) << odd) | middle
            }
            Layout::Rows => dictionary::rotated(word, self.side()),
        }
    }

    /// Returns the number of bits in which an upright tag's word differs from `read`; `None` if the
    /// family has no such tag.
    pub(super) fn wrong_bits(self, read: u64, id: u32) -> Option<u32> {
        let word = self.words().get(id as usize)?;
        Some((word ^ read).count_ones())
    }

    /// Finds the tag of a word, in any of the four rotations.
    pub(super) fn look_up(self, read: u64) -> Option<Word> {
        let mut word = read;
        for turns in 0..4 {
            let wrong = |code: &u64| (code ^ word).count_ones();
            let found = self
                .words()
                .iter()
                .position(|c| wrong(c) <= self.max_wrong_bits());
            if let Some(i) = found {
                return Some(Word {
                    id: i as u32,
                    wrong: wrong(&self.words()[i]),
                    turns,
                });
            }
            word = self.rotated(word);
        }
        None
    }
}

/// Column and row of a bit in AprilTag 3's layout, where rotating the tag by 90° rotates its word by
/// a quarter.
const fn in_quarters(side: u32, bit: u32) -> (u32, u32) {
    let quarter = side * side / 4;
    let (mut turns, mut rest) = (bit / quarter, bit % quarter);
    if turns == 4 {
        // An odd square's middle.
        return (side / 2, side / 2);
    }
    let mut ring = 0;
    while rest >= side - 1 - 2 * ring {
        rest -= side - 1 - 2 * ring;
        ring += 1;
    }
    let (mut x, mut y) = (ring + rest, ring);
    while turns > 0 {
        (x, y) = (side - 1 - y, x);
        turns -= 1;
    }
    (x, y)
}

/// An unknown name of a family.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown family of tags `{0}`; use tag36h11, tag25h9, tag16h5, 4x4_50 (100, 250, 1000; also \
     5x5, 6x6, 7x7), aruco_original, aruco_mip_36h12, or name the file of a dictionary in \
     [registration] dictionaries"
)]
pub struct UnknownFamily(String);

impl FromStr for Family {
    type Err = UnknownFamily;

    /// Parses a displayed name, that of a registered [`Dictionary`] too, or OpenCV's name:
    /// `DICT_4X4_50`, `DICT_APRILTAG_36h11`.
    fn from_str(name: &str) -> Result<Self, UnknownFamily> {
        let custom = || Dictionary::named(&name.to_ascii_lowercase()).map(Self::Custom);
        Self::built_in(name)
            .or_else(custom)
            .ok_or_else(|| UnknownFamily(name.to_owned()))
    }
}

impl Family {
    /// Returns the built-in family of a name.
    pub(super) fn built_in(name: &str) -> Option<Self> {
        let low = name.to_ascii_lowercase();
        let plain = low.strip_prefix("dict_").unwrap_or(&low);
        let tag = plain.strip_prefix("apriltag_").map(|t| format!("tag{t}"));
        let plain = tag.as_deref().unwrap_or(plain);
        let sizes = [50, 100, 250, 1000].into_iter().flat_map(|n| {
            [
                Self::Aruco4x4(n),
                Self::Aruco5x5(n),
                Self::Aruco6x6(n),
                Self::Aruco7x7(n),
            ]
        });
        let known = Self::ALL.into_iter().chain(sizes);
        known.into_iter().find(|f| f.to_string() == plain)
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tag36h11 => f.write_str("tag36h11"),
            Self::Tag25h9 => f.write_str("tag25h9"),
            Self::Tag16h5 => f.write_str("tag16h5"),
            Self::Kalibr36h11 => f.write_str("kalibr36h11"),
            Self::Aruco4x4(n) => write!(f, "4x4_{n}"),
            Self::Aruco5x5(n) => write!(f, "5x5_{n}"),
            Self::Aruco6x6(n) => write!(f, "6x6_{n}"),
            Self::Aruco7x7(n) => write!(f, "7x7_{n}"),
            Self::ArucoOriginal => f.write_str("aruco_original"),
            Self::ArucoMip36h12 => f.write_str("aruco_mip_36h12"),
            Self::Custom(dictionary) => f.write_str(dictionary.name()),
        }
    }
}

#[cfg(test)]
mod tests;
