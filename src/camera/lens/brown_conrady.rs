//! Brown–Conrady distortion, with OpenCV's optional denominator.

use super::{Distorted, newton_step};
use glam::{DVec2, DVec3};

/// Minimum ratio of a point's depth to its distance from the axis; below it there is no projection.
const MIN_DEPTH_RATIO: f64 = 1e-3;

// ┌ x = X/Z, y = Y/Z, s = x² + y²                                                       ┐
// │ g = (1 + k1 s + k2 s² + k3 s³) / (1 + k4 s + k5 s² + k6 s³)                         │
// │ x' = g x + 2 p1 x y + p2 (s + 2 x²),  y' = g y + p1 (s + 2 y²) + 2 p2 x y           │
// └ (OpenCV, "Camera Calibration and 3D Reconstruction")                                ┘
pub(super) fn distort(k: &[f64; 8], point: DVec3) -> Option<Distorted> {
    if point.z <= MIN_DEPTH_RATIO * point.truncate().length() || point.z <= 0.0 {
        return None;
    }
    let p = point.truncate() / point.z;
    let (point_out, by_x, by_y, by_coefficient) = on_plane(k, p)?;
    let inverse = 1.0 / point.z;
    Some(Distorted {
        point: point_out,
        by_point: [
            by_x * inverse,
            by_y * inverse,
            (by_x * p.x + by_y * p.y) * -inverse,
        ],
        by_coefficient,
    })
}

type OnPlane = (DVec2, DVec2, DVec2, [DVec2; 8]);

/// Returns the distorted point and its derivatives by x, y and the coefficients.
fn on_plane(k: &[f64; 8], p: DVec2) -> Option<OnPlane> {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = *k;
    let (x, y) = (p.x, p.y);
    let s = p.length_squared();
    let above = 1.0 + s * (k1 + s * (k2 + s * k3));
    let below = 1.0 + s * (k4 + s * (k5 + s * k6));
    if below <= 1e-3 {
        return None;
    }
    let g = above / below;
    let above_by_s = k1 + s * (2.0 * k2 + s * 3.0 * k3);
    let below_by_s = k4 + s * (2.0 * k5 + s * 3.0 * k6);
    let g_by_s = (above_by_s - g * below_by_s) / below;
    let tangential = DVec2::new(
        2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
        p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let cross = 2.0 * x * y * g_by_s + 2.0 * p1 * x + 2.0 * p2 * y;
    let by_x = DVec2::new(
        g + 2.0 * x * x * g_by_s + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
    );
    let by_y = DVec2::new(
        cross,
        g + 2.0 * y * y * g_by_s + 6.0 * p1 * y + 2.0 * p2 * x,
    );
    let up = p * (s / below);
    let down = p * (-g * s / below);
    let by_coefficient = [
        up,
        up * s,
        DVec2::new(2.0 * x * y, s + 2.0 * y * y),
        DVec2::new(s + 2.0 * x * x, 2.0 * x * y),
        up * (s * s),
        down,
        down * s,
        down * (s * s),
    ];
    Some((p * g + tangential, by_x, by_y, by_coefficient))
}

/// Inverse of [`distort`] by Newton's method from the distorted point, which is moved towards the
/// axis if it is outside the domain.
pub(super) fn undistort(k: &[f64; 8], distorted: DVec2) -> Option<DVec3> {
    let mut p = distorted;
    // With pincushion distortion the start can be outside the domain; Newton converges from within.
    while on_plane(k, p).is_none() && p.length() > 1e-3 {
        p *= 0.5;
    }
    for _ in 0..50 {
        let (at, by_x, by_y, _) = on_plane(k, p)?;
        let error = distorted - at;
        if error.length() < 1e-12 {
            break;
        }
        match newton_step(by_x, by_y, error) {
            Some(step) => p += step * (0.5 / step.length().max(0.5)),
            // Beyond the fold: the root is closer to the axis.
            None => p *= 0.7,
        }
    }
    let (at, by_x, by_y, _) = on_plane(k, p)?;
    let found = at.distance(distorted) < 1e-9 && newton_step(by_x, by_y, DVec2::ZERO).is_some();
    (found && has_no_fold_within(k, p)).then(|| p.extend(1.0).normalize())
}

/// Returns whether the distortion folds nowhere between the axis and `p`; otherwise `p` is a false root.
fn has_no_fold_within(k: &[f64; 8], p: DVec2) -> bool {
    (1..8).all(|i| {
        on_plane(k, p * (f64::from(i) / 8.0))
            .is_some_and(|(_, by_x, by_y, _)| newton_step(by_x, by_y, DVec2::ZERO).is_some())
    })
}
