//! Printed fiducials through a fisheye: it bends their sides, so the picture is looked at in
//! flat views, cut out of it side by side, and corners go back through the lens.

use super::super::intrinsics::Grey;
use super::view::View;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::FisheyeLens;
use penumbra_camera::Response;
use penumbra_fiducials::{Detector, Family, TagSeen};

/// Half of a view's angle: wide enough for a tag that lies between two.
const HALF_ANGLE: f64 = 0.66;
/// Pixels of a view for one of the picture's, at its middle: what lies between pixels is not lost.
const FINER: f64 = 1.4;
/// Longest side of a view, pixels.
const MOST_SIDE: f64 = 2400.0;

/// The tags of these families, corners in pixels of the camera. Each once: the clearest.
#[must_use]
pub fn tags(codes: &Grey, view: &View, families: &[Family], response: &Response) -> Vec<TagSeen> {
    let mut detector = Detector::new(families, response);
    let mut seen: Vec<TagSeen> = match view {
        View::Pinhole(camera) => {
            let bytes: Vec<u8> = codes.data.iter().map(|v| v.round() as u8).collect();
            detector
                .detect_grey(&bytes, codes.width, codes.height, Some(camera))
                .to_vec()
        }
        View::Fisheye(lens) => through_fisheye(codes, lens, &mut detector),
    };
    seen.sort_by(|a, b| b.margin.total_cmp(&a.margin));
    let mut once: Vec<TagSeen> = Vec::new();
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

fn through_fisheye(codes: &Grey, lens: &FisheyeLens, detector: &mut Detector) -> Vec<TagSeen> {
    let focal = FINER * lens.focal;
    let side = (2.0 * HALF_ANGLE.tan() * focal).min(MOST_SIDE);
    let focal = side / (2.0 * HALF_ANGLE.tan());
    let side = side as usize;
    let middle = DVec2::splat(0.5 * (side as f64 - 1.0));
    let mut found = Vec::new();
    let mut flat = vec![0; side * side];
    for axis in axes(lens.max_theta) {
        let camera_from_view = upright(axis);
        let direction = |p: DVec2| camera_from_view * ((p - middle) / focal).extend(1.0);
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
                found.push(TagSeen {
                    corners: [a, b, c, d],
                    ..*tag
                });
            }
        }
    }
    found
}

/// Where the views look: one ahead, rings about it half a view apart.
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

/// A frame whose +Z is `axis`.
fn upright(axis: DVec3) -> DMat3 {
    let (x, y) = axis.any_orthonormal_pair();
    // Right-handed: x × y = z.
    if x.cross(y).dot(axis) > 0.0 {
        DMat3::from_cols(x, y, axis)
    } else {
        DMat3::from_cols(y, x, axis)
    }
}
