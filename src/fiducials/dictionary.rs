//! Dictionaries of markers that a user brings: OpenCV's own files (YAML or XML, as its
//! `Dictionary::writeDictionary` writes them) and plain lists of bits.
//!
//! A dictionary is registered under a name and stays for the life of the program, so that a
//! [`Family`] remains a small value. Registering the same one again changes nothing.

use super::family::Family;
use std::collections::HashMap;
use std::sync::{PoisonError, RwLock};

/// Maximum number of dictionaries of a program.
const MAX_DICTIONARIES: usize = 32;
/// Maximum number of markers.
const MAX_MARKERS: usize = 4096;
/// Maximum length of the text, bytes.
pub const MAX_DICTIONARY_BYTES: u64 = 1 << 20;
/// Modules along a side of a marker's word.
const SIDES: std::ops::RangeInclusive<u32> = 3..=8;
/// Endings of the files.
pub const DICTIONARY_ENDINGS: [&str; 4] = [".yml", ".yaml", ".xml", ".txt"];

static REGISTERED: RwLock<Vec<&'static Definition>> = RwLock::new(Vec::new());

/// A registered dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Dictionary(&'static Definition);

#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Definition {
    name: String,
    side: u32,
    /// Row by row, 1 is white.
    words: Vec<u64>,
    max_wrong_bits: u32,
}

/// A dictionary that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DictionaryError {
    /// The name is that of a known family or has other characters.
    #[error(
        "`{name}` is not a name for a dictionary; use letters, digits, - and _, and no known family's"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// Another dictionary has this name.
    #[error("there is another dictionary `{name}`; rename one of the files")]
    Taken {
        /// The name.
        name: String,
    },
    /// Too many dictionaries.
    #[error("expected at most {MAX_DICTIONARIES} dictionaries")]
    TooMany,
    /// The text has no markers.
    #[error(
        "no markers; expected OpenCV's dictionary (nmarkers, markersize, marker_0: \"0110…\") or one \
         marker per line, its bits row by row, 1 for white"
    )]
    Empty,
    /// A marker is missing or surplus, or a key contradicts the markers.
    #[error("{key}: {reason}")]
    Key {
        /// The key, or the line.
        key: String,
        /// What is wrong.
        reason: String,
    },
    /// Two markers look alike when one is turned.
    #[error("marker {first} and marker {second} differ by no bit, turned by {turns} quarters")]
    Alike {
        /// A marker.
        first: usize,
        /// Another one, or the same.
        second: usize,
        /// Quarter turns.
        turns: usize,
    },
}

impl Dictionary {
    /// Reads a dictionary and registers it under `name`, in lower case.
    ///
    /// # Errors
    /// The text is no dictionary, its markers cannot be told apart, or the name is taken.
    pub fn register(name: &str, text: &str) -> Result<Family, DictionaryError> {
        let name = name.to_ascii_lowercase();
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
        let is_plain = !name.is_empty() && name.len() <= 64 && name.chars().all(plain);
        if !is_plain || Family::built_in(&name).is_some() {
            return Err(DictionaryError::Name { name });
        }
        let definition = definition(name, text)?;
        let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = registered.iter().find(|d| d.name == definition.name) {
            if **known == definition {
                return Ok(Family::Custom(Self(known)));
            }
            let name = definition.name;
            return Err(DictionaryError::Taken { name });
        }
        if registered.len() >= MAX_DICTIONARIES {
            return Err(DictionaryError::TooMany);
        }
        // It is kept for the life of the program; their number is limited.
        let kept: &'static Definition = Box::leak(Box::new(definition));
        registered.push(kept);
        Ok(Family::Custom(Self(kept)))
    }

    /// Returns the registered dictionary of a name.
    pub(super) fn named(name: &str) -> Option<Self> {
        let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
        registered.iter().find(|d| d.name == name).map(|d| Self(d))
    }

    pub(super) fn name(self) -> &'static str {
        &self.0.name
    }

    pub(super) const fn side(self) -> u32 {
        self.0.side
    }

    pub(super) fn words(self) -> &'static [u64] {
        &self.0.words
    }

    pub(super) const fn max_wrong_bits(self) -> u32 {
        self.0.max_wrong_bits
    }
}

/// The keys of OpenCV's format, or the markers of a plain list.
#[derive(Default)]
struct Parsed {
    markers: HashMap<usize, String>,
    count: Option<u32>,
    side: Option<u32>,
    max_correction: Option<u32>,
}

impl Parsed {
    fn set(&mut self, key: &str, value: &str) -> Result<(), DictionaryError> {
        let wrong = |reason: &str| DictionaryError::Key {
            key: key.to_owned(),
            reason: reason.to_owned(),
        };
        let number = || {
            value
                .parse::<u32>()
                .map_err(|_| wrong("expected a whole number"))
        };
        match key {
            "nmarkers" => self.count = Some(number()?),
            "markersize" => self.side = Some(number()?),
            "maxCorrectionBits" => self.max_correction = Some(number()?),
            _ => {
                let Some(index) = key.strip_prefix("marker_") else {
                    return Ok(());
                };
                let index = index.parse().ok().filter(|i| *i < MAX_MARKERS);
                let limit = format!("expected marker_0 to marker_{}", MAX_MARKERS - 1);
                let index = index.ok_or_else(|| wrong(&limit))?;
                if self.markers.insert(index, value.to_owned()).is_some() {
                    return Err(wrong("stands twice"));
                }
            }
        }
        Ok(())
    }
}

