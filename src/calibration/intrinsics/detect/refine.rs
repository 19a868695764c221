//! Refines a corner to subpixel accuracy.

use super::Grey;
use glam::{DMat2, DVec2};

/// Minimum and maximum radius of the window, pixels.
pub(super) const WINDOW: (f64, f64) = (3.0, 14.0);

// ┌ Every gradient g(p) near a corner q is normal to an edge through q: g · (p − q) = 0. ┐
// │ (Σ w g gᵀ) q = Σ w g gᵀ p,  w = (1 − |p − q|² / R²)²                                 │
// └ (Förstner & Gülch 1987; OpenCV's cornerSubPix)                                       ┘
//
/// Returns the crossing of the edges near `start` within a window of `radius` pixels, which should
/// not reach the next corner's edges. `None` if no edges cross there.
///
/// Gradients are evaluated at pixels and only the weights move with q: interpolated gradients would
/// bias corners towards pixel centres.
pub(super) fn refine(picture: &Grey, start: DVec2, radius: f64) -> Option<DVec2> {
    let radius = radius.clamp(WINDOW.0, WINDOW.1);
    let mut at = start;
    for _ in 0..30 {
        if !picture.contains(at, radius.min(4.0)) || at.distance(start) > radius {
            return None;
        }
        let step = step(picture, at, radius)?;
        at += step.clamp_length_max(0.5 * radius);
        if step.length() < 2e-4 {
            break;
        }
    }
    Some(at)
}

fn step(picture: &Grey, at: DVec2, radius: f64) -> Option<DVec2> {
    let (low, high) = ((at - radius).ceil(), (at + radius).floor());
    let (mut a, mut b) = (DMat2::ZERO, DVec2::ZERO);
    for y in low.y as isize..=high.y as isize {
        for x in low.x as isize..=high.x as isize {
            let offset = DVec2::new(x as f64, y as f64) - at;
            let inside = 1.0 - offset.length_squared() / (radius * radius);
            if inside > 0.0 {
                let g = gradient(picture, x, y);
                let ggt = DMat2::from_cols(g * g.x, g * g.y) * (inside * inside);
                a += ggt;
                b += ggt * offset;
            }
        }
    }
    // A single edge does not determine the position along itself.
    let trace = a.x_axis.x + a.y_axis.y;
    (a.determinant() > 1e-3 * trace * trace).then(|| a.inverse() * b)
}

fn gradient(picture: &Grey, x: isize, y: isize) -> DVec2 {
    let across = picture.at(x + 1, y) - picture.at(x - 1, y);
    let down = picture.at(x, y + 1) - picture.at(x, y - 1);
    DVec2::new(f64::from(across), f64::from(down))
}
