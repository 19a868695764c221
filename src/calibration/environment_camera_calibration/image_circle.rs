//! The image circle of a fisheye: the boundary between its picture and the black around it.
//!
//! ```text
//!  Rays from the centre of the frame meet steps from bright to dark; three steps define a circle, and
//!  the circle that most steps lie on, one per ray, is chosen (RANSAC, Fischler & Bolles 1981): edges
//!  within the picture do not lie on one circle, and flare or dark parts of the edge leave the rest of
//!  it. Then each ray determines in linear light the position of its step,
//!      r(φ) = R − reach + ∫ (I(r) − I_out)/(I_in − I_out) dr,
//!  independent of the blur, and by robust least squares
//!      r(φ) = R + x cos φ + y sin φ + a cos 2φ + b sin 2φ.
//!  x, y correct the centre and converge to zero; a, b indicate a stretched picture.
//! ```

mod search;

use super::super::intrinsics::Grey;
use super::rays::{RAYS, shrunk, side};
use glam::DVec2;
use penumbra_numerics::{Matrix, median, median_absolute, tukey_weight};
use search::search;

/// Maximum side of the picture in which the circle is searched, pixels.
const SEARCH_SIDE: usize = 640;
/// Minimum share of the visible rays that must show the edge.
const MIN_SHARE: f64 = 0.3;
/// Minimum share of these beyond which the picture must be uniform.
const MIN_EVEN: f64 = 0.65;
/// Number of neighbouring rays that are worth one independent ray, as they share pixels and noise.
const CORRELATED_RAYS: f64 = 4.0;

/// Number of neighbouring rays on which a soft edge is displaced together by the scene before it,
const DISPLACED_RAYS: f64 = 60.0;
/// and the displacement, relative to the edge's width.
const DISPLACEMENT: f64 = 0.1;

/// The image circle, pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageCircle {
    /// Centre.
    pub centre: DVec2,
    /// Radius at which the light is half of that inside.
    pub radius: f64,
    /// Standard deviation of the centre, right and down.
    pub centre_sigma: DVec2,
    /// Standard deviation of the radius, from the fit and the softness of the edge.
    pub radius_sigma: f64,
    /// Width minus height, relative to the radius, and its standard deviation.
    pub stretch: (f64, f64),
    /// Width of the edge from 10 to 90 %.
    pub softness: f64,
    /// Share of all directions in which the edge was found.
    pub seen: f64,
    /// Points of the edge.
    pub edge: Vec<DVec2>,
}

/// Why no image circle was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoCircle {
    /// There is no circular edge from bright to dark.
    #[error(
        "no image circle found: the picture has no circular edge; are the cameras swapped? A lens whose circle is larger than the frame needs `calibrate intrinsics --camera environment` instead"
    )]
    None,
    /// There is a circular edge, but also a picture outside of it.
    #[error(
        "no image circle found: there is picture beyond the circular edge in {beyond:.0} % of the directions; are the cameras swapped, or does the camera look at a mirrored sphere (--kind sphere)?"
    )]
    PictureBeyond {
        /// Share of the edge, percent.
        beyond: f64,
    },
    /// Too little of the circle is visible.
    #[error(
        "only {seen:.0} % of the image circle is visible; record where there is light in all directions"
    )]
    TooLittle {
        /// Share of all directions, percent.
        seen: f64,
    },
}

/// Finds the circle. `codes` is the picture as encoded, `linear` the same in linear light.
///
/// # Errors
/// There is no circular edge, there is picture beyond it, or too little of it is visible.
pub fn image_circle(codes: &Grey, linear: &Grey) -> Result<ImageCircle, NoCircle> {
    if codes.width.min(codes.height) < 32 || linear.data.len() != codes.data.len() {
        return Err(NoCircle::None);
    }
    let (small, times) = shrunk(codes, SEARCH_SIDE);
    let scale = f64::from(1_u32 << times);
    let (centre, radius) = search(&small).ok_or(NoCircle::None)?;
    let mut fit = Fit {
        centre: centre * scale,
        radius: radius * scale,
        ..Fit::default()
    };
    let mut reach = (4.0 * scale).max(4.0);
    for _ in 0..6 {
        fit = refine(linear, &fit, reach).ok_or(NoCircle::None)?;
        reach = (2.0 * fit.softness).clamp(3.0, (0.05 * fit.radius).max(6.0));
    }
    assess(codes, &fit, reach)
}

