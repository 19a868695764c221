//! The outline of a mirrored sphere before a camera of known lens, and where that puts the sphere.
//!
//! ```text
//!  The eye's rays b that touch the sphere make a cone about the way a to its middle:
//!      a · b = cos α,   sin α = R/D.
//!  So x = a / cos α has x · b = 1 on the whole outline: three rays of it give x in closed form
//!  (RANSAC), many by least squares, and x the middle a R / sin α. An ellipse has five unknowns;
//!  what the lens and the round thing itself know is not asked of the picture.
//! ```
//!
//! What the ball mirrors has edges, too, and at the rim it shows nearly what stands behind it. So a
//! weak step counts nearly as much as a strong one, if they run along the whole outline.

use super::super::intrinsics::Grey;
use super::ball_search::sample;
use super::rays::{RAYS, Search, noise, side, steps, tukey};
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_numerics::{Matrix, median_absolute};

/// Least share of the outline within the frame that must show a step.
const LEAST_SHARE: f64 = 0.4;
/// Least share of the way round: a straight edge is a piece of a large outline.
const LEAST_SEEN: f64 = 0.3;
/// Neighbouring rays share pixels and noise: so many count as one.
const ALIKE: f64 = 4.0;
/// What an outline may be off as a whole, pixels, however well its steps agree. What the mirror shows
/// next to it runs along it: as far as the steps are spread, all of them may be off.
const COMMON: f64 = 0.15;

/// The outermost step counts that is this high compared with the highest.
const OUTERMOST: f64 = 0.35;

/// Where somebody says that the ball is, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughBall {
    /// Some place on it, best its middle.
    pub centre: DVec2,
    /// How large it is, if that was said.
    pub radius: Option<f64>,
}

/// The outline.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Unit vector to the sphere's middle, camera's frame.
    pub axis: DVec3,
    /// Half of the angle it fills, radians.
    pub half_angle: f64,
    /// Standard deviation of the axis, each way, radians.
    pub axis_sigma: f64,
    /// Of the half angle.
    pub angle_sigma: f64,
    /// Share of the way round in which a step was seen.
    pub seen: f64,
    /// Robust spread of the steps about the outline, pixels.
    pub spread: f64,
    /// Pixels that are one of a picture of 500 rows.
    pub unit: f64,
    /// The steps.
    pub edge: Vec<DVec2>,
}

impl Outline {
    /// How much like an outline it is: of several finds the best has the most.
    #[must_use]
    pub fn worth(&self) -> f64 {
        self.seen - 0.15 * self.spread / self.unit
    }

    /// The middle of a sphere of `radius` metres, camera's frame, and its standard deviation
    /// across and along the line of sight.
    #[must_use]
    pub fn centre(&self, radius: f64) -> (DVec3, [f64; 2]) {
        let distance = radius / self.half_angle.sin();
        let along = distance * self.angle_sigma / self.half_angle.tan();
        (self.axis * distance, [distance * self.axis_sigma, along])
    }

    /// Points on it, pixels.
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

/// There is no outline.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoOutline {
    /// Nothing round.
    #[error(
        "no outline of a sphere found; click on its middle: --click X,Y or X,Y,RADIUS in pixels of the environment camera's picture"
    )]
    None,
    /// Too little of the way round.
    #[error(
        "only {seen:.0} % of the way round the sphere shows an edge; put it before a background of another colour, or say where it is: --click X,Y,RADIUS"
    )]
    TooLittle {
        /// Percent.
        seen: f64,
    },
}

