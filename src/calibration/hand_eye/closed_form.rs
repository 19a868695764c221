//! Solves A X = X B in closed form, and robustly by consensus.

use super::model::{MIN_PAIRS, Mounting, PosePair, median_length};
use super::refine::consistent;
use glam::{DMat3, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, best_rotation, rotation_vector, symmetric_eigen};

/// Maximum number of motions used.
const MAX_MOTIONS: usize = 600;
/// Random samples of the consensus.
const SAMPLES: u64 = 300;

/// The rig's motion between two instants, measured by sensor and camera: A X = X B.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    sensor: RigidTransform,
    camera: RigidTransform,
}

/// Returns motions between pairs that rotate by more than `min_rotation` radians, evenly
/// subsampled from all combinations.
pub(super) fn motions(pairs: &[PosePair], min_rotation: f64) -> Vec<Motion> {
    let n = pairs.len();
    let all = n * n.saturating_sub(1) / 2;
    // An odd stride, so that every time difference between the two poses occurs.
    let every = (all / MAX_MOTIONS).max(1) | 1;
    let ends = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    ends.step_by(every)
        .map(|(i, j)| between(&pairs[i], &pairs[j]))
        .filter(|m| rotation_vector(m.sensor.rotation).length() > min_rotation)
        .collect()
}

fn between(a: &PosePair, b: &PosePair) -> Motion {
    Motion {
        sensor: a.transmitter_from_sensor.inverse() * b.transmitter_from_sensor,
        camera: a.world_from_camera.inverse() * b.world_from_camera,
    }
}

/// Returns the largest rotation angle from the first pose, radians.
pub(super) fn largest_rotation(pairs: &[PosePair]) -> f64 {
    let angle = |p: &PosePair| {
        let first = pairs[0].transmitter_from_sensor.rotation;
        rotation_vector(first.inverse() * p.transmitter_from_sensor.rotation).length()
    };
    pairs.iter().map(angle).fold(0.0, f64::max)
}

/// Returns the RMS rotation about the second principal axis, radians: the square root of the
/// second eigenvalue of the mean of α αᵀ over the motions' rotation vectors α. The third may be
/// zero: rotations about two axes determine the mounting.
pub(super) fn second_axis(motions: &[Motion]) -> f64 {
    let mut sum = Matrix::zeros(3, 3);
    for m in motions {
        let a = rotation_vector(m.sensor.rotation).to_array();
        sum.add_outer(1.0 / motions.len() as f64, &a, &a);
    }
    symmetric_eigen(&sum).0[1].max(0.0).sqrt()
}

// ┌ A X = X B: rotation vectors obey α = R β, so R is the rotation between two clouds of    ┐
// │ vectors, max Σ αᵀ R β (Park & Martin 1994; by a quaternion, which cannot                │
// │ yield a reflection); then (R_A − 1) t = R t_B − t_A, linear in t.                       │
// └                                                                                        ┘
/// Returns `sensor_from_camera`; `None` if the motions do not determine it.
fn solve(motions: &[&Motion]) -> Option<RigidTransform> {
    let vectors = |m: &&Motion| {
        (
            rotation_vector(m.camera.rotation),
            rotation_vector(m.sensor.rotation),
            1.0,
        )
    };
    let rotation = best_rotation(motions.iter().map(vectors))?.rotation;
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for m in motions {
        let a = DMat3::from_quat(m.sensor.rotation) - DMat3::IDENTITY;
        let b = rotation * m.camera.translation - m.sensor.translation;
        normal += a.transpose() * a;
        right += a.transpose() * b;
    }
    let trace = normal.x_axis.x + normal.y_axis.y + normal.z_axis.z;
    let solvable = normal.determinant() > 1e-9 * trace.powi(3);
    solvable.then(|| RigidTransform::new(rotation, normal.inverse() * right))
}

/// Returns the mounting with the least median residual, from random samples of three motions
/// (least median of squares, Rousseeuw 1984), and which pairs are consistent with it.
pub(super) fn consensus(pairs: &[PosePair], motions: &[Motion]) -> Option<(Mounting, Vec<bool>)> {
    let mut random = 0x9E37_79B9_7F4A_7C15_u64;
    let mut draw = |below: usize| {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % below
    };
    let mut best: Option<(f64, RigidTransform)> = None;
    let all: Vec<&Motion> = motions.iter().collect();
    for i in 0..SAMPLES {
        let sample: Vec<&Motion> = if i == 0 {
            all.clone()
        } else {
            (0..3).map(|_| all[draw(all.len())]).collect()
        };
        let Some(x) = solve(&sample) else { continue };
        let residual = median_length(motions.iter().map(|m| motion_residual(m, x)));
        if best.is_none_or(|(b, _)| residual < b) {
            best = Some((residual, x));
        }
    }
    let (residual, x) = best?;
    // Solve again from all motions that are consistent with it.
    let inliers: Vec<&Motion> = motions
        .iter()
        .filter(|m| motion_residual(m, x).length() <= 3.0 * residual + 1e-9)
        .collect();
    let x = solve(&inliers).unwrap_or(x);
    let mounting = Mounting {
        sensor_from_camera: x,
        world_from_transmitter: transmitter_pose(pairs, x)?,
    };
    let used = consistent(pairs, &mounting);
    (used.iter().filter(|u| **u).count() >= MIN_PAIRS).then_some((mounting, used))
}

/// Returns the residual of A X = X B: rotation, weighted by a lever arm of 0.3 m, and translation,
/// metres.
fn motion_residual(m: &Motion, x: RigidTransform) -> DVec3 {
    let left = m.sensor * x;
    let right = x * m.camera;
    let rotation = rotation_vector(left.rotation.inverse() * right.rotation);
    let translation = left.translation - right.translation;
    DVec3::new(0.3 * rotation.length(), translation.length(), 0.0)
}

/// Returns the medoid of the `world_from_transmitter` that each pair implies: the one with the
/// least median distance to the others.
fn transmitter_pose(pairs: &[PosePair], x: RigidTransform) -> Option<RigidTransform> {
    let each: Vec<RigidTransform> = pairs
        .iter()
        .map(|p| p.world_from_camera * (p.transmitter_from_sensor * x).inverse())
        .collect();
    let median_distance = |a: &RigidTransform| {
        let difference = |b: &RigidTransform| {
            let rotation = rotation_vector(a.rotation.inverse() * b.rotation);
            DVec3::new(
                rotation.length(),
                a.translation.distance(b.translation),
                0.0,
            )
        };
        median_length(each.iter().map(difference))
    };
    let every = each.len().div_ceil(200);
    each.iter()
        .step_by(every)
        .min_by(|a, b| median_distance(a).total_cmp(&median_distance(b)))
        .copied()
}
