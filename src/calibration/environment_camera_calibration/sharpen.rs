//! The pose that suits sights best, from a start.

use super::rays::tukey;
use super::resection::{OUTLIER, Sight, Target, Unknowns, off, place_of};
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{NormalEquations, median_absolute, minimise};

/// Rows of a sight: how its two errors across the bearing change with the unknowns.
fn rows(seen: &Sight, pose: &RigidTransform, unknowns: Unknowns) -> [(f64, Vec<f64>); 2] {
    let inverse = pose.rotation.inverse();
    let (world, per_metre) = match seen.target {
        Target::Direction(d) => (d, 0.0),
        Target::Point(p) => {
            let way = p - pose.translation;
            (way.normalize_or(DVec3::Z), 1.0 / way.length().max(1e-6))
        }
    };
    let d = inverse * world;
    let (u, v) = seen.bearing.any_orthonormal_pair();
    [u, v].map(|axis| {
        // Behind the camera an error is still larger than beside it.
        let error = axis.dot(d) / (0.5 * (1.0 + seen.bearing.dot(d))).max(0.05).sqrt();
        // The camera turns by ω in its own frame: d changes by −ω × d.
        let mut row = axis.cross(d).to_array().to_vec();
        let by_place = |move_in_world: DVec3| {
            let across = move_in_world - world * world.dot(move_in_world);
            -axis.dot(inverse * across) * per_metre
        };
        match unknowns {
            Unknowns::Turn(_) => {}
            Unknowns::Pose => row.extend(DVec3::AXES.map(by_place)),
            Unknowns::About { in_camera, .. } => {
                // The place follows: p = X − R c, so dp = −R (ω × c).
                for (slot, a) in row.iter_mut().zip(DVec3::AXES) {
                    *slot += by_place(-(pose.rotation * a.cross(in_camera)));
                }
            }
        }
        (error, row)
    })
}

pub(super) fn linearise(
    seen: &[Sight],
    pose: &RigidTransform,
    unknowns: Unknowns,
    scale: f64,
) -> NormalEquations {
    let n = if unknowns == Unknowns::Pose { 6 } else { 3 };
    let mut normal = NormalEquations::new(n);
    for s in seen {
        let x = off(s, pose) / (s.sigma * scale);
        let weight = tukey(x) / (s.sigma * s.sigma);
        for (error, row) in rows(s, pose, unknowns) {
            normal.add(error, &row, weight);
        }
    }
    // What Tukey's function has left: the cost must not fall by letting go.
    let left = |s: &Sight| {
        let x = (off(s, pose) / (s.sigma * scale)).min(1.0);
        scale * scale / 3.0 * (1.0 - (1.0 - x * x).powi(3))
    };
    normal.cost = seen.iter().map(left).sum();
    normal
}

fn moved(pose: &RigidTransform, by: &[f64], unknowns: Unknowns) -> RigidTransform {
    let turn = DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2]));
    let rotation = (pose.rotation * turn).normalize();
    let place = match place_of(unknowns, rotation) {
        Some(place) => place,
        None => pose.translation + DVec3::new(by[3], by[4], by[5]),
    };
    RigidTransform::new(rotation, place)
}

/// From a start; first with everything, then stricter.
pub(super) fn refine(
    seen: &[Sight],
    unknowns: Unknowns,
    start: RigidTransform,
) -> Option<RigidTransform> {
    let mut pose = start;
    let start_off = median_absolute(seen.iter().map(|s| off(s, &pose) / s.sigma));
    let mut scale = (6.0 * start_off).max(2.0 * OUTLIER);
    loop {
        let at = |p: &RigidTransform| Some(linearise(seen, p, unknowns, scale));
        let found = minimise(pose, 30, at, |p, by| moved(p, by, unknowns))?;
        pose = found.state;
        if scale <= 2.0 * OUTLIER {
            return pose.translation.is_finite().then_some(pose);
        }
        scale = (0.3 * scale).max(2.0 * OUTLIER);
    }
}