#[derive(Clone, Debug, Default)]
struct Fit {
    centre: DVec2,
    radius: f64,
    /// Standard deviations of x, y, R, a, b.
    sigma: [f64; 5],
    /// a and b.
    second: DVec2,
    softness: f64,
    spread: f64,
    /// Rays and positions of the steps.
    edge: Vec<(usize, DVec2)>,
    visible: usize,
}

/// Refines a circle in linear light: see the module's documentation.
fn refine(linear: &Grey, from: &Fit, reach: f64) -> Option<Fit> {
    let mut seen = Vec::with_capacity(RAYS);
    let mut widths = Vec::with_capacity(RAYS);
    let mut visible = 0;
    for ray in 0..RAYS {
        let at = from.centre + side(ray) * from.radius;
        let out = side(ray) * reach;
        if !linear.contains(at + out, 0.0) || !linear.contains(at - out, 0.0) {
            continue;
        }
        visible += 1;
        if let Some((distance, width)) = edge_distance(linear, at, side(ray), reach) {
            seen.push((ray, distance));
            widths.push(width);
        }
    }
    if seen.len() < 30 {
        return None;
    }
    let softness = median(widths).unwrap_or(0.0);
    let typical = median(seen.iter().map(|s| s.1)).unwrap_or(0.0);
    let mut solved = [0.0, 0.0, typical, 0.0, 0.0];
    let mut answer = None;
    for _ in 0..8 {
        let residual = |s: &(usize, f64)| s.1 - predicted(&solved, s.0);
        let spread = (1.4826 * median_absolute(seen.iter().map(residual))).max(0.02);
        let (next, sigma) = solve(&seen, &residual, (spread, softness))?;
        solved = next;
        answer = Some((spread, sigma));
    }
    let (spread, sigma) = answer?;
    let near = |s: &&(usize, f64)| (s.1 - predicted(&solved, s.0)).abs() < 4.0 * spread.max(0.25);
    let point = |s: &(usize, f64)| (s.0, from.centre + side(s.0) * (from.radius + s.1));
    Some(Fit {
        centre: from.centre + DVec2::new(solved[0], solved[1]),
        radius: from.radius + solved[2],
        sigma,
        second: DVec2::new(solved[3], solved[4]),
        softness,
        spread,
        edge: seen.iter().filter(near).map(point).collect(),
        visible,
    })
}

fn row(ray: usize) -> [f64; 5] {
    let s = side(ray);
    [s.x, s.y, 1.0, s.x * s.x - s.y * s.y, 2.0 * s.x * s.y]
}

fn predicted(solved: &[f64; 5], ray: usize) -> f64 {
    row(ray).iter().zip(solved).map(|(a, b)| a * b).sum()
}

/// One round of reweighted least squares: the unknowns and their standard deviations.
fn solve(
    seen: &[(usize, f64)],
    residual: &dyn Fn(&(usize, f64)) -> f64,
    (spread, softness): (f64, f64),
) -> Option<([f64; 5], [f64; 5])> {
    let (mut normal, mut right) = (Matrix::zeros(5, 5), [0.0; 5]);
    for s in seen {
        let weight = tukey_weight(residual(s) / (4.7 * spread));
        let row = row(s.0);
        normal.add_outer(weight, &row, &row);
        for (slot, r) in right.iter_mut().zip(row) {
            *slot += weight * r * s.1;
        }
    }
    // A prior of zero stretch, as an arc alone hardly distinguishes stretch from displacement.
    for i in 3..5 {
        normal[(i, i)] += CORRELATED_RAYS;
    }
    let factor = normal.cholesky()?;
    let solved = factor.solve(&right);
    let inverse = factor.inverse();
    // The scene displaces a soft edge on many neighbouring rays together.
    let sigma =
        (CORRELATED_RAYS.sqrt() * spread).hypot(DISPLACED_RAYS.sqrt() * DISPLACEMENT * softness);
    let sigmas = std::array::from_fn(|i| sigma * inverse[(i, i)].sqrt());
    Some((std::array::from_fn(|i| solved[i]), sigmas))
}

