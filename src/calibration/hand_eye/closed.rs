//! A X = X B in closed form, and by consensus.

use super::{LEAST, Mounting, PosePair, middle};
use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, symmetric_eigen};

/// Motions that are looked at.
const MOST_MOTIONS: usize = 600;
/// Draws of the consensus.
const DRAWS: u64 = 300;

/// The rig's motion between two instants, as sensor and camera see it: A X = X B.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    sensor: RigidTransform,
    camera: RigidTransform,
}

/// Angle times axis, the short way round.
pub(super) fn rotation_vector(q: DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    q.to_scaled_axis()
}

/// Motions between pairs that turn by at least `least` radians, spread over all of them.
pub(super) fn motions(pairs: &[PosePair], least: f64) -> Vec<Motion> {
    let n = pairs.len();
    let all = n * n.saturating_sub(1) / 2;
    // A stride that shares no factor with short cycles, so that every gap in time occurs.
    let every = (all / MOST_MOTIONS).max(1) | 1;
    let ends = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    ends.step_by(every)
        .map(|(i, j)| between(&pairs[i], &pairs[j]))
        .filter(|m| rotation_vector(m.sensor.rotation).length() > least)
        .collect()
}

fn between(a: &PosePair, b: &PosePair) -> Motion {
    Motion {
        sensor: a.transmitter_from_sensor.inverse() * b.transmitter_from_sensor,
        camera: a.world_from_camera.inverse() * b.world_from_camera,
    }
}

pub(super) fn largest_turn(pairs: &[PosePair]) -> f64 {
    let turn = |p: &PosePair| {
        let first = pairs[0].transmitter_from_sensor.rotation;
        rotation_vector(first.inverse() * p.transmitter_from_sensor.rotation).length()
    };
    pairs.iter().map(turn).fold(0.0, f64::max)
}

/// √ of the second eigenvalue of the mean of α αᵀ over the turns' rotation vectors α: how
/// much the rig turned about a second axis. The third may be zero: two axes tell all.
pub(super) fn spread_of_axes(motions: &[Motion]) -> f64 {
    let mut sum = Matrix::zeros(3, 3);
    for m in motions {
        let a = rotation_vector(m.sensor.rotation).to_array();
        sum.add_outer(1.0 / motions.len() as f64, &a, &a);
    }
    symmetric_eigen(&sum).0[1].max(0.0).sqrt()
}

// ┌ A X = X B: rotation vectors obey α = R β, so R is the rotation between two clouds of    ┐
// │ vectors, max Σ αᵀ R β (Park & Martin 1994; by Horn's quaternion 1987, which cannot       │
// │ come out mirrored); then (R_A − 1) t = R t_B − t_A, linear in t.                        │
// └                                                                                        ┘
/// `sensor_from_camera`; `None` if the motions leave it open.
pub(super) fn relative(motions: &[&Motion]) -> Option<RigidTransform> {
    let turns = |m: &&Motion| {
        (
            rotation_vector(m.sensor.rotation),
            rotation_vector(m.camera.rotation),
        )
    };
    let rotation = best_rotation(motions.iter().map(turns))?;
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

/// The rotation R for which a ≈ R b over pairs (a, b); `None` of nothing.
pub(crate) fn best_rotation(pairs: impl Iterator<Item = (DVec3, DVec3)>) -> Option<DQuat> {
    let mut s = DMat3::ZERO;
    for (a, b) in pairs {
        s += DMat3::from_cols(b * a.x, b * a.y, b * a.z);
    }
    horn(s)
}

/// The rotation R that maximises Σ aᵀ R b, where `s` = Σ b aᵀ.
fn horn(s: DMat3) -> Option<DQuat> {
    let at = |i: usize, j: usize| s.col(j)[i];
    let (xx, yy, zz) = (at(0, 0), at(1, 1), at(2, 2));
    let n = [
        [
            xx + yy + zz,
            at(1, 2) - at(2, 1),
            at(2, 0) - at(0, 2),
            at(0, 1) - at(1, 0),
        ],
        [0.0, xx - yy - zz, at(0, 1) + at(1, 0), at(2, 0) + at(0, 2)],
        [0.0, 0.0, yy - xx - zz, at(1, 2) + at(2, 1)],
        [0.0, 0.0, 0.0, zz - xx - yy],
    ];
    let mut m = Matrix::zeros(4, 4);
    for i in 0..4 {
        for j in i..4 {
            m[(i, j)] = n[i][j];
            m[(j, i)] = n[i][j];
        }
    }
    let (_, vectors) = symmetric_eigen(&m);
    let [w, x, y, z] = *vectors.row(3) else {
        return None;
    };
    let q = DQuat::from_xyzw(x, y, z, w);
    (q.length() > 0.5).then(|| q.normalize())
}

/// The mounting on which most pairs agree, from motions drawn at random three at a time,
/// judged by the median of what is left (least median of squares, Rousseeuw 1984), and which
/// pairs those are.
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
    for i in 0..DRAWS {
        let sample: Vec<&Motion> = if i == 0 {
            all.clone()
        } else {
            (0..3).map(|_| all[draw(all.len())]).collect()
        };
        let Some(x) = relative(&sample) else { continue };
        let left = middle(motions.iter().map(|m| motion_residual(m, x)));
        if best.is_none_or(|(b, _)| left < b) {
            best = Some((left, x));
        }
    }
    let (left, x) = best?;
    // Again from all motions that agree with it.
    let agree: Vec<&Motion> = motions
        .iter()
        .filter(|m| motion_residual(m, x).length() <= 3.0 * left + 1e-9)
        .collect();
    let x = relative(&agree).unwrap_or(x);
    let mounting = Mounting {
        sensor_from_camera: x,
        world_from_transmitter: transmitter(pairs, x)?,
    };
    let used = super::refine::agreeing(pairs, &mounting);
    (used.iter().filter(|u| **u).count() >= LEAST).then_some((mounting, used))
}

/// What is left of A X = X B, rotation and translation in one: a lever of 0.3 m makes
/// radians of metres.
fn motion_residual(m: &Motion, x: RigidTransform) -> DVec3 {
    let left = m.sensor * x;
    let right = x * m.camera;
    let turn = rotation_vector(left.rotation.inverse() * right.rotation);
    let shift = left.translation - right.translation;
    DVec3::new(0.3 * turn.length(), shift.length(), 0.0)
}

/// `world_from_transmitter` by each pair, and of these the one in the middle.
fn transmitter(pairs: &[PosePair], x: RigidTransform) -> Option<RigidTransform> {
    let each: Vec<RigidTransform> = pairs
        .iter()
        .map(|p| p.world_from_camera * (p.transmitter_from_sensor * x).inverse())
        .collect();
    let far = |a: &RigidTransform| {
        let from = |b: &RigidTransform| {
            let turn = rotation_vector(a.rotation.inverse() * b.rotation);
            DVec3::new(turn.length(), a.translation.distance(b.translation), 0.0)
        };
        middle(each.iter().map(from))
    };
    let every = each.len().div_ceil(200);
    each.iter()
        .step_by(every)
        .min_by(|a, b| far(a).total_cmp(&far(b)))
        .copied()
}
