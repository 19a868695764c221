//! Steps of brightness along rays from a centre, and random numbers for sampling them.

use super::super::intrinsics::Grey;
use glam::DVec2;

/// Number of rays around a centre.
pub(super) const RAYS: usize = 720;

/// Maximum ratio of the step along the edge to the step across it: edges that are slanted to the ray.
const MAX_SLANT: f64 = 0.6;

/// A step of brightness on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgeStep {
    /// Index of the ray, 0 to [`RAYS`].
    pub ray: usize,
    /// Position, pixels.
    pub at: DVec2,
    /// Inner minus outer brightness, codes.
    pub height: f64,
}

/// Returns the direction of a ray.
pub(super) fn side(ray: usize) -> DVec2 {
    DVec2::from_angle(std::f64::consts::TAU * ray as f64 / RAYS as f64)
}

/// Parameters of the search for steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search {
    /// Minimum and maximum distance from the centre, pixels.
    pub reach: (f64, f64),
    /// Half the length over which a step is measured, pixels.
    pub half: f64,
    /// Minimum height, codes: lower steps are noise.
    pub min_height: f64,
    /// Maximum number on one ray, the outermost first.
    pub max_count: usize,
    /// Whether only steps from bright to dark are found, seen from the centre.
    pub falling: bool,
}

/// Finds the steps on one ray that are local maxima of height. `planes` are the colour channels of
/// one picture; the magnitudes of their steps are averaged unless only falling ones are wanted.
pub(super) fn steps(
    planes: &[&Grey],
    centre: DVec2,
    ray: usize,
    search: &Search,
    into: &mut Vec<EdgeStep>,
) {
    let Some(first) = planes.first() else { return };
    let direction = side(ray);
    let point = |i: usize| centre + direction * (search.reach.0 + i as f64);
    let count = (search.reach.1 - search.reach.0).max(0.0) as usize;
    let height = |i: usize| {
        let p = point(i);
        let margin = direction * search.half;
        if !first.contains(p + margin, 0.0) || !first.contains(p - margin, 0.0) {
            return 0.0;
        }
        let step = |g: &Grey| inner_less_outer(g, p, direction, search.half);
        if search.falling {
            planes.iter().map(|g| step(g)).sum::<f64>() / planes.len() as f64
        } else {
            planes.iter().map(|g| step(g).abs()).sum::<f64>() / planes.len() as f64
        }
    };
    // An edge along the ray is not part of an outline about the centre.
    let along = |i: usize| {
        let p = point(i);
        let side = direction.perp();
        let step = |g: &Grey| inner_less_outer(g, p, side, search.half).abs();
        planes.iter().map(|g| step(g)).sum::<f64>() / planes.len() as f64
    };
    let heights: Vec<f64> = (0..count).map(height).collect();
    let near = search.half.ceil() as usize;
    let mut found = 0;
    for i in (0..count).rev() {
        let (low, high) = (i.saturating_sub(near), (i + near).min(count - 1));
        let top =
            heights[i] >= search.min_height && heights[low..=high].iter().all(|h| *h <= heights[i]);
        if top && !(i > 0 && heights[i - 1] == heights[i]) && along(i) < MAX_SLANT * heights[i] {
            into.push(EdgeStep {
                ray,
                at: point(i),
                height: heights[i],
            });
            found += 1;
            if found == search.max_count {
                break;
            }
        }
    }
}

/// Returns the mean over `half` pixels inside minus that outside of a point.
fn inner_less_outer(grey: &Grey, p: DVec2, direction: DVec2, half: f64) -> f64 {
    let across = direction.perp() * 0.7;
    [0.3, 0.65, 1.0]
        .iter()
        .map(|s| {
            let offset = direction * (s * half);
            let mean = |q: DVec2| 0.5 * (grey.sample(q + across) + grey.sample(q - across));
            mean(p - offset) - mean(p + offset)
        })
        .sum::<f64>()
        / 3.0
}

/// Returns the standard deviation of a picture's noise, codes, from the deviations of pixels from the
/// mean of their neighbours where the picture is smooth (the lower quartile).
pub(super) fn noise(grey: &Grey) -> f64 {
    let (w, h) = (grey.width, grey.height);
    let stride = (w * h / 20_000).max(1);
    let mut rough: Vec<f32> = (0..w * h)
        .step_by(stride)
        .filter(|i| (1..w - 1).contains(&(i % w)) && (1..h.max(2) - 1).contains(&(i / w)))
        .map(|i| {
            let d = &grey.data;
            (d[i] - 0.25 * (d[i - 1] + d[i + 1] + d[i - w] + d[i + w])).abs()
        })
        .collect();
    rough.sort_unstable_by(f32::total_cmp);
    let quartile = rough.get(rough.len() / 4).copied().unwrap_or(0.0);
    // The lower quartile of |x| of a normal x is 0.3186 σ; here x has √(5/4) times the noise.
    f64::from(quartile) / 0.3186 / 1.25_f64.sqrt()
}

/// Reproducible random indices for sampling (xorshift, Marsaglia 2003).
#[derive(Clone, Debug)]
pub(super) struct RandomIndices(u64);

impl RandomIndices {
    /// Creates the generator with its fixed seed.
    pub const fn new() -> Self {
        Self(0x9e37_79b9_7f4a_7c15)
    }

    /// Returns an index below `end`; 0 if `end` is 0.
    pub const fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        if end == 0 {
            0
        } else {
            (self.0 >> 11) as usize % end
        }
    }
}

/// Halves a picture until no side is longer than `max_side`; returns it and the number of halvings.
pub(super) fn shrunk(grey: &Grey, max_side: usize) -> (Grey, u32) {
    let (mut small, mut times) = (grey.clone(), 0);
    while small.width.max(small.height) > max_side {
        small = small.halved();
        times += 1;
    }
    (small, times)
}
