//! Refines the position of a mirrored sphere in a picture by its outline, near the position
//! predicted by a pose (the jitter of DiVerdi & Höllerer 2004, section 3.3).
//!
//! ```text
//!  Seen from the camera, the sphere's rim is the cone of half angle α = asin(R/D) about its centre.
//!  K rays of it end on pixels p_k with outward normals n_k. A picture displaced by d from its
//!  prediction has its steps of luminance at n_k·d along the normals. First d is the position on a
//!  grid with the most steps, where a strong one counts no more than a few weak ones: a mirror
//!  shows edges, too, but none that runs along the entire rim. Then d is the mean
//!      (C⁻¹ + I/σ²)⁻¹ C⁻¹ N⁻¹ Σ w_k n_k s_k,    N = Σ w_k n_k n_kᵀ,    C = σ_e² N⁻¹ + σ_c² I
//!  of the steps' own positions s_k and the prediction, whose uncertainty is σ: so a rim that is
//!  hardly or partly visible moves the sphere only as far as it constrains it, and a good pose is
//!  hardly changed. σ_c is the error common to all steps.
//! ```

use glam::{DMat2, DVec2};
use penumbra_camera::PinholeCamera;
use penumbra_camera::SphereInCamera;
use penumbra_numerics::{median, tukey_weight};
use penumbra_picture::Picture;

mod locate;

pub use locate::{LocatedSphere, locate};

/// Rays along the rim.
const RAYS: usize = 120;
/// Positions per pixel along a normal.
const PER_PIXEL: f64 = 4.0;
/// Maximum search distance in either direction, pixels.
const MAX_SHIFT: f64 = 6.0;
/// Number of positions on a normal.
const POSITIONS: usize = (2.0 * (MAX_SHIFT + 2.0) * PER_PIXEL) as usize + 1;
/// Maximum strength of a step, as a multiple of the median step.
const MAX_STEP: f32 = 3.0;
/// Minimum share of the rays that must show a step at one position.
const MIN_SUPPORT: f64 = 0.35;
/// Minimum ratio of the best position's score to the mean score.
const MIN_CONTRAST: f64 = 1.25;
/// Standard deviation of the rim's common error, pixels: the reflections next to it and the shadow
/// at the sphere's contact run along it.
const COMMON_SIGMA: f64 = 0.3;

/// A ray of the rim in the picture.
#[derive(Clone, Copy)]
struct Rim {
    /// Outward normal, unit vector.
    normal: DVec2,
    /// Strength of the step at each position along the normal.
    steps: Steps,
}

type Steps = [f32; POSITIONS];

/// Returns the sphere at the position of its rim in the picture, with a smaller σ. If too little of
/// the rim is visible, or its steps are inconsistent, the sphere is returned unchanged.
#[must_use]
pub fn refine(picture: &Picture, camera: &PinholeCamera, ball: &SphereInCamera) -> SphereInCamera {
    try_refine(picture, camera, ball).unwrap_or(*ball)
}

fn try_refine(
    picture: &Picture,
    camera: &PinholeCamera,
    ball: &SphereInCamera,
) -> Option<SphereInCamera> {
    if picture.rgba.len() < 4 * picture.width as usize * picture.height as usize {
        return None;
    }
    let rims = rims(picture, camera, ball)?;
    let reach = (3.0 * ball.sigma).clamp(1.0, MAX_SHIFT);
    let coarse = search(&rims, reach)?;
    let (shift, sigma) = refine_shift(&rims, coarse, ball.sigma)?;
    // The prediction's error is within its bounds.
    if shift.length() > reach + 0.5 {
        return None;
    }
    let pixel = camera.project(ball.centre)?;
    let moved = camera.unproject(pixel + shift) * ball.centre.length();
    Some(SphereInCamera {
        centre: moved,
        sigma,
        ..*ball
    })
}

fn rims(picture: &Picture, camera: &PinholeCamera, ball: &SphereInCamera) -> Option<Vec<Rim>> {
    let distance = ball.centre.length();
    let sine = ball.radius / distance;
    if !(sine > 0.0 && sine < 0.9) {
        return None;
    }
    let axis = ball.centre / distance;
    let (u, v) = axis.any_orthonormal_pair();
    let rays = (0..RAYS).filter_map(|k| {
        let around = DVec2::from_angle(std::f64::consts::TAU * k as f64 / RAYS as f64);
        let side = u * around.x + v * around.y;
        let at = |sine: f64| camera.project(axis * (1.0 - sine * sine).sqrt() + side * sine);
        let rim = at(sine)?;
        let normal = (at(sine * 1.01)? - rim).normalize_or_zero();
        Some(Rim {
            normal,
            steps: steps(picture, rim, normal)?,
        })
    });
    let rays: Vec<Rim> = rays.collect();
    (rays.len() as f64 >= MIN_SUPPORT * RAYS as f64).then_some(rays)
}

/// Returns the change of colour across each position along a normal, codes; `None` where the normal
/// leaves the picture.
fn steps(picture: &Picture, rim: DVec2, normal: DVec2) -> Option<Steps> {
    const HALF: f64 = 0.75;
    let mut steps = [0.0; POSITIONS];
    for (i, step) in steps.iter_mut().enumerate() {
        let s = position(i);
        let outer = colour(picture, rim + normal * (s + HALF))?;
        let inner = colour(picture, rim + normal * (s - HALF))?;
        *step = (0..3).map(|c| (outer[c] - inner[c]).abs()).sum();
    }
    Some(steps)
}

/// Distance from the predicted rim, pixels.
fn position(i: usize) -> f64 {
    i as f64 / PER_PIXEL - (MAX_SHIFT + 2.0)
}

