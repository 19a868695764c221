//! Reprojection errors of the markers under the calibration.

use glam::DVec2;
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::{Registrar, TagMap, TagObservation};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::{median, root_mean_square};

/// Maximum error that is counted, pixels.
const FARTHEST: f64 = 1e4;

/// Reprojection error of a tag's corner: detected minus predicted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Off {
    /// Detected position, pixels.
    pub at: DVec2,
    /// Detected minus predicted position, pixels.
    pub by: DVec2,
    /// Seconds since the first picture.
    pub seconds: f64,
}

/// Returns the errors of all corners under a pose from another source (the tracker).
pub fn by_pose(
    camera: &PinholeCamera,
    map: &TagMap,
    seen: &[TagObservation],
    world_from_camera: RigidTransform,
    seconds: f64,
    out: &mut Vec<Off>,
) {
    let camera_from_world = world_from_camera.inverse();
    for tag in seen {
        let Some(known) = map.get(tag.family, tag.id) else {
            continue;
        };
        for (corner, at) in known.corners().into_iter().zip(tag.corners) {
            let place = camera.project(camera_from_world.transform_point(corner));
            // Behind the camera or outside the lens's range: counted with the maximum error.
            let by = place.map_or(DVec2::splat(FARTHEST), |place| at - place);
            let by = by.clamp_length_max(FARTHEST);
            out.push(Off { at, by, seconds });
        }
    }
}

/// Returns the errors of each tag's corners under the pose from the other tags; needs two tags in
/// a picture.
pub fn by_the_others(
    camera: &PinholeCamera,
    map: &TagMap,
    seen: &[TagObservation],
    at: MonotonicTime,
    seconds: f64,
    out: &mut Vec<Off>,
) {
    for (i, tag) in seen.iter().enumerate() {
        let others: Vec<TagObservation> = seen
            .iter()
            .enumerate()
            .filter_map(|(k, t)| (k != i).then_some(*t))
            .collect();
        let pose = Registrar::new(map.clone()).register(camera, &others, at);
        if let Some(pose) = pose {
            by_pose(camera, map, &[*tag], pose.map_from_camera, seconds, out);
        }
    }
}

/// Summary of all corners' errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reprojection {
    /// Root mean square error, pixels.
    pub rms: f64,
    /// Standard error of the root mean square, pixels; errors within one second are correlated.
    pub sigma: f64,
    /// Median error, pixels.
    pub median: f64,
    /// Maximum error, pixels.
    pub worst: f64,
    /// Mean error, pixels: the systematic part, from a wrong mounting, map or lens.
    pub mean: DVec2,
    /// Number of corners.
    pub corners: usize,
}

/// Summarises the errors; `None` without corners.
#[must_use]
pub fn sum_up(all: &[Off]) -> Option<Reprojection> {
    let lengths = || all.iter().map(|o| o.by.length());
    let rms = root_mean_square(lengths());
    Some(Reprojection {
        rms,
        sigma: standard_error(all, rms),
        median: median(lengths())?,
        worst: lengths().fold(0.0, f64::max),
        mean: all.iter().map(|o| o.by).sum::<DVec2>() / all.len() as f64,
        corners: all.len(),
    })
}

/// Returns the standard error of `rms`, from the scatter of the mean squares of single seconds.
fn standard_error(all: &[Off], rms: f64) -> f64 {
    let mut seconds: Vec<(i64, f64, f64)> = Vec::new();
    for off in all {
        let second = off.seconds.floor() as i64;
        let square = off.by.length_squared();
        match seconds.iter_mut().find(|s| s.0 == second) {
            Some(s) => (s.1, s.2) = (s.1 + square, s.2 + 1.0),
            None => seconds.push((second, square, 1.0)),
        }
    }
    let n = seconds.len() as f64;
    if n < 2.0 {
        return rms;
    }
    let scatter = seconds.iter().map(|s| (s.1 / s.2 - rms * rms).powi(2));
    let variance = scatter.sum::<f64>() / (n * (n - 1.0));
    variance.sqrt() / (2.0 * rms.max(1e-9))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use glam::{DQuat, DVec3};
    use penumbra_fiducials::synthetic::{camera, tag};

    /// Returns the tags in a camera's picture, each corner displaced by `noise`.
    fn seen(map: &TagMap, camera_from_map: RigidTransform, noise: DVec2) -> Vec<TagObservation> {
        let place = |c: DVec3| {
            camera()
                .project(camera_from_map.transform_point(c))
                .unwrap()
        };
        map.tags()
            .iter()
            .map(|tag| TagObservation {
                family: tag.family,
                id: tag.id,
                corners: tag.corners().map(|c| place(c) + noise),
                margin: 1.0,
                wrong_bits: 0,
            })
            .collect()
    }

    fn map() -> TagMap {
        let at = [(-0.1, -0.05), (0.12, 0.0), (0.0, 0.1)];
        let tags = at.iter().enumerate();
        let tags = tags.map(|(i, &(x, y))| tag(i as u32, 0.06, DVec3::new(x, y, 0.0)));
        TagMap::new(tags.collect()).unwrap()
    }

    fn pose() -> RigidTransform {
        RigidTransform::new(DQuat::from_rotation_x(0.5), DVec3::new(0.01, -0.02, 0.6))
    }

    #[test]
    fn constant_shift_of_corners_is_reported_as_mean() {
        let shift = DVec2::new(1.5, -2.0);
        let mut out = Vec::new();
        let tags = seen(&map(), pose(), shift);
        by_pose(&camera(), &map(), &tags, pose().inverse(), 0.0, &mut out);
        let sum = sum_up(&out).unwrap();
        assert!((sum.rms - 2.5).abs() < 1e-9 && sum.mean.distance(shift) < 1e-9);
        assert_eq!(sum.corners, 12);
    }

    #[test]
    fn moved_tag_has_error_against_the_others() {
        let mut tags = seen(&map(), pose(), DVec2::ZERO);
        for corner in &mut tags[1].corners {
            corner.x += 4.0;
        }
        let mut out = Vec::new();
        let at = MonotonicTime::from_nanos(0);
        by_the_others(&camera(), &map(), &tags, at, 0.0, &mut out);
        let moved = out.iter().filter(|o| (o.by.x - 4.0).abs() < 0.2).count();
        assert!(moved >= 4, "{out:?}");
    }

    #[test]
    fn standard_error_decreases_with_time() {
        let off = |i: usize| Off {
            at: DVec2::ZERO,
            by: DVec2::new([1.0, 2.0, 0.5, 1.5][i % 4], 0.0),
            seconds: i as f64,
        };
        let of = |n: usize| sum_up(&(0..n).map(off).collect::<Vec<_>>()).unwrap();
        assert!(of(64).sigma < 0.5 * of(8).sigma);
        assert!(sum_up(&[]).is_none());
    }
}
