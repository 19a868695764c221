//! The outline of a mirrored sphere in the picture of a camera with a known lens, and the sphere's
//! position.
//!
//! ```text
//!  The rays b that touch the sphere form a cone about the direction a to its centre:
//!      a · b = cos α,   sin α = R/D.
//!  Thus x = a / cos α satisfies x · b = 1 on the entire outline: three of its rays give x in closed
//!  form (RANSAC), more by least squares, and x gives the centre a R / sin α. A general ellipse would
//!  have five unknowns; the known lens and the sphere leave three.
//! ```
//!
//! The mirror image has edges too, and near the rim it resembles the background. Therefore a weak step
//! counts nearly as much as a strong one if the steps continue along the entire outline.

mod cone;
mod search;

pub use search::RoughSphere;

use super::super::intrinsics::Grey;
use super::rays::{RAYS, Search, noise, side, steps};
use cone::{distance, shape};
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_numerics::{Matrix, median_absolute, tukey_weight};
use search::sample;

/// Minimum share of the visible outline that must show a step.
const MIN_SHARE: f64 = 0.4;
/// Minimum share of the entire outline: a straight edge resembles a piece of a large outline.
const MIN_SEEN: f64 = 0.3;
/// Number of neighbouring rays that are worth one independent ray, as they share pixels and noise.
const CORRELATED_RAYS: f64 = 4.0;
/// Systematic error of an outline, pixels, however consistent its steps: the mirror image next to the
/// outline follows it. The spread of the steps is added.
const SYSTEMATIC: f64 = 0.15;

/// Minimum height of the outermost step, relative to the highest.
const OUTERMOST: f64 = 0.35;

/// The outline of a sphere.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Unit vector to the sphere's centre, camera's frame.
    pub axis: DVec3,
    /// Half of the angle that it subtends, radians.
    pub half_angle: f64,
    /// Standard deviation of the axis in each direction, radians.
    pub axis_sigma: f64,
    /// Standard deviation of the half angle, radians.
    pub angle_sigma: f64,
    /// Share of the outline on which a step was found.
    pub seen: f64,
    /// Robust standard deviation (1.4826 MAD) of the steps about the outline, pixels.
    pub spread: f64,
    /// Pixels per pixel of a picture of 500 rows.
    pub unit: f64,
    /// The steps.
    pub edge: Vec<DVec2>,
}

impl Outline {
    /// Returns the score by which the best of several outlines is chosen.
    #[must_use]
    pub fn score(&self) -> f64 {
        self.seen - 0.15 * self.spread / self.unit
    }

    /// Returns the centre of a sphere of `radius` metres, camera's frame, and its standard deviations
    /// across and along the line of observation, metres.
    #[must_use]
    pub fn centre(&self, radius: f64) -> (DVec3, [f64; 2]) {
        let distance = radius / self.half_angle.sin();
        let along = distance * self.angle_sigma / self.half_angle.tan();
        (self.axis * distance, [distance * self.axis_sigma, along])
    }

    /// Returns points on the outline, pixels.
    #[must_use]
    pub fn curve(&self, camera: &PinholeCamera) -> Vec<DVec2> {
        let (u, v) = self.axis.any_orthonormal_pair();
        let (sin, cos) = self.half_angle.sin_cos();
        (0..=180)
            .filter_map(|k| {
                let around = DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / 180.0);
                camera.project(self.axis * cos + (u * around.x + v * around.y) * sin)
            })
            .collect()
    }
}

/// Why no outline was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoOutline {
    /// There is no sphere in the picture.
    #[error(
        "no outline of a sphere found; give its centre: --click X,Y or X,Y,RADIUS in pixels of the environment camera's picture"
    )]
    None,
    /// Too little of the outline shows an edge.
    #[error(
        "only {seen:.0} % of the sphere's outline shows an edge; place it before a background of another colour, or give its position: --click X,Y,RADIUS"
    )]
    TooLittle {
        /// Percent.
        seen: f64,
    },
}