/// Finds the outline in a picture's colours (encoded); `rough` from a click, or from a search.
///
/// # Errors
/// [`NoOutline`].
pub fn outline(
    planes: &[Grey; 3],
    camera: &PinholeCamera,
    rough: RoughBall,
) -> Result<Outline, NoOutline> {
    let planes = planes.each_ref();
    let size = DVec2::new(planes[0].width as f64, planes[0].height as f64);
    if size.min_element() < 32.0 || !rough.centre.is_finite() {
        return Err(NoOutline::None);
    }
    let least = (3.0 * noise(planes[1])).max(2.0);
    let reach = match rough.radius {
        Some(r) => (0.8 * r, 1.25 * r),
        None => (0.04 * size.min_element(), 0.75 * size.max_element()),
    };
    let search = Search {
        reach,
        half: (0.006 * size.min_element()).max(2.0),
        least,
        most: if rough.radius.is_some() { 6 } else { 12 },
        falling: false,
    };
    let mut all = Vec::new();
    for ray in 0..RAYS {
        steps(&planes, rough.centre, ray, &search, &mut all);
    }
    let mut cone = sample(&all, camera, &rough, search.half).ok_or(NoOutline::None)?;
    let mut found = None;
    // A large picture is as sharp as a small one of the same lens, not as its pixels.
    let unit = (size.min_element() / 500.0).max(1.0);
    for reach in [
        2.0 * search.half,
        search.half,
        2.0 * unit,
        2.0 * unit,
        2.0 * unit,
    ] {
        let fit = refine(&planes, camera, cone, (reach, unit), least).ok_or(NoOutline::None)?;
        cone = fit.0;
        found = Some(fit);
    }
    let (cone, edge, visible, spread, sigma) = found.ok_or(NoOutline::None)?;
    let share = edge.len() as f64 / visible.max(1) as f64;
    let seen = edge.len() as f64 / RAYS as f64;
    if share < LEAST_SHARE || seen < LEAST_SEEN {
        return Err(NoOutline::TooLittle { seen: 100.0 * seen });
    }
    let (axis, half_angle) = shape(cone).ok_or(NoOutline::None)?;
    let common = COMMON.hypot(spread) / camera.focal.min_element();
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

/// Axis and half angle of x = a / cos α.
pub(super) fn shape(x: DVec3) -> Option<(DVec3, f64)> {
    let length = x.length();
    (length.is_finite() && length > 1.000_001).then(|| (x / length, (1.0 / length).acos()))
}

/// How far a ray is from the cone, in pixels near the axis.
pub(super) fn off(x: DVec3, bearing: DVec3, focal: f64) -> f64 {
    let length = x.length();
    let half = (1.0 / length).acos();
    (bearing.dot(x / length).clamp(-1.0, 1.0).acos() - half) * focal
}

type Fitted = (DVec3, Vec<DVec2>, usize, f64, (f64, f64));

/// The steps nearest to the outline, and the outline through them.
fn refine(
    planes: &[&Grey; 3],
    camera: &PinholeCamera,
    x: DVec3,
    (reach, unit): (f64, f64),
    least: f64,
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
        if let Some(s) = peak(planes, rim, normal, (reach, unit), least) {
            let place = rim + normal * s;
            found.push((place, camera.unproject(place)));
        }
    }
    let mut x = x;
    let mut answer = None;
    for _ in 0..6 {
        let offs: Vec<f64> = found.iter().map(|f| off(x, f.1, focal)).collect();
        let spread = (1.4826 * median_absolute(offs.iter().copied())).max(0.05);
        let (next, sigma) = solve(&found, &offs, spread, focal, x)?;
        x = next;
        answer = Some((spread, sigma));
    }
    let (spread, sigma) = answer?;
    let near = |f: &&(DVec2, DVec3)| off(x, f.1, focal).abs() < (4.0 * spread).max(0.5);
    let edge = found.iter().filter(near).map(|f| f.0).collect();
    Some((x, edge, visible, spread, sigma))
}

/// Least squares of x · b = 1 with the weights of the last round; standard deviations of axis
/// and half angle, radians.
fn solve(
    found: &[(DVec2, DVec3)],
    offs: &[f64],
    spread: f64,
    focal: f64,
    x: DVec3,
) -> Option<(DVec3, (f64, f64))> {
    let (mut normal, mut right) = (Matrix::zeros(3, 3), [0.0; 3]);
    // d(x·b) by an angle: |x| sin α.
    let slope = (x.length_squared() - 1.0).max(1e-12).sqrt();
    for ((_, b), off) in found.iter().zip(offs) {
        let weight = tukey(off / (4.7 * spread)) / (slope * slope);
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
        d.iter().zip(image).map(|(a, b)| a * b).sum::<f64>() * ALIKE * angle * angle
    };
    let (u, v) = axis.any_orthonormal_pair();
    // x = a / cos α: across, dx = da / cos α; along, d|x| = sin α / cos² α dα.
    let across = (0.5 * (variance(u) + variance(v))).sqrt() * half.cos();
    let along = variance(axis).sqrt() * half.cos().powi(2) / half.sin();
    Some((x, (across, along)))
}

/// The outermost clear step along a normal, pixels from `rim`; between samples by a parabola.
fn peak(
    planes: &[&Grey; 3],
    rim: DVec2,
    normal: DVec2,
    (reach, unit): (f64, f64),
    least: f64,
) -> Option<f64> {
    let (spacing, half) = (0.25 * unit, 0.8 * unit);
    let n = (2.0 * reach / spacing) as usize + 1;
    let height = |i: usize| {
        let p = rim + normal * (i as f64 * spacing - reach);
        let of = |g: &&Grey| (g.sample(p + normal * half) - g.sample(p - normal * half)).abs();
        planes.iter().map(of).sum::<f64>() / 3.0
    };
    let heights: Vec<f64> = (0..n).map(height).collect();
    let highest = heights.iter().copied().fold(0.0, f64::max);
    let enough = (0.5 * least).max(OUTERMOST * highest);
    // What the mirror shows crowds together just within the rim, and is often stronger.
    let top = (1..n - 1).rev().find(|&i| {
        heights[i] >= enough && heights[i] >= heights[i - 1] && heights[i] > heights[i + 1]
    })?;
    let (a, b, c) = (heights[top - 1], heights[top], heights[top + 1]);
    let bend = a - 2.0 * b + c;
    let shift = if bend < -1e-9 {
        (0.5 * (a - c) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    };
    Some((top as f64 + shift) * spacing - reach)
}

#[cfg(test)]
mod tests;
