//! Reprojection errors of the markers under the calibration.

use glam::DVec2;
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::{Registrar, TagMap, TagObservation};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::{median, root_mean_square};

/// Reprojection error of a tag's corner: detected minus predicted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerError {
    /// Detected position, pixels.
    pub pixel: DVec2,
    /// Detected minus predicted position, pixels; `None` if the pose puts the corner behind the
    /// camera or outside the lens's range.
    pub error: Option<DVec2>,
    /// Seconds since the first picture.
    pub seconds: f64,
}

/// Appends the errors of all corners under a pose from another source (the tracker) to `out`.
pub fn add_pose_errors(
    camera: &PinholeCamera,
    map: &TagMap,
    seen: &[TagObservation],
    world_from_camera: RigidTransform,
    seconds: f64,
    out: &mut Vec<CornerError>,
) {
    let camera_from_world = world_from_camera.inverse();
    for tag in seen {
        let Some(known) = map.get(tag.family, tag.id) else {
            continue;
        };
        for (corner, pixel) in known.corners().into_iter().zip(tag.corners) {
            let predicted = camera.project(camera_from_world.transform_point(corner));
            out.push(CornerError {
                pixel,
                error: predicted.map(|predicted| pixel - predicted),
                seconds,
            });
        }
    }
}

/// Appends the errors of each tag's corners under the pose from the picture's other tags to `out`;
/// pictures with one tag contribute nothing.
pub fn add_leave_one_out_errors(
    camera: &PinholeCamera,
    map: &TagMap,
    seen: &[TagObservation],
    at: MonotonicTime,
    seconds: f64,
    out: &mut Vec<CornerError>,
) {
    for (i, tag) in seen.iter().enumerate() {
        let others: Vec<TagObservation> = seen
            .iter()
            .enumerate()
            .filter_map(|(k, t)| (k != i).then_some(*t))
            .collect();
        let pose = Registrar::new(map.clone()).register(camera, &others, at);
        if let Some(pose) = pose {
            add_pose_errors(camera, map, &[*tag], pose.map_from_camera, seconds, out);
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
    pub max: f64,
    /// Mean error, pixels: the systematic part, from a wrong mounting, map or lens.
    pub mean: DVec2,
    /// Number of corners with an error.
    pub corners: usize,
    /// Number of corners without: the pose puts them behind the camera or outside the lens's range.
    pub unseen: usize,
}

/// Summarises the errors; `None` without corners. Without a corner that has an error, the figures
/// are not numbers.
#[must_use]
pub fn summarise(all: &[CornerError]) -> Option<Reprojection> {
    if all.is_empty() {
        return None;
    }
    let errors = || all.iter().filter_map(|c| c.error);
    let lengths = || errors().map(DVec2::length);
    let corners = lengths().count();
    let rms = if corners == 0 {
        f64::NAN
    } else {
        root_mean_square(lengths())
    };
    Some(Reprojection {
        rms,
        sigma: standard_error(all, rms),
        median: median(lengths()).unwrap_or(f64::NAN),
        max: lengths().fold(0.0, f64::max),
        mean: errors().sum::<DVec2>() / corners as f64,
        corners,
        unseen: all.len() - corners,
    })
}

/// Returns the standard error of `rms`, from the scatter of the mean squares of single seconds.
fn standard_error(all: &[CornerError], rms: f64) -> f64 {
    let mut seconds: Vec<(i64, f64, f64)> = Vec::new();
    for corner in all {
        let Some(error) = corner.error else { continue };
        let second = corner.seconds.floor() as i64;
        let square = error.length_squared();
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

    use super::*;
    use glam::{DQuat, DVec3};
    use penumbra_fiducials::synthetic::{camera, tag};

    /// Returns the tags in a camera's picture, each corner displaced by `shift`.
    fn observations(
        map: &TagMap,
        camera_from_map: RigidTransform,
        shift: DVec2,
    ) -> Vec<TagObservation> {
        let project = |c: DVec3| {
            camera()
                .project(camera_from_map.transform_point(c))
                .unwrap()
        };
        map.tags()
            .iter()
            .map(|tag| TagObservation {
                family: tag.family,
                id: tag.id,
                corners: tag.corners().map(|c| project(c) + shift),
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
        let tags = observations(&map(), pose(), shift);
        add_pose_errors(&camera(), &map(), &tags, pose().inverse(), 0.0, &mut out);
        let summary = summarise(&out).unwrap();
        assert!((summary.rms - 2.5).abs() < 1e-9 && summary.mean.distance(shift) < 1e-9);
        assert_eq!(summary.corners, 12);
    }

    #[test]
    fn moved_tag_has_leave_one_out_error() {
        let mut tags = observations(&map(), pose(), DVec2::ZERO);
        for corner in &mut tags[1].corners {
            corner.x += 4.0;
        }
        let mut out = Vec::new();
        let at = MonotonicTime::from_nanos(0);
        add_leave_one_out_errors(&camera(), &map(), &tags, at, 0.0, &mut out);
        let moved = out
            .iter()
            .filter(|c| c.error.is_some_and(|e| (e.x - 4.0).abs() < 0.2))
            .count();
        assert!(moved >= 4, "{out:?}");
    }

    #[test]
    fn standard_error_decreases_with_time() {
        let corner = |i: usize| CornerError {
            pixel: DVec2::ZERO,
            error: Some(DVec2::new([1.0, 2.0, 0.5, 1.5][i % 4], 0.0)),
            seconds: i as f64,
        };
        let summary = |n: usize| summarise(&(0..n).map(corner).collect::<Vec<_>>()).unwrap();
        assert!(summary(64).sigma < 0.5 * summary(8).sigma);
        assert!(summarise(&[]).is_none());
    }

    #[test]
    fn corners_behind_the_camera_have_no_error() {
        let tags = observations(&map(), pose(), DVec2::ZERO);
        let mut out = Vec::new();
        let turn = RigidTransform::new(DQuat::from_rotation_y(std::f64::consts::PI), DVec3::ZERO);
        let away = pose().inverse() * turn;
        add_pose_errors(&camera(), &map(), &tags, away, 0.0, &mut out);
        let summary = summarise(&out).unwrap();
        assert_eq!((summary.corners, summary.unseen), (0, 12));
        assert!(summary.rms.is_nan(), "{summary:?}");
    }
}
