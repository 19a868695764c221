//! The twin of `lib/area_lamps.wgsl`: the light of a rectangle on a surface.

use glam::DVec3;
use std::f64::consts::TAU;

/// Returns the fraction of the cosine-weighted hemisphere about the unit normal `n` that a convex
/// polygon fills, whose `corners` are relative to the point: Lambert's formula (Photometria, 1760)
/// over the part of the polygon above the horizon.
#[must_use]
pub fn form_factor(corners: &[DVec3], n: DVec3) -> f64 {
    let above = above_horizon(corners, n);
    let arcs = above.iter().zip(above.iter().cycle().skip(1));
    let sum: f64 = arcs
        .map(|(a, b)| {
            let axis = a.cross(*b).normalize_or_zero();
            axis.dot(n) * a.angle_between(*b)
        })
        .sum();
    sum.abs() / TAU
}

/// Clips the polygon by the horizon plane (Sutherland and Hodgman 1974).
fn above_horizon(corners: &[DVec3], n: DVec3) -> Vec<DVec3> {
    let mut kept = Vec::new();
    for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        let (ha, hb) = (a.dot(n), b.dot(n));
        if ha > 0.0 {
            kept.push(*a);
        }
        if (ha > 0.0) != (hb > 0.0) {
            kept.push(a.lerp(*b, ha / (ha - hb)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integrates the form factor by midpoints of small patches.
    fn integrated(corners: &[DVec3; 4], n: DVec3) -> f64 {
        const SIDE: usize = 1500;
        let (u, v) = (corners[1] - corners[0], corners[3] - corners[0]);
        let normal = u.cross(v);
        let patch = normal.length() / (SIDE * SIDE) as f64;
        let normal = normal.normalize();
        let at = |i: usize| (i as f64 + 0.5) / SIDE as f64;
        let mut sum = 0.0;
        for i in 0..SIDE * SIDE {
            let p = corners[0] + u * at(i % SIDE) + v * at(i / SIDE);
            let r2 = p.length_squared();
            sum += p.dot(n).max(0.0) * p.dot(normal).abs() / (r2 * r2);
        }
        sum * patch / std::f64::consts::PI
    }

    fn rectangle(centre: DVec3, right: DVec3, up: DVec3) -> [DVec3; 4] {
        [-right - up, right - up, right + up, up - right].map(|off| centre + off)
    }

    #[test]
    fn overhead_square_has_the_catalogues_form_factor() {
        // Element parallel to a square of side a at height a over its corner (Howell, B-3):
        // 2 / 2π · (1/√2) atan(1/√2).
        let square = [
            DVec3::new(0.0, 0.0, 1.0),
            DVec3::new(1.0, 0.0, 1.0),
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(0.0, 1.0, 1.0),
        ];
        let half = 0.5_f64.sqrt();
        let expected = half * half.atan() / std::f64::consts::PI;
        assert!((form_factor(&square, DVec3::Z) - expected).abs() < 1e-12);
    }

    #[test]
    fn form_factor_equals_the_integral_near_by_and_across_the_horizon() {
        let upright = rectangle(DVec3::new(0.0, 0.5, 0.1), DVec3::X * 0.3, DVec3::Z * 0.3);
        let close = rectangle(DVec3::new(0.1, 0.0, 0.03), DVec3::X * 0.3, DVec3::Y * 0.2);
        let slanting = rectangle(
            DVec3::new(0.3, 0.2, 0.1),
            DVec3::new(0.2, -0.2, 0.1),
            DVec3::new(0.1, 0.15, 0.1),
        );
        for corners in [upright, close, slanting] {
            for n in [
                DVec3::Z,
                DVec3::new(0.6, 0.0, 0.8),
                DVec3::new(0.0, -0.6, 0.8),
                DVec3::new(0.0, 0.96, -0.28),
            ] {
                let (ours, truth) = (form_factor(&corners, n), integrated(&corners, n));
                assert!((ours - truth).abs() < 2e-4, "{n}: {ours} {truth}");
            }
        }
    }

    #[test]
    fn rectangle_below_the_horizon_gives_no_light() {
        let below = rectangle(DVec3::new(0.0, 0.5, -0.4), DVec3::X * 0.3, DVec3::Z * 0.3);
        assert_eq!(form_factor(&below, DVec3::Z), 0.0);
    }
}
