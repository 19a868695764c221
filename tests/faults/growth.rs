//! Memory, threads and descriptors of this process over a run.

use serde::Serialize;
use std::fs;

/// Growth of memory that is noise, share of the memory after the first rounds.
const MAX_MEMORY_GROWTH: f64 = 0.01;
/// Rounds from which growth can be told from noise.
const MIN_ROUNDS: usize = 20;

/// What the process uses at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Usage {
    kilobytes: u64,
    threads: usize,
    descriptors: usize,
}

impl Usage {
    /// Returns what this process uses now; zeros on systems without `/proc`.
    pub fn now() -> Self {
        let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"));
        let kilobytes = line.and_then(|l| l.trim().strip_suffix(" kB")?.parse().ok());
        let count = |path: &str| fs::read_dir(path).map_or(0, Iterator::count);
        Self {
            kilobytes: kilobytes.unwrap_or(0),
            threads: count("/proc/self/task"),
            descriptors: count("/proc/self/fd"),
        }
    }
}

/// How much more the process uses at the end.
#[derive(Default, Serialize)]
pub struct Growth {
    rounds: usize,
    /// Memory by the regression line at its beginning and end, megabytes; without the first fifth
    /// of the rounds, which fills caches.
    memory_mb: [f64; 2],
    /// Largest number in the first half and in the second half of the other rounds.
    threads: [usize; 2],
    /// Likewise.
    descriptors: [usize; 2],
}

impl Growth {
    pub fn of(usage: &[Usage]) -> Self {
        let warm = &usage[usage.len() / 5..];
        let (first, second) = warm.split_at(warm.len().div_ceil(2));
        let most = |count: fn(&Usage) -> usize| {
            [first, second].map(|half| half.iter().map(count).max().unwrap_or(0))
        };
        Self {
            rounds: usage.len(),
            memory_mb: line(warm),
            threads: most(|u| u.threads),
            descriptors: most(|u| u.descriptors),
        }
    }

    /// Returns what has grown.
    pub fn failure(&self) -> Option<String> {
        let [first, last] = self.memory_mb;
        let has_grown = last > first * (1.0 + MAX_MEMORY_GROWTH);
        let more = |[first, last]: [usize; 2]| last > first;
        let is_long = self.rounds >= MIN_ROUNDS;
        let grows = is_long && (has_grown || more(self.threads) || more(self.descriptors));
        grows.then(|| {
            format!(
                "memory {first:.1} to {last:.1} MB, threads {:?}, descriptors {:?}",
                self.threads, self.descriptors
            )
        })
    }
}

/// The ends of the regression line through the memory.
fn line(usage: &[Usage]) -> [f64; 2] {
    let n = usage.len() as f64;
    let memory: Vec<f64> = usage.iter().map(|u| u.kilobytes as f64 / 1024.0).collect();
    let mean = memory.iter().sum::<f64>() / n;
    let middle = (n - 1.0) / 2.0;
    let offsets = || (0..usage.len()).map(|i| i as f64 - middle);
    let squares: f64 = offsets().map(|x| x * x).sum();
    let products: f64 = offsets().zip(&memory).map(|(x, m)| x * (m - mean)).sum();
    let slope = if squares > 0.0 {
        products / squares
    } else {
        0.0
    };
    [mean - slope * middle, mean + slope * middle]
}
