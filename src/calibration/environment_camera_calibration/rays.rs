//! Steps of brightness along rays from a middle, and the random numbers that choose among them.

use super::super::intrinsics::Grey;
use glam::DVec2;

/// Rays around a middle.
pub(super) const RAYS: usize = 720;

/// An edge may be slanted to a ray by this slope.
const ALONG: f64 = 0.6;

/// A step on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Which ray, 0 to [`RAYS`].
    pub ray: usize,
    /// Where, pixels.
    pub at: DVec2,
    /// How high, codes; what is towards the middle minus what is beyond.
    pub height: f64,
}

/// Direction of a ray.
pub(super) fn side(ray: usize) -> DVec2 {
    DVec2::from_angle(std::f64::consts::TAU * ray as f64 / RAYS as f64)
}

/// How to look for steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search {
    /// Nearest and farthest from the middle, pixels.
    pub reach: (f64, f64),
    /// Half the length over which a step is measured, pixels.
    pub half: f64,
    /// Lower ones are noise, codes.
    pub least: f64,
    /// On one ray, the outermost first.
    pub most: usize,
    /// Only from bright to dark, seen from the middle.
    pub falling: bool,
}

/// The steps on one ray that are higher than their neighbours. `planes` are colours of one
/// picture; their steps add up in magnitude unless only falling ones are wanted.
pub(super) fn steps(
    planes: &[&Grey],
    middle: DVec2,
    ray: usize,
    search: &Search,
    into: &mut Vec<Step>,
) {
    let Some(first) = planes.first() else { return };
    let direction = side(ray);
    let place = |i: usize| middle + direction * (search.reach.0 + i as f64);
    let count = (search.reach.1 - search.reach.0).max(0.0) as usize;
    let height = |i: usize| {
        let p = place(i);
        let margin = direction * search.half;
        if !first.contains(p + margin, 0.0) || !first.contains(p - margin, 0.0) {
            return 0.0;
        }
        let of = |g: &Grey| inner_less_outer(g, p, direction, search.half);
        if search.falling {
            planes.iter().map(|g| of(g)).sum::<f64>() / planes.len() as f64
        } else {
            planes.iter().map(|g| of(g).abs()).sum::<f64>() / planes.len() as f64
        }
    };
    // An edge that runs along the ray is no outline about the middle.
    let along = |i: usize| {
        let p = place(i);
        let side = direction.perp();
        let of = |g: &Grey| inner_less_outer(g, p, side, search.half).abs();
        planes.iter().map(|g| of(g)).sum::<f64>() / planes.len() as f64
    };
    let heights: Vec<f64> = (0..count).map(height).collect();
    let near = search.half.ceil() as usize;
    let mut found = 0;
    for i in (0..count).rev() {
        let (low, high) = (i.saturating_sub(near), (i + near).min(count - 1));
        let top =
            heights[i] >= search.least && heights[low..=high].iter().all(|h| *h <= heights[i]);
        if top && !(i > 0 && heights[i - 1] == heights[i]) && along(i) < ALONG * heights[i] {
            into.push(Step {
                ray,
                at: place(i),
                height: heights[i],
            });
            found += 1;
            if found == search.most {
                break;
            }
        }
    }
}

/// Mean over `half` pixels on either side of a place.
fn inner_less_outer(grey: &Grey, p: DVec2, direction: DVec2, half: f64) -> f64 {
    let across = direction.perp() * 0.7;
    [0.3, 0.65, 1.0]
        .iter()
        .map(|s| {
            let off = direction * (s * half);
            let mean = |q: DVec2| 0.5 * (grey.sample(q + across) + grey.sample(q - across));
            mean(p - off) - mean(p + off)
        })
        .sum::<f64>()
        / 3.0
}

/// Standard deviation of a picture's noise, codes: from how much pixels differ from their
/// neighbours' mean where the picture is smooth (the lower quartile).
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
    // The lower quartile of |x| of a normal x is 0.3186 σ; this x has √(5/4) times the noise.
    f64::from(quartile) / 0.3186 / 1.25_f64.sqrt()
}

/// Numbers to choose samples by: the same in every run (xorshift, Marsaglia 2003).
#[derive(Clone, Debug)]
pub(super) struct Dice(u64);

impl Dice {
    /// From the beginning.
    pub const fn new() -> Self {
        Self(0x9e37_79b9_7f4a_7c15)
    }

    /// Below `end`; 0 where that is 0.
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

/// Halves a picture until no side is longer than `most`; how often.
pub(super) fn shrunk(grey: &Grey, most: usize) -> (Grey, u32) {
    let (mut small, mut times) = (grey.clone(), 0);
    while small.width.max(small.height) > most {
        small = small.halved();
        times += 1;
    }
    (small, times)
}

/// Tukey's biweight: 1 in the middle, 0 from ±1 on.
pub(super) fn tukey(x: f64) -> f64 {
    let rest = (1.0 - x * x).max(0.0);
    rest * rest
}
