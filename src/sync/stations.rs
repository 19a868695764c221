//! A set of a tracker's stations.

use serde::{Serialize, Serializer};
use std::fmt;

/// Stations of a tracker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stations([u64; 4]);

impl Stations {
    /// Adds a station.
    pub fn insert(&mut self, station: u8) {
        if let Some(word) = self.0.get_mut(usize::from(station / 64)) {
            *word |= 1 << (station % 64);
        }
    }

    /// The stations, in order.
    pub fn iter(&self) -> impl Iterator<Item = u8> + '_ {
        let is_in = |s: &u8| self.0[usize::from(s / 64)] >> (s % 64) & 1 == 1;
        (0..=u8::MAX).filter(is_in)
    }
}

/// The first numbers, e.g. `2, 3`.
impl fmt::Display for Stations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MAX_NAMED: usize = 8;
        for (i, station) in self.iter().take(MAX_NAMED).enumerate() {
            let separator = if i == 0 { "" } else { ", " };
            write!(f, "{separator}{station}")?;
        }
        let is_long = self.iter().nth(MAX_NAMED).is_some();
        f.write_str(if is_long { ", …" } else { "" })
    }
}

impl Serialize for Stations {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.iter())
    }
}

#[cfg(test)]
mod tests {
    use super::Stations;

    #[test]
    fn lists_stations_in_order() {
        let mut stations = Stations::default();
        [200, 2, 64, 2].into_iter().for_each(|s| stations.insert(s));
        assert_eq!(stations.iter().collect::<Vec<_>>(), [2, 64, 200]);
        assert_eq!(stations.to_string(), "2, 64, 200");
        (0..=255).for_each(|s| stations.insert(s));
        assert_eq!(stations.to_string(), "0, 1, 2, 3, 4, 5, 6, 7, …");
    }
}