fn definition(name: String, text: &str) -> Result<Definition, DictionaryError> {
    let parsed = if text.contains("<opencv_storage>") {
        xml(text)?
    } else if text.contains("marker_0") {
        yaml(text)?
    } else {
        list(text)?
    };
    let count = parsed.markers.len();
    let key = |key: &str, reason: String| DictionaryError::Key {
        key: key.to_owned(),
        reason,
    };
    let first = parsed.markers.get(&0).ok_or(DictionaryError::Empty)?;
    let side = parsed.side.unwrap_or_else(|| first.len().isqrt() as u32);
    if !SIDES.contains(&side) {
        let (low, high) = SIDES.into_inner();
        let reason = format!("expected markers of {low} to {high} bits a side, found {side}");
        return Err(key("markersize", reason));
    }
    if parsed.count.is_some_and(|stated| stated as usize != count) {
        return Err(key("nmarkers", format!("there are {count} markers")));
    }
    let word = |index: usize| {
        let at = format!("marker_{index}");
        let bits = parsed.markers.get(&index);
        let bits = bits.ok_or_else(|| key(&at, "is missing".to_owned()))?;
        let is_word =
            bits.len() == (side * side) as usize && bits.bytes().all(|b| b"01".contains(&b));
        let expected = || format!("expected {} digits 0 or 1", side * side);
        let word = is_word.then(|| u64::from_str_radix(bits, 2).ok()).flatten();
        word.ok_or_else(|| key(&at, expected()))
    };
    let words = (0..count).map(word).collect::<Result<Vec<_>, _>>()?;
    let distance = distance(&words, side)?;
    let correctable = (distance - 1) / 2;
    // As for the built-in dictionaries: the code could correct more, but each bit makes false detections
    // more likely.
    let cautious = side.saturating_sub(4);
    let max_wrong_bits = correctable.min(cautious);
    Ok(Definition {
        name,
        side,
        words,
        max_wrong_bits: max_wrong_bits.min(parsed.max_correction.unwrap_or(u32::MAX)),
    })
}

/// Returns the smallest number of bits in which two markers differ, turned in any way.
fn distance(words: &[u64], side: u32) -> Result<u32, DictionaryError> {
    let mut least = side * side;
    for (first, word) in words.iter().enumerate() {
        let mut turned = *word;
        for turns in 0..4 {
            for (second, other) in words.iter().enumerate().skip(first) {
                if second == first && turns == 0 {
                    continue;
                }
                let bits = (turned ^ other).count_ones();
                if bits == 0 {
                    return Err(DictionaryError::Alike {
                        first,
                        second,
                        turns,
                    });
                }
                least = least.min(bits);
            }
            turned = rotated(turned, side);
        }
    }
    Ok(least)
}

/// Returns the word of the same marker rotated by 90°.
pub(super) fn rotated(word: u64, side: u32) -> u64 {
    let bits = side * side;
    (0..bits).fold(0, |rotated, bit| {
        let (x, y) = (bit % side, bit / side);
        let from = x * side + side - 1 - y;
        (rotated << 1) | ((word >> (bits - 1 - from)) & 1)
    })
}

/// `key: value` in each line; other lines are left out.
fn yaml(text: &str) -> Result<Parsed, DictionaryError> {
    let mut parsed = Parsed::default();
    for line in text.lines() {
        if let Some((key, value)) = line.split_once(':') {
            parsed.set(key.trim(), unquoted(value))?;
        }
    }
    Ok(parsed)
}

/// `<key>value</key>`; other elements are left out.
fn xml(text: &str) -> Result<Parsed, DictionaryError> {
    let mut parsed = Parsed::default();
    for element in text.split('<') {
        if let Some((key, value)) = element.split_once('>')
            && !key.starts_with(['/', '?', '!'])
        {
            parsed.set(key.trim(), unquoted(value))?;
        }
    }
    Ok(parsed)
}

fn unquoted(value: &str) -> &str {
    value.trim().trim_matches(['"', '\'']).trim()
}

/// A marker per line; blank lines and what follows a `#` are left out, and so are spaces between bits.
fn list(text: &str) -> Result<Parsed, DictionaryError> {
    let mut parsed = Parsed::default();
    for (number, line) in text.lines().enumerate() {
        let bits = line.split('#').next().unwrap_or_default();
        let bits: String = bits.chars().filter(|c| !c.is_whitespace()).collect();
        if bits.is_empty() {
            continue;
        }
        let side = bits.len().isqrt();
        if side * side != bits.len() || !bits.bytes().all(|b| b"01".contains(&b)) {
            return Err(DictionaryError::Key {
                key: format!("line {}", number + 1),
                reason: "expected the bits of a square marker, row by row, as digits 0 and 1"
                    .to_owned(),
            });
        }
        parsed.set(&format!("marker_{}", parsed.markers.len()), &bits)?;
    }
    Ok(parsed)
}

#[cfg(test)]
mod tests;
