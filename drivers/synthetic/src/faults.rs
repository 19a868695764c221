//! What can go wrong on a line.

use thiserror::Error;

/// Faults that a simulated line has. Rates are per byte; seconds count from the beginning.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults {
    /// Written in pieces of a few bytes.
    pub split: bool,
    /// Bytes lost.
    pub drop: f64,
    /// Bytes with one bit wrong.
    pub flip: f64,
    /// Bytes that nobody sent.
    pub insert: f64,
    /// Nothing is sent any more after so many seconds.
    pub silent_after: Option<f64>,
    /// The other end goes after so many seconds.
    pub hang_up_after: Option<f64>,
    state: u64,
}

/// A fault that there is not.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "{text:?} is no fault; there are split, drop=RATE, flip=RATE, insert=RATE, \
     silent-after=SECONDS, hang-up-after=SECONDS, parted by commas"
)]
pub struct FaultsError {
    /// What was written.
    pub text: String,
}

impl Faults {
    /// From text such as `split,drop=0.001,silent-after=5`.
    ///
    /// # Errors
    /// An unknown name, or a number that is none.
    pub fn parse(text: &str) -> Result<Self, FaultsError> {
        let mut faults = Self::default();
        for field in text
            .split(',')
            .map(str::trim)
            .filter(|field| !field.is_empty())
        {
            faults.set(field).ok_or_else(|| FaultsError {
                text: field.to_owned(),
            })?;
        }
        Ok(faults)
    }

    fn set(&mut self, field: &str) -> Option<()> {
        let (name, value) = field.split_once('=').unwrap_or((field, "1"));
        let value: f64 = value.parse().ok().filter(|value| *value >= 0.0)?;
        match name {
            "split" => self.split = value > 0.0,
            "drop" => self.drop = value,
            "flip" => self.flip = value,
            "insert" => self.insert = value,
            "silent-after" => self.silent_after = Some(value),
            "hang-up-after" => self.hang_up_after = Some(value),
            _ => return None,
        }
        Some(())
    }

    /// The bytes as the line delivers them.
    pub(crate) fn damage(&mut self, bytes: &mut Vec<u8>) {
        if self.drop + self.flip + self.insert <= 0.0 {
            return;
        }
        let mut damaged = Vec::with_capacity(bytes.len());
        for byte in bytes.iter().copied() {
            if self.chance(self.insert) {
                damaged.push((self.random() >> 8) as u8);
            }
            if self.chance(self.flip) {
                damaged.push(byte ^ (1 << (self.random() % 8)));
            } else if !self.chance(self.drop) {
                damaged.push(byte);
            }
        }
        *bytes = damaged;
    }

    /// How many of `len` bytes to write in one go.
    pub(crate) fn piece(&mut self, len: usize) -> usize {
        if self.split {
            len.min(1 + (self.random() % 7) as usize)
        } else {
            len
        }
    }

    fn chance(&mut self, rate: f64) -> bool {
        rate > 0.0 && (self.random() as f64 / u64::MAX as f64) < rate
    }

    /// splitmix64: the same faults every time, so that a failure can be repeated.
    fn random(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn faults_are_read_and_wrong_ones_named() {
        let faults = Faults::parse("split, drop=0.01,silent-after=5").unwrap();
        assert!(faults.split && faults.silent_after == Some(5.0));
        assert!((faults.drop - 0.01).abs() < 1e-12);
        for text in ["splat", "drop=x", "drop=-1"] {
            assert!(Faults::parse(text).unwrap_err().to_string().contains(text));
        }
    }

    #[test]
    fn damage_is_as_frequent_as_said() {
        let mut faults = Faults::parse("drop=0.1,flip=0.1,insert=0.1").unwrap();
        let mut bytes = vec![0; 100_000];
        faults.damage(&mut bytes);
        let flipped = bytes.iter().filter(|byte| byte.count_ones() == 1).count();
        assert!((9_000..12_500).contains(&flipped), "{flipped}");
        assert!((99_000..102_000).contains(&bytes.len()), "{}", bytes.len());
    }
}
