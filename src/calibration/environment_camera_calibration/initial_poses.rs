//! Where to begin the search for a pose: places about the points, and turns by two sights.

use super::rays::Dice;
use super::resection::{Sight, Target, Unknowns, direction, off, place_of};
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, symmetric_eigen};

/// Good starts, one at least for each turn that suits.
pub(super) fn starts(
    seen: &[Sight],
    unknowns: Unknowns,
    near: Option<RigidTransform>,
) -> Vec<RigidTransform> {
    let places = match unknowns {
        Unknowns::Turn(place) => vec![place],
        // Only directions count there: see `place_of`.
        Unknowns::About { in_world, .. } => vec![in_world],
        Unknowns::Pose => lattice(seen, near),
    };
    let mut tried: Vec<(f64, RigidTransform)> = Vec::new();
    for place in places {
        let pairs = if unknowns == Unknowns::Pose { 12 } else { 400 };
        let turn = |t: DQuat| {
            place_of(unknowns, t)
                .map_or(RigidTransform::new(t, place), |p| RigidTransform::new(t, p))
        };
        let best = sampled_turns(seen, place, pairs).into_iter().map(turn);
        let mut best: Vec<_> = best.map(|p| (cost_at(seen, &p), p)).collect();
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        best.truncate(if unknowns == Unknowns::Pose { 1 } else { 8 });
        tried.append(&mut best);
    }
    tried.extend(near.map(|n| {
        (
            0.0,
            place_of(unknowns, n.rotation).map_or(n, |p| RigidTransform::new(n.rotation, p)),
        )
    }));
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    tried.truncate(40);
    tried.into_iter().map(|t| t.1).collect()
}

/// As [`cost`], but with a slope everywhere: a start may be far off.
fn cost_at(seen: &[Sight], pose: &RigidTransform) -> f64 {
    let mut offs: Vec<f64> = seen.iter().map(|s| off(s, pose)).collect();
    offs.sort_by(f64::total_cmp);
    // The better three quarters: a few may be wrong.
    let kept = (offs.len() * 3).div_ceil(4).max(2).min(offs.len());
    offs[..kept].iter().map(|o| o * o).sum()
}

/// Places about the points at which the camera may be.
fn lattice(seen: &[Sight], near: Option<RigidTransform>) -> Vec<DVec3> {
    let points: Vec<DVec3> = seen
        .iter()
        .filter_map(|s| match s.target {
            Target::Point(p) => Some(p),
            Target::Direction(_) => None,
        })
        .collect();
    let middle = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let size = points
        .iter()
        .map(|p| p.distance(middle))
        .fold(0.02, f64::max);
    let mut places: Vec<DVec3> = near.map(|n| n.translation).into_iter().collect();
    const AROUND: usize = 60;
    for scale in [0.2, 0.5, 1.0, 1.7, 3.0, 5.5, 10.0] {
        for k in 0..AROUND {
            // Evenly over the sphere (Fibonacci).
            let z = 1.0 - (2.0 * k as f64 + 1.0) / AROUND as f64;
            let turn = 2.399_963_229_728_653 * k as f64;
            let across = (1.0 - z * z).sqrt();
            let d = DVec3::new(across * turn.cos(), across * turn.sin(), z);
            places.push(middle + d * (scale * size));
        }
    }
    places
}

/// Turns `world_from_camera` by pairs of sights, and by all of them together.
fn sampled_turns(seen: &[Sight], place: DVec3, pairs: usize) -> Vec<DQuat> {
    let both = |s: &Sight| (s.bearing, direction(s.target, place), s.sigma.powi(-2));
    let all: Vec<_> = seen.iter().map(both).collect();
    let mut turns: Vec<DQuat> = wahba(&all).into_iter().collect();
    let mut dice = Dice::new();
    for _ in 0..pairs {
        let (i, j) = (dice.below(all.len()), dice.below(all.len()));
        if i != j && all[i].0.angle_between(all[j].0) > 0.05 {
            turns.extend(wahba(&[all[i], all[j]]));
        }
    }
    turns
}

/// The turn that brings the first directions nearest to the second ones (weight third); `None`
/// where they leave it open.
pub(super) fn wahba(pairs: &[(DVec3, DVec3, f64)]) -> Option<DQuat> {
    let total: f64 = pairs.iter().map(|p| p.2).sum();
    let mut k = Matrix::zeros(4, 4);
    for (from, to, weight) in pairs {
        let (f, t, w) = (from.to_array(), to.to_array(), weight / total);
        let cross = from.cross(*to).to_array();
        let dot = from.dot(*to);
        for i in 0..3 {
            for j in 0..3 {
                k[(i, j)] -= w * (t[i] * f[j] + f[i] * t[j]);
            }
            k[(i, i)] += w * dot;
            k[(i, 3)] -= w * cross[i];
            k[(3, i)] -= w * cross[i];
        }
        k[(3, 3)] -= w * dot;
    }
    let (values, vectors) = symmetric_eigen(&k);
    let q = vectors.row(0);
    (values[1] - values[0] > 1e-7)
        .then(|| DQuat::from_xyzw(q[0], q[1], q[2], q[3]).normalize())
        .filter(|q| q.is_finite())
}