/// Returns the distance at which the light falls to half, pixels outwards from `at`, and the width of
/// the edge, pixels.
fn edge_distance(linear: &Grey, at: DVec2, out: DVec2, reach: f64) -> Option<(f64, f64)> {
    const SPACING: f64 = 0.25;
    let n = (2.0 * reach / SPACING) as usize;
    let value = |k: usize| linear.sample(at + out * ((k as f64 + 0.5) * SPACING - reach));
    let values: Vec<f64> = (0..n).map(value).collect();
    let end = (n / 6).max(1);
    let (inside, outside) = (
        median(values[..end].iter().copied())?,
        median(values[n - end..].iter().copied())?,
    );
    let fall = inside - outside;
    if fall < 0.08 || inside < 1.3 * outside {
        return None;
    }
    let share = |v: &f64| (v - outside) / fall;
    let area: f64 = values.iter().map(share).sum::<f64>() * SPACING;
    let distance = area - reach;
    let within = |v: &&f64| (0.1..0.9).contains(&share(v));
    let width = values.iter().filter(within).count() as f64 * SPACING;
    (distance.abs() < 0.75 * reach).then_some((distance, width))
}

fn assess(codes: &Grey, fit: &Fit, reach: f64) -> Result<ImageCircle, NoCircle> {
    let share = fit.edge.len() as f64 / fit.visible.max(1) as f64;
    let seen = fit.edge.len() as f64 / RAYS as f64;
    if share < MIN_SHARE || fit.spread > 0.03 * fit.radius {
        return Err(NoCircle::None);
    }
    let even = fit
        .edge
        .iter()
        .filter(|(ray, at)| is_even(codes, *at, side(*ray), reach));
    let even = even.count() as f64 / fit.edge.len().max(1) as f64;
    if even < MIN_EVEN {
        return Err(NoCircle::PictureBeyond {
            beyond: 100.0 * (1.0 - even),
        });
    }
    let centre_sigma = DVec2::new(fit.sigma[0], fit.sigma[1]);
    if seen < 0.15 || centre_sigma.max_element() > 0.01 * fit.radius {
        return Err(NoCircle::TooLittle { seen: 100.0 * seen });
    }
    Ok(ImageCircle {
        centre: fit.centre,
        radius: fit.radius,
        centre_sigma,
        // The end of the picture within a soft edge is a convention: a quarter of its width.
        radius_sigma: fit.sigma[2].hypot(0.25 * fit.softness.max(0.2)),
        stretch: (
            2.0 * fit.second.x / fit.radius,
            2.0 * fit.sigma[3] / fit.radius,
        ),
        softness: fit.softness,
        seen,
        edge: fit.edge.iter().map(|e| e.1).collect(),
    })
}

/// Returns whether the picture is uniform beyond the edge: codes change little compared with the edge.
fn is_even(codes: &Grey, at: DVec2, out: DVec2, reach: f64) -> bool {
    let inside = codes.sample(at - out * reach);
    let mut beyond = [0.0; 12];
    let mut n = 0;
    for slot in &mut beyond {
        let p = at + out * (reach + 2.0 * n as f64);
        if !codes.contains(p, 0.0) {
            break;
        }
        *slot = codes.sample(p);
        n += 1;
    }
    let beyond = &beyond[..n];
    let (low, high) = beyond
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    n < 2 || high - low < (0.3 * (inside - low)).max(4.0) && high < inside
}

#[cfg(test)]
mod tests;