fn colour(picture: &Picture, p: DVec2) -> Option<[f32; 3]> {
    let base = p.floor();
    let inside = base.x >= 0.0
        && base.y >= 0.0
        && base.x + 1.0 < f64::from(picture.width)
        && base.y + 1.0 < f64::from(picture.height);
    if !inside {
        return None;
    }
    let (x, y, f) = (base.x as u32, base.y as u32, (p - base).as_vec2());
    let at = |x: u32, y: u32| picture.rgb(x, y).map(f32::from);
    let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1));
    Some(std::array::from_fn(|i| {
        let row = |a: f32, b: f32| a + (b - a) * f.x;
        row(a[i], b[i]) + (row(c[i], d[i]) - row(a[i], b[i])) * f.y
    }))
}

/// Returns the shift with the most steps, on a grid of half pixels.
fn search(rims: &[Rim], reach: f64) -> Option<DVec2> {
    let typical =
        median(rims.iter().map(|r| f64::from(r.steps[POSITIONS / 2]))).map_or(0.0, |m| m as f32);
    // A strong step counts no more than a few typical ones.
    let cap = MAX_STEP * typical.max(4.0);
    let score = |shift: DVec2| -> f64 {
        let at = |r: &Rim| f64::from(r.steps[index(r.normal.dot(shift))].min(cap));
        rims.iter().map(at).sum()
    };
    let n = (2.0 * reach).ceil() as i32;
    let (mut best, mut sum, mut count) = ((f64::MIN, DVec2::ZERO), 0.0, 0.0);
    for (y, x) in (-n..=n).flat_map(|y| (-n..=n).map(move |x| (y, x))) {
        let shift = DVec2::new(f64::from(x), f64::from(y)) * 0.5;
        let found = score(shift);
        (sum, count) = (sum + found, count + 1.0);
        if found > best.0 {
            best = (found, shift);
        }
    }
    (best.0 > MIN_CONTRAST * sum / count).then_some(best.1)
}

fn index(s: f64) -> usize {
    let i = (s + MAX_SHIFT + 2.0) * PER_PIXEL;
    (i.round().max(0.0) as usize).min(POSITIONS - 1)
}

/// Returns the position along a normal of the step nearest to `around`, and its strength; `None` if
/// there is none.
fn nearest_step(rim: &Rim, around: f64) -> Option<(f64, f64)> {
    let middle = index(around);
    let near = (PER_PIXEL * 1.25) as usize;
    let (low, high) = (
        middle.saturating_sub(near),
        (middle + near).min(POSITIONS - 1),
    );
    let peak = (low..=high).max_by(|a, b| rim.steps[*a].total_cmp(&rim.steps[*b]))?;
    if peak == low || peak == high || rim.steps[peak] < 8.0 {
        return None;
    }
    // The vertex of the parabola through the peak and its neighbours.
    let at = |i: usize| f64::from(rim.steps[i]);
    let (a, b, c) = (at(peak - 1), at(peak), at(peak + 1));
    let bend = a - 2.0 * b + c;
    let deviation = if bend < -1e-9 {
        (0.5 * (a - c) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    };
    Some((position(peak) + deviation / PER_PIXEL, b))
}

/// Returns the mean of the steps' positions and the prediction, and its standard deviation, pixels.
fn refine_shift(rims: &[Rim], coarse: DVec2, prior: f64) -> Option<(DVec2, f64)> {
    let mut shift = coarse;
    let mut sigma = prior;
    // Position at which the rim is searched; its result is then weighted against the prediction.
    let mut centre = coarse;
    for _ in 0..4 {
        let found: Vec<(DVec2, f64)> = rims
            .iter()
            .filter_map(|r| {
                let (at, _) = nearest_step(r, r.normal.dot(centre))?;
                Some((r.normal, at))
            })
            .collect();
        if (found.len() as f64) < MIN_SUPPORT * RAYS as f64 {
            return None;
        }
        let deviation = |(n, s): &(DVec2, f64)| s - n.dot(centre);
        let robust_sigma = 1.48
            * median(found.iter().map(|f| f64::from(deviation(f).abs() as f32))).unwrap_or(0.0);
        let scale = robust_sigma.max(0.1);
        let (mut normal, mut right) = (DMat2::ZERO, DVec2::ZERO);
        for f in &found {
            let weight = tukey_weight(deviation(f) / (4.0 * scale));
            normal += DMat2::from_cols(f.0 * f.0.x, f.0 * f.0.y) * weight;
            right += f.0 * (f.1 * weight);
        }
        let (fused_shift, fused_sigma) = fuse(normal, right, scale, prior)?;
        (shift, sigma) = (fused_shift, fused_sigma);
        centre = (normal + DMat2::IDENTITY * 1e-3).inverse() * right;
    }
    shift.is_finite().then_some((shift, sigma))
}

/// Combines the rim with the prediction as described in the module's head.
fn fuse(normal: DMat2, right: DVec2, scale: f64, prior: f64) -> Option<(DVec2, f64)> {
    // Half a rim hardly constrains the tangential direction, and an invisible one nothing.
    let normal = normal + DMat2::IDENTITY * 1e-3;
    let rim_estimate = normal.inverse();
    // Neighbouring rays share their pixels and their errors: four count as one.
    let rim_covariance = rim_estimate * (4.0 * scale * scale);
    let information = (rim_covariance + DMat2::IDENTITY * (COMMON_SIGMA * COMMON_SIGMA)).inverse();
    let covariance = (information + DMat2::IDENTITY * (1.0 / (prior * prior))).inverse();
    let shift = covariance * (information * (rim_estimate * right));
    let sigma = (0.5 * (covariance.x_axis.x + covariance.y_axis.y)).sqrt();
    (shift.is_finite() && sigma.is_finite()).then_some((shift, sigma))
}

#[cfg(test)]
mod tests;
