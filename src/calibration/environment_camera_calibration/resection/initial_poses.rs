//! Initial poses of the resection: positions about the points, and orientations from two
//! observations.

use super::super::light_matching::determined_rotation;
use super::super::rays::RandomIndices;
use super::model::{Observation, Target, Unknowns, deviation, direction, position};
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;

/// Returns initial poses, at least one for each plausible orientation.
pub(super) fn initial_poses(
    seen: &[Observation],
    unknowns: Unknowns,
    near: Option<RigidTransform>,
) -> Vec<RigidTransform> {
    let positions = match unknowns {
        Unknowns::Orientation(position) => vec![position],
        // The position follows from the orientation: see `position`.
        Unknowns::OrientationAbout { in_world, .. } => vec![in_world],
        Unknowns::Pose => lattice(seen, near),
    };
    let mut tried: Vec<(f64, RigidTransform)> = Vec::new();
    for at in positions {
        let pairs = if unknowns == Unknowns::Pose { 12 } else { 400 };
        let pose = |r: DQuat| RigidTransform::new(r, position(unknowns, r).unwrap_or(at));
        let best = sampled_rotations(seen, at, pairs).into_iter().map(pose);
        let mut best: Vec<_> = best.map(|p| (trimmed_cost(seen, &p), p)).collect();
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        best.truncate(if unknowns == Unknowns::Pose { 1 } else { 8 });
        tried.append(&mut best);
    }
    tried.extend(near.map(|n| {
        (
            0.0,
            position(unknowns, n.rotation).map_or(n, |p| RigidTransform::new(n.rotation, p)),
        )
    }));
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    tried.truncate(40);
    tried.into_iter().map(|t| t.1).collect()
}

/// Returns the sum of squared deviations, rad², over the better three quarters of the observations: a
/// few may be wrong. It has a gradient everywhere, as an initial pose may have large errors.
fn trimmed_cost(seen: &[Observation], pose: &RigidTransform) -> f64 {
    let mut deviations: Vec<f64> = seen.iter().map(|s| deviation(s, pose)).collect();
    deviations.sort_by(f64::total_cmp);
    let count = deviations.len();
    let kept = (count * 3).div_ceil(4).max(2).min(count);
    deviations[..kept].iter().map(|d| d * d).sum()
}

/// Returns possible positions of the camera about the points.
fn lattice(seen: &[Observation], near: Option<RigidTransform>) -> Vec<DVec3> {
    let points: Vec<DVec3> = seen
        .iter()
        .filter_map(|s| match s.target {
            Target::Point(p) => Some(p),
            Target::Direction(_) => None,
        })
        .collect();
    let centroid = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let size = points
        .iter()
        .map(|p| p.distance(centroid))
        .fold(0.02, f64::max);
    let mut positions: Vec<DVec3> = near.map(|n| n.translation).into_iter().collect();
    const AROUND: usize = 60;
    for scale in [0.2, 0.5, 1.0, 1.7, 3.0, 5.5, 10.0] {
        for k in 0..AROUND {
            // Evenly over the sphere (Fibonacci).
            let z = 1.0 - (2.0 * k as f64 + 1.0) / AROUND as f64;
            let angle = 2.399_963_229_728_653 * k as f64;
            let across = (1.0 - z * z).sqrt();
            let d = DVec3::new(across * angle.cos(), across * angle.sin(), z);
            positions.push(centroid + d * (scale * size));
        }
    }
    positions
}

/// Returns the orientations `world_from_camera` from random pairs of observations, and from all of
/// them together.
fn sampled_rotations(seen: &[Observation], at: DVec3, pairs: usize) -> Vec<DQuat> {
    let both = |s: &Observation| (s.bearing, direction(s.target, at), s.sigma.powi(-2));
    let all: Vec<_> = seen.iter().map(both).collect();
    let mut rotations: Vec<DQuat> = determined_rotation(&all).into_iter().collect();
    let mut random = RandomIndices::new();
    for _ in 0..pairs {
        let (i, j) = (random.below(all.len()), random.below(all.len()));
        if i != j && all[i].0.angle_between(all[j].0) > 0.05 {
            rotations.extend(determined_rotation(&[all[i], all[j]]));
        }
    }
    rotations
}
