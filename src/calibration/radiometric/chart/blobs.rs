//! Uniform regions of a picture with the shape of a parallelogram.

use super::level::Level;
use glam::{DMat2, DVec2};

/// A region, in pixels of the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blob {
    pub centre: DVec2,
    /// Second central moments Σ.
    pub spread: DMat2,
    /// Area A, pixels.
    pub area: f64,
    /// A² / (144 det Σ): 1 for a parallelogram.
    fullness: f64,
}

/// Roughness, codes, below which neighbours belong to one region: all are tried, as it depends on the
/// chart's brightness and noise.
const THRESHOLDS: [f32; 8] = [1.2, 2.0, 3.0, 4.5, 6.5, 9.0, 13.0, 20.0];
/// Minimum area, pixels of the level.
const MIN_PIXELS: usize = 9;
/// Maximum area, relative to the level.
const MAX_AREA: f64 = 0.05;
/// Range of [`Blob::fullness`].
const FULLNESS: std::ops::Range<f64> = 0.86..1.16;
/// Maximum ratio of the long side to the short side.
const MAX_ASPECT: f64 = 4.0;

/// Returns the regions found at any threshold, without duplicates.
pub(super) fn blobs(level: &Level) -> Vec<Blob> {
    let rough = level.roughness();
    let mut found: Vec<Blob> = Vec::new();
    let mut seen = vec![0u32; rough.len()];
    let mut mark = 0;
    let mut stack = Vec::new();
    for threshold in THRESHOLDS {
        mark += 1;
        for start in 0..rough.len() {
            if rough[start] >= threshold || seen[start] == mark {
                continue;
            }
            seen[start] = mark;
            stack.push(start);
            if let Some(blob) = grow(level, &rough, threshold, &mut seen, mark, &mut stack) {
                found.push(blob);
            }
        }
    }
    without_duplicates(found)
}

/// Sums over a connected region.
#[derive(Default)]
struct Moments {
    count: f64,
    sum: DVec2,
    squares: [f64; 3],
}

impl Moments {
    fn add(&mut self, p: DVec2) {
        self.count += 1.0;
        self.sum += p;
        self.squares[0] += p.x * p.x;
        self.squares[1] += p.x * p.y;
        self.squares[2] += p.y * p.y;
    }

    fn blob(&self, level: &Level) -> Option<Blob> {
        let n = self.count;
        let mean = self.sum / n;
        // 1/12 is the second moment of a pixel's square.
        let xx = self.squares[0] / n - mean.x * mean.x + 1.0 / 12.0;
        let xy = self.squares[1] / n - mean.x * mean.y;
        let yy = self.squares[2] / n - mean.y * mean.y + 1.0 / 12.0;
        let determinant = xx * yy - xy * xy;
        let fullness = n * n / (144.0 * determinant);
        let (half, difference) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let slim = (half + difference) > MAX_ASPECT * MAX_ASPECT * (half - difference);
        if !FULLNESS.contains(&fullness) || slim {
            return None;
        }
        let f2 = (level.factor * level.factor) as f64;
        Some(Blob {
            centre: level.to_picture(mean),
            spread: DMat2::from_cols_array(&[xx, xy, xy, yy]) * f2,
            area: n * f2,
            fullness,
        })
    }
}

fn grow(
    level: &Level,
    rough: &[f32],
    threshold: f32,
    seen: &mut [u32],
    mark: u32,
    stack: &mut Vec<usize>,
) -> Option<Blob> {
    let width = level.width;
    let mut moments = Moments::default();
    while let Some(i) = stack.pop() {
        moments.add(DVec2::new((i % width) as f64, (i / width) as f64));
        // The border pixels have maximum roughness, so that these indices are valid neighbours.
        for next in [i - 1, i + 1, i - width, i + width] {
            if rough[next] < threshold && seen[next] != mark {
                seen[next] = mark;
                stack.push(next);
            }
        }
    }
    let largest = MAX_AREA * rough.len() as f64;
    (moments.count >= MIN_PIXELS as f64 && moments.count <= largest)
        .then(|| moments.blob(level))
        .flatten()
}

/// Of overlapping regions, keeps the largest with a fullness near 1.
fn without_duplicates(mut found: Vec<Blob>) -> Vec<Blob> {
    let score = |b: &Blob| b.area * (1.0 - 4.0 * (b.fullness - 1.0).abs());
    found.sort_by(|a, b| score(b).total_cmp(&score(a)));
    let mut kept: Vec<Blob> = Vec::new();
    for blob in found {
        let near = |k: &Blob| k.centre.distance_squared(blob.centre) < 0.1 * k.area.min(blob.area);
        if !kept.iter().any(near) {
            kept.push(blob);
        }
    }
    kept
}
