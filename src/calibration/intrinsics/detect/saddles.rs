//! Crossings of two edges: saddle points of brightness whose surroundings have four sectors,
//! alternately dark and bright.

use super::Grey;
use glam::DVec2;
use std::f64::consts::{PI, TAU};

/// A crossing of two edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Saddle {
    /// Pixel.
    pub at: DVec2,
    /// Directions of the four edges, radians, ascending (from +X right to +Y down), within one
    /// revolution from the first.
    pub edges: [f64; 4],
    /// The sector between the first and the second edge is bright.
    pub is_first_bright: bool,
    /// Mean difference between bright and dark sectors, codes.
    pub contrast: f64,
}

/// Scale at which saddles are searched, pixels.
const SIGMA: f32 = 1.5;
/// Maximum number of candidates; the strongest are kept.
const MAX_CANDIDATES: usize = 6000;
/// Samples per ring.
const SAMPLES: usize = 36;
/// Minimum difference between bright and dark, codes.
const MIN_CONTRAST: f64 = 5.0;
/// Maximum angle between the two halves of one edge, radians.
const MAX_BEND: f64 = 0.45;
/// Minimum angle between crossing edges, radians; below it they look like one line.
const MIN_ANGLE: f64 = 0.3;

/// Returns all crossings, strongest first.
pub(super) fn find(picture: &Grey) -> Vec<Saddle> {
    if picture.width < 16 || picture.height < 16 {
        return Vec::new();
    }
    let smooth = picture.blurred(SIGMA);
    let mut candidates = maxima(&smooth);
    candidates.sort_by(|a, b| b.1.total_cmp(&a.1));
    candidates.truncate(MAX_CANDIDATES);
    let light = picture.blurred(0.7);
    let mut saddles: Vec<Saddle> = candidates
        .iter()
        .filter_map(|&(at, _)| examine(&light, at))
        .collect();
    saddles.sort_by(|a, b| b.contrast.total_cmp(&a.contrast));
    saddles
}

/// Returns the local maxima of −det of the Hessian, refined to the saddle of the local quadric.
fn maxima(smooth: &Grey) -> Vec<(DVec2, f32)> {
    let (w, h) = (smooth.width, smooth.height);
    let mut strength = vec![0.0_f32; w * h];
    for y in 2..h - 2 {
        for x in 2..w - 2 {
            let [xx, yy, xy] = hessian(smooth, x, y);
            strength[y * w + x] = (xy * xy - xx * yy).max(0.0);
        }
    }
    let mut out = Vec::new();
    for y in 4..h - 4 {
        for x in 4..w - 4 {
            let s = strength[y * w + x];
            if s > 0.05
                && is_peak(&strength, w, x, y, s)
                && let Some(offset) = quadric_saddle(smooth, x, y)
            {
                out.push((DVec2::new(x as f64, y as f64) + offset, s));
            }
        }
    }
    out
}

fn is_peak(strength: &[f32], w: usize, x: usize, y: usize, s: f32) -> bool {
    (y - 2..=y + 2).all(|j| {
        (x - 2..=x + 2).all(|i| {
            let other = strength[j * w + i];
            // Of two equal values the first in scan order is the peak.
            other < s || (other == s && (j, i) >= (y, x))
        })
    })
}

fn hessian(g: &Grey, x: usize, y: usize) -> [f32; 3] {
    let at = |i: usize, j: usize| g.data[j * g.width + i];
    let xx = at(x + 1, y) - 2.0 * at(x, y) + at(x - 1, y);
    let yy = at(x, y + 1) - 2.0 * at(x, y) + at(x, y - 1);
    let xy = 0.25 * (at(x + 1, y + 1) + at(x - 1, y - 1) - at(x - 1, y + 1) - at(x + 1, y - 1));
    [xx, yy, xy]
}

/// Returns the offset of the local quadric's stationary point, if it is below 1.5 pixels.
fn quadric_saddle(g: &Grey, x: usize, y: usize) -> Option<DVec2> {
    let at = |i: usize, j: usize| f64::from(g.data[j * g.width + i]);
    let [xx, yy, xy] = hessian(g, x, y).map(f64::from);
    let gx = 0.5 * (at(x + 1, y) - at(x - 1, y));
    let gy = 0.5 * (at(x, y + 1) - at(x, y - 1));
    let det = xx * yy - xy * xy;
    let offset = DVec2::new(xy * gy - yy * gx, xy * gx - xx * gy) / det;
    (offset.length() < 1.5).then_some(offset)
}

/// Examines a candidate on rings of several radii: large rings suit blurred corners and large
/// squares, small rings small squares.
pub(super) fn examine(picture: &Grey, at: DVec2) -> Option<Saddle> {
    [5.0, 3.5, 2.5, 7.0]
        .into_iter()
        .filter(|&radius| picture.contains(at, radius))
        .find_map(|radius| ring(picture, at, radius))
}

fn ring(picture: &Grey, at: DVec2, radius: f64) -> Option<Saddle> {
    let angle = |i: usize| i as f64 * TAU / SAMPLES as f64;
    let mut values = [0.0; SAMPLES];
    for (i, value) in values.iter_mut().enumerate() {
        *value = picture.sample(at + DVec2::from_angle(angle(i)) * radius);
    }
    let (low, high) = values
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
    // The middle of the extremes, not the mean, because sectors are seldom equally wide.
    let middle = 0.5 * (low + high);
    let mut edges = [0.0; 4];
    let mut rising = [false; 4];
    let mut found = 0;
    for i in 0..SAMPLES {
        let (a, b) = (values[i] - middle, values[(i + 1) % SAMPLES] - middle);
        if (a < 0.0) != (b < 0.0) {
            if found == 4 {
                return None;
            }
            edges[found] = angle(i) + a / (a - b) * TAU / SAMPLES as f64;
            rising[found] = b >= a;
            found += 1;
        }
    }
    if found < 4 {
        return None;
    }
    let contrast = sector_contrast(&values, middle);
    let saddle = Saddle {
        at,
        edges,
        is_first_bright: rising[0],
        contrast,
    };
    (contrast > MIN_CONTRAST.max(0.35 * (high - low)) && is_cross(&edges)).then_some(saddle)
}

/// Returns the difference between the means of the values above and below the middle.
fn sector_contrast(values: &[f64], middle: f64) -> f64 {
    let mean = |keep: &dyn Fn(f64) -> bool| {
        let kept: Vec<f64> = values.iter().copied().filter(|&v| keep(v)).collect();
        kept.iter().sum::<f64>() / kept.len().max(1) as f64
    };
    mean(&|v| v >= middle) - mean(&|v| v < middle)
}

/// Returns whether opposite edges form straight lines and neighbouring edges are distinct.
fn is_cross(edges: &[f64; 4]) -> bool {
    let straight = |a: f64, b: f64| (wrapped(b - a).abs() - PI).abs() < MAX_BEND;
    let apart = (0..4).all(|i| {
        let gap = wrapped(edges[(i + 1) % 4] - edges[i]).abs();
        gap > MIN_ANGLE
    });
    apart && straight(edges[0], edges[2]) && straight(edges[1], edges[3])
}

/// Returns an angle wrapped to −π to π.
pub(super) fn wrapped(angle: f64) -> f64 {
    let positive = angle.rem_euclid(TAU);
    if positive > PI {
        positive - TAU
    } else {
        positive
    }
}
