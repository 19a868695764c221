//! Even patches of a picture that have a parallelogram's shape.

use super::level::Level;
use glam::{DMat2, DVec2};

/// One of them, in pixels of the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blob {
    pub centre: DVec2,
    /// Second moments about the centre.
    pub spread: DMat2,
    /// Pixels of the picture.
    pub area: f64,
    /// Near 1 for a parallelogram: A² / (144 det Σ).
    fullness: f64,
}

/// Roughness, codes, below which neighbours belong together: a dark or noisy chart needs another
/// than a bright one, so all are tried.
const THRESHOLDS: [f32; 8] = [1.2, 2.0, 3.0, 4.5, 6.5, 9.0, 13.0, 20.0];
/// Pixels of the level.
const SMALLEST: usize = 9;
/// Share of the level.
const LARGEST: f64 = 0.05;
/// Of [`Blob::fullness`].
const FULLNESS: std::ops::Range<f64> = 0.86..1.16;
/// Long side over short side.
const LONGEST: f64 = 4.0;

/// All that are found at any threshold, each once.
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
    each_once(found)
}

/// Sums over a connected part.
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
        // A pixel is a square of its own, hence the twelfth.
        let xx = self.squares[0] / n - mean.x * mean.x + 1.0 / 12.0;
        let xy = self.squares[1] / n - mean.x * mean.y;
        let yy = self.squares[2] / n - mean.y * mean.y + 1.0 / 12.0;
        let determinant = xx * yy - xy * xy;
        let fullness = n * n / (144.0 * determinant);
        let (half, difference) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let slim = (half + difference) > LONGEST * LONGEST * (half - difference);
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
        // The outermost pixels are rough for lack of neighbours, so that none of these is
        // outside or around the edge.
        for next in [i - 1, i + 1, i - width, i + width] {
            if rough[next] < threshold && seen[next] != mark {
                seen[next] = mark;
                stack.push(next);
            }
        }
    }
    let largest = LARGEST * rough.len() as f64;
    (moments.count >= SMALLEST as f64 && moments.count <= largest)
        .then(|| moments.blob(level))
        .flatten()
}

/// Of those about one place, the largest that is nearly as full as the fullest.
fn each_once(mut found: Vec<Blob>) -> Vec<Blob> {
    let worth = |b: &Blob| b.area * (1.0 - 4.0 * (b.fullness - 1.0).abs());
    found.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
    let mut kept: Vec<Blob> = Vec::new();
    for blob in found {
        let near = |k: &Blob| k.centre.distance_squared(blob.centre) < 0.1 * k.area.min(blob.area);
        if !kept.iter().any(near) {
            kept.push(blob);
        }
    }
    kept
}
