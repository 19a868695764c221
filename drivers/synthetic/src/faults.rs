//! Faults of a simulated line.

use thiserror::Error;

/// Faults of a simulated line. Rates are per byte; seconds count from the start.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults {
    /// Bytes are written a few at a time.
    pub split: bool,
    /// Rate of lost bytes.
    pub drop: f64,
    /// Rate of bytes with one bit flipped.
    pub flip: f64,
    /// Rate of inserted bytes.
    pub insert: f64,
    /// Seconds after which the device is silent.
    pub silent_after: Option<f64>,
    /// Seconds after which the device hangs up.
    pub hang_up_after: Option<f64>,
    /// State of the random numbers.
    state: u64,
}

/// The name of a fault is unknown, or its number is not one.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "{text:?} is not a fault; the faults are split, drop=RATE, flip=RATE, insert=RATE, \
     silent-after=SECONDS, hang-up-after=SECONDS, separated by commas"
)]
pub struct FaultsError {
    /// The text.
    pub text: String,
}

impl Faults {
    /// Parses text such as `split,drop=0.001,silent-after=5`.
    ///
    /// # Errors
    /// A name is unknown, or a number is not one.
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

    /// Applies the faults to the bytes of one delivery.
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

    /// How many of `len` bytes to write at once.
    pub(crate) fn write_len(&mut self, len: usize) -> usize {
        if self.split {
            len.min(1 + (self.random() % 7) as usize)
        } else {
            len
        }
    }

    fn chance(&mut self, rate: f64) -> bool {
        rate > 0.0 && (self.random() as f64 / u64::MAX as f64) < rate
    }

    /// splitmix64 from a fixed seed, so that a failure can be reproduced.
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
    use super::*;

    #[test]
    fn faults_are_parsed_and_unknown_ones_refused() {
        let faults = Faults::parse("split, drop=0.01,silent-after=5").unwrap();
        assert!(faults.split && faults.silent_after == Some(5.0));
        assert!((faults.drop - 0.01).abs() < 1e-12);
        for text in ["splat", "drop=x", "drop=-1"] {
            assert!(Faults::parse(text).unwrap_err().to_string().contains(text));
        }
    }

    #[test]
    fn faults_are_as_frequent_as_configured() {
        let mut faults = Faults::parse("drop=0.1,flip=0.1,insert=0.1").unwrap();
        let mut bytes = vec![0; 100_000];
        faults.damage(&mut bytes);
        let flipped = bytes.iter().filter(|byte| byte.count_ones() == 1).count();
        assert!((9_000..12_500).contains(&flipped), "{flipped}");
        assert!((99_000..102_000).contains(&bytes.len()), "{}", bytes.len());
    }
}