/// Finds the outline in the colour channels of a picture (codes) from an approximate position.
///
/// # Errors
/// There is no sphere in the picture, or too little of its outline shows an edge.
pub fn outline(
    planes: &[Grey; 3],
    camera: &PinholeCamera,
    rough: RoughSphere,
) -> Result<Outline, NoOutline> {
    let planes = planes.each_ref();
    let size = DVec2::new(planes[0].width as f64, planes[0].height as f64);
    if size.min_element() < 32.0 || !rough.centre.is_finite() {
        return Err(NoOutline::None);
    }
    let min_height = (3.0 * noise(planes[1])).max(2.0);
    let reach = match rough.radius {
        Some(r) => (0.8 * r, 1.25 * r),
        None => (0.04 * size.min_element(), 0.75 * size.max_element()),
    };
    let search = Search {
        reach,
        half: (0.006 * size.min_element()).max(2.0),
        min_height,
        max_count: if rough.radius.is_some() { 6 } else { 12 },
        falling: false,
    };
    let mut all = Vec::new();
    for ray in 0..RAYS {
        steps(&planes, rough.centre, ray, &search, &mut all);
    }
    let mut cone = sample(&all, camera, &rough, search.half).ok_or(NoOutline::None)?;
    let mut found = None;
    // The sharpness is that of the lens: a larger picture is blurred over more pixels.
    let unit = (size.min_element() / 500.0).max(1.0);
    for reach in [
        2.0 * search.half,
        search.half,
        2.0 * unit,
        2.0 * unit,
        2.0 * unit,
    ] {
        let fit =
            refine(&planes, camera, cone, (reach, unit), min_height).ok_or(NoOutline::None)?;
        cone = fit.0;
        found = Some(fit);
    }
    let (cone, edge, visible, spread, sigma) = found.ok_or(NoOutline::None)?;
    let share = edge.len() as f64 / visible.max(1) as f64;
    let seen = edge.len() as f64 / RAYS as f64;
    if share < MIN_SHARE || seen < MIN_SEEN {
        return Err(NoOutline::TooLittle { seen: 100.0 * seen });
    }
    let (axis, half_angle) = shape(cone).ok_or(NoOutline::None)?;
    let common = SYSTEMATIC.hypot(spread) / camera.focal.min_element();
    Ok(Outline {
        axis,
        half_angle,
        axis_sigma: sigma.0.hypot(common),
        angle_sigma: sigma.1.hypot(common),
        seen,
        spread,
        unit,
        edge,
    })
}

/// Returns the best of the outlines at several approximate positions.
///
/// # Errors
/// There is an outline at none of them.
pub fn best_outline(
    planes: &[Grey; 3],
    camera: &PinholeCamera,
    positions: impl IntoIterator<Item = RoughSphere>,
) -> Result<Outline, NoOutline> {
    let mut best: Result<Outline, NoOutline> = Err(NoOutline::None);
    for rough in positions {
        match (outline(planes, camera, rough), &best) {
            (Ok(found), Ok(known)) if found.score() <= known.score() => {}
            (Ok(found), _) => best = Ok(found),
            (Err(why), Err(_)) => best = Err(why),
            (Err(_), Ok(_)) => {}
        }
    }
    best
}

/// Cone, its steps, number of visible rays, spread (pixels), σ of axis and half angle (radians).
type Fitted = (DVec3, Vec<DVec2>, usize, f64, (f64, f64));

/// Finds the steps near an outline and fits the outline to them by iteratively reweighted least squares.
fn refine(
    planes: &[&Grey; 3],
    camera: &PinholeCamera,
    x: DVec3,
    (reach, unit): (f64, f64),
    min_height: f64,
) -> Option<Fitted> {
    let (axis, half) = shape(x)?;
    let (u, v) = axis.any_orthonormal_pair();
    let focal = camera.focal.min_element();
    let (mut found, mut visible) = (Vec::with_capacity(RAYS), 0);
    for ray in 0..RAYS {
        let across = u * side(ray).x + v * side(ray).y;
        let at = |angle: f64| camera.project(axis * angle.cos() + across * angle.sin());
        let (Some(rim), Some(outer)) = (at(half), at(half * 1.01)) else {
            continue;
        };
        let normal = (outer - rim).normalize_or_zero();
        if !planes[0].contains(rim, reach + 2.0) {
            continue;
        }
        visible += 1;
        if let Some(s) = peak(planes, rim, normal, (reach, unit), min_height) {
            let at = rim + normal * s;
            found.push((at, camera.unproject(at)));
        }
    }
    let mut x = x;
    let mut answer = None;
    for _ in 0..6 {
        let distances: Vec<f64> = found.iter().map(|f| distance(x, f.1, focal)).collect();
        let spread = (1.4826 * median_absolute(distances.iter().copied())).max(0.05);
        let (next, sigma) = solve(&found, &distances, spread, focal, x)?;
        x = next;
        answer = Some((spread, sigma));
    }
    let (spread, sigma) = answer?;
    let near = |f: &&(DVec2, DVec3)| distance(x, f.1, focal).abs() < (4.0 * spread).max(0.5);
    let edge = found.iter().filter(near).map(|f| f.0).collect();
    Some((x, edge, visible, spread, sigma))
}

