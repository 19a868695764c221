//! Robust least-squares refinement of a pose.

use super::model::{OUTLIER, Observation, Target, Unknowns, deviation, position};
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{NormalEquations, median_absolute, minimise, tukey_weight};

/// Returns the two errors of an observation across its bearing, with their derivatives by the unknowns.
fn rows(seen: &Observation, pose: &RigidTransform, unknowns: Unknowns) -> [(f64, Vec<f64>); 2] {
    let inverse = pose.rotation.inverse();
    let (world, per_metre) = match seen.target {
        Target::Direction(d) => (d, 0.0),
        Target::Point(p) => {
            let path = p - pose.translation;
            (path.normalize_or(DVec3::Z), 1.0 / path.length().max(1e-6))
        }
    };
    let d = inverse * world;
    let (u, v) = seen.bearing.any_orthonormal_pair();
    [u, v].map(|axis| {
        // The divisor lets the error grow up to the direction opposite to the bearing.
        let error = axis.dot(d) / (0.5 * (1.0 + seen.bearing.dot(d))).max(0.05).sqrt();
        // A rotation of the camera by ω in its own frame changes d by −ω × d.
        let mut row = axis.cross(d).to_array().to_vec();
        let by_position = |translation: DVec3| {
            let across = translation - world * world.dot(translation);
            -axis.dot(inverse * across) * per_metre
        };
        match unknowns {
            Unknowns::Orientation(_) => {}
            Unknowns::Pose => row.extend(DVec3::AXES.map(by_position)),
            Unknowns::OrientationAbout { in_camera, .. } => {
                // The position follows: p = X − R c, so that dp = −R (ω × c).
                for (slot, a) in row.iter_mut().zip(DVec3::AXES) {
                    *slot += by_position(-(pose.rotation * a.cross(in_camera)));
                }
            }
        }
        (error, row)
    })
}

/// Linearises the deviations at a pose, with Tukey's weights; observations that deviate by more than
/// `scale` standard deviations have no weight.
pub(super) fn linearise(
    seen: &[Observation],
    pose: &RigidTransform,
    unknowns: Unknowns,
    scale: f64,
) -> NormalEquations {
    let n = if unknowns == Unknowns::Pose { 6 } else { 3 };
    let mut normal = NormalEquations::new(n);
    for s in seen {
        let x = deviation(s, pose) / (s.sigma * scale);
        let weight = tukey_weight(x) / (s.sigma * s.sigma);
        for (error, row) in rows(s, pose, unknowns) {
            normal.add(error, &row, weight);
        }
    }
    // Tukey's loss rather than the weighted squares, which would fall as observations lose weight.
    let loss = |s: &Observation| {
        let x = (deviation(s, pose) / (s.sigma * scale)).min(1.0);
        scale * scale / 3.0 * (1.0 - (1.0 - x * x).powi(3))
    };
    normal.cost = seen.iter().map(loss).sum();
    normal
}

/// Applies a step of the minimisation.
fn stepped(pose: &RigidTransform, by: &[f64], unknowns: Unknowns) -> RigidTransform {
    let step = DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2]));
    let rotation = (pose.rotation * step).normalize();
    let position = position(unknowns, rotation)
        .unwrap_or_else(|| pose.translation + DVec3::new(by[3], by[4], by[5]));
    RigidTransform::new(rotation, position)
}

/// Refines an initial pose: first with all observations, then with a decreasing scale of the weights.
pub(super) fn refine(
    seen: &[Observation],
    unknowns: Unknowns,
    start: RigidTransform,
) -> Option<RigidTransform> {
    let mut pose = start;
    let initial = median_absolute(seen.iter().map(|s| deviation(s, &pose) / s.sigma));
    let mut scale = (6.0 * initial).max(2.0 * OUTLIER);
    loop {
        let at = |p: &RigidTransform| Some(linearise(seen, p, unknowns, scale));
        let found = minimise(pose, 30, at, |p, by| stepped(p, by, unknowns))?;
        pose = found.state;
        if scale <= 2.0 * OUTLIER {
            return pose.translation.is_finite().then_some(pose);
        }
        scale = (0.3 * scale).max(2.0 * OUTLIER);
    }
}
