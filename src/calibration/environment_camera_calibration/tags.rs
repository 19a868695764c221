//! Detects printed fiducials in the environment camera's picture. A fisheye curves their sides, so
//! that they are detected in overlapping perspective views, and the corners are mapped back through
//! the lens.

use super::super::intrinsics::Grey;
use super::view::View;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::FisheyeLens;
use penumbra_camera::Response;
use penumbra_fiducials::{Detector, Family, TagObservation};

/// Half of a view's angle, radians: views overlap by the size of a tag.
const HALF_ANGLE: f64 = 0.66;
/// Resolution of a view at its centre, relative to the picture's, against loss by resampling.
const OVERSAMPLING: f64 = 1.4;
/// Maximum side of a view, pixels.
const MAX_SIDE: f64 = 2400.0;

/// Detects the tags of these families, with corners in pixels of the camera. Of several detections of
/// one tag, the one with the largest margin is returned.
#[must_use]
pub fn detect_tags(
    codes: &Grey,
    view: &View,
    families: &[Family],
    response: &Response,
) -> Vec<TagObservation> {
    let mut detector = Detector::new(families, response);
    let mut seen: Vec<TagObservation> = match view {
        View::Pinhole(camera) => {
            let bytes: Vec<u8> = codes.data.iter().map(|v| v.round() as u8).collect();
            detector
                .detect_grey(&bytes, codes.width, codes.height, Some(camera))
                .to_vec()
        }
        View::Fisheye(lens) => through_fisheye(codes, lens, &mut detector),
    };
    seen.sort_by(|a, b| b.margin.total_cmp(&a.margin));
    let mut once: Vec<TagObservation> = Vec::new();
    for tag in seen {
        if !once
            .iter()
            .any(|t| (t.family, t.id) == (tag.family, tag.id))
        {
            once.push(tag);
        }
    }
    once
}

fn through_fisheye(
    codes: &Grey,
    lens: &FisheyeLens,
    detector: &mut Detector,
) -> Vec<TagObservation> {
    let focal = OVERSAMPLING * lens.focal;
    let side = (2.0 * HALF_ANGLE.tan() * focal).min(MAX_SIDE);
    let focal = side / (2.0 * HALF_ANGLE.tan());
    let side = side as usize;
    let centre = DVec2::splat(0.5 * (side as f64 - 1.0));
    let mut found = Vec::new();
    let mut flat = vec![0; side * side];
    for axis in axes(lens.max_theta) {
        let camera_from_view = upright(axis);
        let direction = |p: DVec2| camera_from_view * ((p - centre) / focal).extend(1.0);
        for (i, slot) in flat.iter_mut().enumerate() {
            let p = DVec2::new((i % side) as f64, (i / side) as f64);
            let pixel = lens.project(direction(p));
            *slot = pixel
                .filter(|p| codes.contains(*p, 0.0))
                .map_or(0, |p| codes.sample(p).round() as u8);
        }
        for tag in detector.detect_grey(&flat, side, side, None) {
            let corners = tag.corners.map(|c| lens.project(direction(c)));
            if let [Some(a), Some(b), Some(c), Some(d)] = corners {
                found.push(TagObservation {
                    corners: [a, b, c, d],
                    ..*tag
                });
            }
        }
    }
    found
}

/// Returns the axes of the views: one ahead, and rings about it half a view apart.
fn axes(max_theta: f64) -> Vec<DVec3> {
    let mut axes = vec![DVec3::Z];
    let mut theta = 0.8_f64;
    while theta < max_theta + 0.2 {
        let around = (theta.sin() * std::f64::consts::TAU / 0.8).ceil().max(4.0) as usize;
        for k in 0..around {
            let phi = std::f64::consts::TAU * k as f64 / around as f64;
            axes.push(DVec3::new(
                theta.sin() * phi.cos(),
                theta.sin() * phi.sin(),
                theta.cos(),
            ));
        }
        theta += 0.7;
    }
    axes
}

/// Returns a right-handed frame whose +Z is `axis`.
fn upright(axis: DVec3) -> DMat3 {
    let (x, y) = axis.any_orthonormal_pair();
    if x.cross(y).dot(axis) > 0.0 {
        DMat3::from_cols(x, y, axis)
    } else {
        DMat3::from_cols(y, x, axis)
    }
}
