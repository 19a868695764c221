//! A tracker's readings that are far off for a moment: a bit that flipped, a flash of metal.

use penumbra_interface::RigidTransform;
use penumbra_numerics::median;

/// A jump is off by so many times the usual,
const JUMP: f64 = 8.0;
/// and by more than this over neighbours 16 ms apart, metres and radians: no hand's motion bends as
/// quickly.
const LEAST: [f64; 2] = [0.003, 0.01];
const LEAST_OVER: f64 = 0.016;
/// Rounds: two jumps side by side hide one another until the worse is gone.
const ROUNDS: usize = 4;

/// Leaves readings out that lie far off the line between their neighbours, farther than these off
/// theirs. Stamps in seconds, in order.
pub(crate) fn without_jumps(
    mut readings: Vec<(f64, RigidTransform)>,
) -> Vec<(f64, RigidTransform)> {
    for _ in 0..ROUNDS {
        let off: Vec<[f64; 2]> = (0..readings.len()).map(|i| off(&readings, i)).collect();
        let usual = [0, 1].map(|k| median(off.iter().map(|o| o[k])).unwrap_or(0.0));
        let jumps = |i: usize, k: usize| {
            let over = readings
                .get(i + 1)
                .map_or(0.0, |next| next.0 - readings[i - 1].0);
            let least = LEAST[k] * (over / LEAST_OVER).powi(2).max(1.0);
            let beside = off[i - 1][k].max(off.get(i + 1).map_or(0.0, |o| o[k]));
            off[i][k] > (JUMP * usual[k]).max(least) && off[i][k] >= beside
        };
        let last = readings.len().saturating_sub(1);
        let kept: Vec<bool> = (0..readings.len())
            .map(|i| i == 0 || i == last || !(jumps(i, 0) || jumps(i, 1)))
            .collect();
        if kept.iter().all(|kept| *kept) {
            break;
        }
        let mut kept = kept.into_iter();
        readings.retain(|_| kept.next().unwrap_or(true));
    }
    readings
}

/// Metres and radians of a reading off the line between its neighbours; none at the ends.
fn off(readings: &[(f64, RigidTransform)], i: usize) -> [f64; 2] {
    let (Some(before), Some(after)) = (i.checked_sub(1), readings.get(i + 1)) else {
        return [0.0; 2];
    };
    let ((from, a), (at, own), (to, b)) = (&readings[before], &readings[i], after);
    let share = (at - from) / (to - from).max(1e-9);
    let place = a.translation.lerp(b.translation, share);
    let turn = a.rotation.slerp(b.rotation, share);
    [
        own.translation.distance(place),
        own.rotation.angle_between(turn),
    ]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use glam::{DQuat, DVec3};
    use penumbra_numerics::Random;

    #[test]
    fn jumps_are_left_out_and_motion_is_not() {
        let mut random = Random::new(5);
        let readings: Vec<(f64, RigidTransform)> = (0..1200)
            .map(|i| {
                let t = f64::from(i) / 120.0;
                let swing = DVec3::new((9.0 * t).sin(), (7.0 * t).cos(), 0.2) * 0.2;
                let rotation = DQuat::from_scaled_axis(swing + random.normal3() * 1e-3);
                let place = 0.1 * swing + random.normal3() * 3e-4;
                (t, RigidTransform::new(rotation, place))
            })
            .collect();
        assert_eq!(without_jumps(readings.clone()).len(), readings.len());
        let mut shaken = readings;
        let jumped = [40, 41, 300, 777, 1100];
        for i in jumped {
            shaken[i].1.translation += DVec3::new(0.06, -0.02, 0.03);
            shaken[i].1.rotation *= DQuat::from_rotation_x(0.08);
        }
        let kept = without_jumps(shaken.clone());
        let gone: Vec<usize> = (0..shaken.len())
            .filter(|i| !kept.iter().any(|k| k.0 == shaken[*i].0))
            .collect();
        assert!(jumped.iter().all(|i| gone.contains(i)), "{gone:?}");
        // Beside two jumps in a row a good one may go with them.
        assert!(gone.len() <= jumped.len() + 2, "{gone:?}");
        assert!(without_jumps(Vec::new()).is_empty());
        assert_eq!(without_jumps(shaken[..2].to_vec()).len(), 2);
    }
}
