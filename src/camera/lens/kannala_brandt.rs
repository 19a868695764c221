//! Kannala–Brandt fisheye (Kannala & Brandt 2006, in the form of OpenCV's `fisheye` and Kalibr's
//! `equidistant`).

use super::Distorted;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

// ┌ r = √(X² + Y²), θ = atan2(r, Z), d(θ) = θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹           ┐
// └ x' = d X / r, y' = d Y / r                                                          ┘
pub(super) fn distort(k: &[f64; 8], point: DVec3) -> Option<Distorted> {
    let p = point.truncate();
    let r = p.length();
    if r < 1e-9 * point.z {
        return Some(on_axis(p, point.z));
    }
    if r <= 1e-6 * -point.z || r == 0.0 {
        return None;
    }
    let theta = r.atan2(point.z);
    let (d, slope) = polynomial(k, theta);
    let outwards = p / r;
    let square = r * r + point.z * point.z;
    let theta_by_r = point.z / square;
    // Along the radius d changes with θ; across it the point rotates about the axis.
    let across = outwards.perp() * (d / r);
    let along = outwards * (slope * theta_by_r);
    let powers = |n: i32| outwards * theta.powi(n);
    let mut by_coefficient = [DVec2::ZERO; 8];
    for (slot, n) in by_coefficient.iter_mut().zip([3, 5, 7, 9]) {
        *slot = powers(n);
    }
    Some(Distorted {
        point: outwards * d,
        by_point: [
            along * outwards.x + across * outwards.perp().x,
            along * outwards.y + across * outwards.perp().y,
            outwards * (-slope * r / square),
        ],
        by_coefficient,
    })
}

fn on_axis(p: DVec2, z: f64) -> Distorted {
    Distorted {
        point: p / z,
        by_point: [DVec2::X / z, DVec2::Y / z, p / (-z * z)],
        by_coefficient: [DVec2::ZERO; 8],
    }
}

/// Returns d and ∂d/∂θ.
fn polynomial(k: &[f64; 8], theta: f64) -> (f64, f64) {
    let [k1, k2, k3, k4, ..] = *k;
    let t = theta * theta;
    (
        theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)))),
        1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4))),
    )
}

/// Inverse of [`distort`]: the smallest θ at which d(θ) is the radius, by Newton's method, with
/// bisection where that would leave the interval over which d increases.
pub(super) fn undistort(k: &[f64; 8], distorted: DVec2) -> Option<DVec3> {
    let radius = distorted.length();
    if radius < 1e-12 {
        return Some(distorted.extend(1.0).normalize());
    }
    let (mut low, mut high) = bracket(k, radius)?;
    let mut theta = 0.5 * (low + high);
    for _ in 0..100 {
        let (d, slope) = polynomial(k, theta);
        if d < radius {
            low = theta;
        } else {
            high = theta;
        }
        let newton = theta - (d - radius) / slope;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        let moved = (next - theta).abs();
        theta = next;
        if moved < 1e-14 {
            break;
        }
    }
    let outwards = distorted / radius;
    Some((outwards * theta.sin()).extend(theta.cos()))
}

/// Returns two angles between which d first reaches the radius while increasing; `None` if it
/// stops increasing before, or does not reach it up to 180°.
fn bracket(k: &[f64; 8], radius: f64) -> Option<(f64, f64)> {
    const STEPS: i32 = 90;
    let mut low = 0.0;
    for i in 1..=STEPS {
        let theta = f64::from(i) * PI / f64::from(STEPS);
        let (d, slope) = polynomial(k, theta);
        if d >= radius {
            return Some((low, theta));
        }
        if slope <= 0.0 {
            return None;
        }
        low = theta;
    }
    None
}