/// Solves x · b = 1 by least squares with Tukey's weights of the last distances; returns x and the
/// standard deviations of axis and half angle, radians.
fn solve(
    found: &[(DVec2, DVec3)],
    distances: &[f64],
    spread: f64,
    focal: f64,
    x: DVec3,
) -> Option<(DVec3, (f64, f64))> {
    let (mut normal, mut right) = (Matrix::zeros(3, 3), [0.0; 3]);
    // The derivative of x · b by an angle is |x| sin α.
    let slope = (x.length_squared() - 1.0).max(1e-12).sqrt();
    for ((_, b), distance) in found.iter().zip(distances) {
        let weight = tukey_weight(distance / (4.7 * spread)) / (slope * slope);
        normal.add_outer(weight, &b.to_array(), &b.to_array());
        for (slot, b) in right.iter_mut().zip(b.to_array()) {
            *slot += weight * b;
        }
    }
    let factor = normal.cholesky()?;
    let solved = factor.solve(&right);
    let x = DVec3::new(solved[0], solved[1], solved[2]);
    let (axis, half) = shape(x)?;
    let inverse = factor.inverse();
    let angle = spread / focal;
    let variance = |d: DVec3| {
        let d = d.to_array();
        let image = inverse.times_vector(&d);
        d.iter().zip(image).map(|(a, b)| a * b).sum::<f64>() * CORRELATED_RAYS * angle * angle
    };
    let (u, v) = axis.any_orthonormal_pair();
    // x = a / cos α: across, dx = da / cos α; along, d|x| = sin α / cos² α dα.
    let across = (0.5 * (variance(u) + variance(v))).sqrt() * half.cos();
    let along = variance(axis).sqrt() * half.cos().powi(2) / half.sin();
    Some((x, (across, along)))
}

/// Returns the outermost clear step along a normal, pixels from `rim`, interpolated by a parabola.
fn peak(
    planes: &[&Grey; 3],
    rim: DVec2,
    normal: DVec2,
    (reach, unit): (f64, f64),
    min_height: f64,
) -> Option<f64> {
    let (spacing, half) = (0.25 * unit, 0.8 * unit);
    let n = (2.0 * reach / spacing) as usize + 1;
    let height = |i: usize| {
        let p = rim + normal * (i as f64 * spacing - reach);
        let step = |g: &&Grey| (g.sample(p + normal * half) - g.sample(p - normal * half)).abs();
        planes.iter().map(step).sum::<f64>() / 3.0
    };
    let heights: Vec<f64> = (0..n).map(height).collect();
    let highest = heights.iter().copied().fold(0.0, f64::max);
    let enough = (0.5 * min_height).max(OUTERMOST * highest);
    // The mirror image is compressed just inside the rim, where its edges are often stronger.
    let top = (1..n - 1).rev().find(|&i| {
        heights[i] >= enough && heights[i] >= heights[i - 1] && heights[i] > heights[i + 1]
    })?;
    let (a, b, c) = (heights[top - 1], heights[top], heights[top + 1]);
    let curvature = a - 2.0 * b + c;
    let shift = if curvature < -1e-9 {
        (0.5 * (a - c) / curvature).clamp(-0.5, 0.5)
    } else {
        0.0
    };
    Some((top as f64 + shift) * spacing - reach)
}

#[cfg(test)]
mod tests;
