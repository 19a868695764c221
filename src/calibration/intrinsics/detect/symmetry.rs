//! Refines a corner of a tag board, about which its surroundings are point-symmetric.

use super::Grey;
use super::refine::WINDOW;
use glam::{DMat2, DVec2};

/// Half the baseline of a gradient, pixels.
const GRADIENT_STEP: f64 = 0.5;
/// Maximum number of iterations.
const MAX_ITERATIONS: usize = 20;
/// Step at which the iteration has converged, pixels.
const MIN_STEP: f64 = 1e-3;

/// Centre of symmetry of brightness, and the remaining asymmetry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Centre {
    /// Pixel.
    pub at: DVec2,
    /// Squared difference of opposite points as a share of the variance: 0 for an isolated crossing
    /// of edges, 1 where opposite sides are uncorrelated.
    pub asymmetry: f64,
}

/// Sums over the pairs of opposite points in a window.
#[derive(Default)]
struct Sums {
    normal: DMat2,
    right: DVec2,
    odd: f64,
    weights: f64,
    sum: f64,
    squares: f64,
}

/// Returns the point c near `start` that minimises Σ w (I(c + d) − I(c − d))² over a window of
/// `radius` pixels (Gauss–Newton). A crossing of edges is such a point, also with marker borders on
/// both sides, which Förstner's operator mistakes for edges of the crossing where squares are
/// small. Affine maps preserve it. `None` if it is undetermined or outside the window.
pub(super) fn centre(picture: &Grey, start: DVec2, radius: f64) -> Option<Centre> {
    let radius = radius.clamp(WINDOW.0, WINDOW.1);
    let mut at = start;
    for _ in 0..MAX_ITERATIONS {
        if !picture.contains(at, radius.min(4.0)) || at.distance(start) > radius {
            return None;
        }
        let sums = sums(picture, at, radius);
        let trace = sums.normal.x_axis.x + sums.normal.y_axis.y;
        // A single edge does not determine the position along itself.
        if sums.normal.determinant() <= 1e-3 * trace * trace {
            return None;
        }
        let step = sums.normal.inverse() * -sums.right;
        at += step.clamp_length_max(0.3 * radius);
        if step.length() < MIN_STEP {
            break;
        }
    }
    let sums = sums(picture, at, radius);
    let variance = sums.squares - sums.sum * sums.sum / sums.weights.max(1e-12);
    let asymmetry = sums.odd / variance.max(1e-12);
    Some(Centre { at, asymmetry })
}

fn sums(picture: &Grey, at: DVec2, radius: f64) -> Sums {
    let reach = radius.floor() as i32;
    let mut sums = Sums::default();
    for y in 0..=reach {
        for x in -reach..=reach {
            let offset = DVec2::new(f64::from(x), f64::from(y));
            let inside = 1.0 - offset.length_squared() / (radius * radius);
            // Each pair is counted once.
            if inside > 0.0 && (y > 0 || x > 0) {
                add(
                    &mut sums,
                    picture,
                    (at + offset, at - offset),
                    inside * inside,
                );
            }
        }
    }
    sums
}

fn add(sums: &mut Sums, picture: &Grey, (one, other): (DVec2, DVec2), weight: f64) {
    let (a, b) = (picture.sample(one), picture.sample(other));
    let slope = gradient(picture, one) - gradient(picture, other);
    sums.normal += DMat2::from_cols(slope * slope.x, slope * slope.y) * weight;
    sums.right += slope * (weight * (a - b));
    sums.odd += weight * (a - b).powi(2);
    sums.weights += 2.0 * weight;
    sums.sum += weight * (a + b);
    sums.squares += weight * (a * a + b * b);
}

fn gradient(picture: &Grey, p: DVec2) -> DVec2 {
    let along =
        |by: DVec2| (picture.sample(p + by) - picture.sample(p - by)) / (2.0 * GRADIENT_STEP);
    DVec2::new(
        along(DVec2::X * GRADIENT_STEP),
        along(DVec2::Y * GRADIENT_STEP),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Renders two edges that cross at `at`, with dark squares like markers on both sides if
    /// `markers`, occluded to the right of `occluder`.
    fn rendered(at: DVec2, markers: bool, occluder: f64) -> Grey {
        let soft = |v: f64| (v + 0.5).clamp(0.0, 1.0);
        let mut picture = Grey::from_bytes(40, 40, &[]);
        for y in 0..40 {
            for x in 0..40 {
                let d = DVec2::new(x as f64, y as f64) - at;
                let (u, v) = (d.x + 0.2 * d.y, d.y - 0.1 * d.x);
                let white = soft(u) * soft(v) + soft(-u) * soft(-v);
                let marker = |u: f64, v: f64| soft(u - 3.0) * soft(v - 3.0);
                let marked = if markers {
                    marker(u, v) + marker(-u, -v)
                } else {
                    0.0
                };
                let value = 30.0 + 180.0 * (white - marked).clamp(0.0, 1.0);
                let value = if x as f64 > occluder { 120.0 } else { value };
                picture.data[y * 40 + x] = value as f32;
            }
        }
        picture.blurred(1.3)
    }

    #[test]
    fn markers_do_not_bias_corner_and_occlusion_is_detected() {
        for markers in [false, true] {
            let at = DVec2::new(19.3, 20.6);
            let picture = rendered(at, markers, 100.0);
            let found = centre(&picture, at + DVec2::new(0.9, -0.6), 5.0).unwrap();
            assert!(found.at.distance(at) < 0.04, "{found:?}");
            assert!(found.asymmetry < 0.01, "{found:?}");
            let occluded = centre(&rendered(at, markers, 21.0), at, 5.0);
            assert!(occluded.is_none_or(|c| c.asymmetry > 0.1), "{occluded:?}");
        }
    }
}
