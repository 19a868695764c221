//! Finds a mirrored sphere whose place is known only roughly, e.g. because a hand put it there:
//! first in a reduced picture, then in finer ones, and judges how much of its rim is there.

use super::{MAX_SHIFT, nearest_step, rims, try_refine};
use glam::DVec2;
use penumbra_camera::{PinholeCamera, SphereInCamera};
use penumbra_picture::Picture;

/// Maximum reduction of the picture.
const MAX_REDUCTION: u32 = 8;
/// Standard deviation of a position that was found in a reduced picture, its pixels.
const COARSE_SIGMA: f64 = 0.7;
/// Maximum distance of a step from the rim that it supports, pixels.
const MAX_DISTANCE: f64 = 0.75;

/// A mirrored sphere that was found in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocatedSphere {
    /// The sphere, with the standard deviation of its position.
    pub sphere: SphereInCamera,
    /// Share of its rim at which the picture has an edge, 0 to 1. Of a place without a sphere it is
    /// the share of the rim that happens to cross edges.
    pub support: f64,
}

/// Finds the sphere near `predicted`, whose `sigma` may be many pixels; `None` if its rim is
/// nowhere, or hardly within the picture.
#[must_use]
pub fn locate(
    picture: &Picture,
    camera: &PinholeCamera,
    predicted: &SphereInCamera,
) -> Option<LocatedSphere> {
    let mut reduction = 1;
    while reduction < MAX_REDUCTION && 3.0 * predicted.sigma / f64::from(reduction) > MAX_SHIFT {
        reduction *= 2;
    }
    let mut sphere = *predicted;
    while reduction > 1 {
        let share = 1.0 / f64::from(reduction);
        let (small, small_camera) = (reduced(picture, reduction)?, scaled(camera, reduction));
        let start = SphereInCamera {
            sigma: sphere.sigma * share,
            ..sphere
        };
        let found = try_refine(&small, &small_camera, &start)?;
        sphere = SphereInCamera {
            sigma: f64::from(reduction) * found.sigma.max(COARSE_SIGMA),
            ..found
        };
        reduction /= 2;
    }
    let sphere = try_refine(picture, camera, &sphere)?;
    let support = support(picture, camera, &sphere)?;
    Some(LocatedSphere { sphere, support })
}

/// Returns the share of the rays along the rim on which an edge is at the rim.
fn support(picture: &Picture, camera: &PinholeCamera, sphere: &SphereInCamera) -> Option<f64> {
    let rims = rims(picture, camera, sphere)?;
    let at_rim = |rim: &&super::Rim| {
        nearest_step(rim, 0.0).is_some_and(|(distance, _)| distance.abs() < MAX_DISTANCE)
    };
    Some(rims.iter().filter(at_rim).count() as f64 / rims.len() as f64)
}

/// Returns the picture with `n` × `n` pixels averaged into one; `None` if it is too small.
fn reduced(picture: &Picture, n: u32) -> Option<Picture> {
    let (width, height) = (picture.width / n, picture.height / n);
    let is_complete = picture.rgba.len() >= 4 * picture.width as usize * picture.height as usize;
    if width == 0 || height == 0 || !is_complete {
        return None;
    }
    let mut rgba = Vec::with_capacity(4 * width as usize * height as usize);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let mut sum = [0_u32; 3];
        for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
            let codes = picture.rgb(x * n + i, y * n + j);
            (0..3).for_each(|c| sum[c] += u32::from(codes[c]));
        }
        rgba.extend(sum.map(|s| ((s + n * n / 2) / (n * n)) as u8));
        rgba.push(255);
    }
    Some(Picture {
        width,
        height,
        rgba,
    })
}

/// Returns the camera of the reduced picture.
fn scaled(camera: &PinholeCamera, n: u32) -> PinholeCamera {
    let n_pixels = f64::from(n);
    PinholeCamera {
        width: camera.width / n,
        height: camera.height / n,
        focal: camera.focal / n_pixels,
        centre: (camera.centre + 0.5) / n_pixels - DVec2::splat(0.5),
        ..camera.clone()
    }
}
