//! Removes momentary jumps from a tracker's readings, e.g. by a flipped bit or by metal moved past the
//! sensor.

use penumbra_interface::RigidTransform;
use penumbra_numerics::median;

/// Minimum deviation of a jump, as a multiple of the median deviation.
const MIN_JUMP_RATIO: f64 = 8.0;
/// Minimum deviation of a jump whose neighbours are `MIN_JUMP_SECONDS` apart, metres and radians: a
/// hand cannot accelerate as quickly.
const MIN_JUMP: [f64; 2] = [0.003, 0.01];
/// Interval between the neighbours to which `MIN_JUMP` applies, seconds.
const MIN_JUMP_SECONDS: f64 = 0.016;
/// Maximum number of passes: adjacent jumps mask one another until the larger is removed.
const MAX_PASSES: usize = 4;

/// Removes readings that deviate strongly from the line between their neighbours, and by more than
/// the neighbours deviate from theirs. Time stamps in seconds, increasing.
pub(crate) fn without_jumps(
    mut readings: Vec<(f64, RigidTransform)>,
) -> Vec<(f64, RigidTransform)> {
    for _ in 0..MAX_PASSES {
        let deviations: Vec<[f64; 2]> = (0..readings.len())
            .map(|i| deviation(&readings, i))
            .collect();
        let typical = [0, 1].map(|k| median(deviations.iter().map(|d| d[k])).unwrap_or(0.0));
        let is_jump = |i: usize, k: usize| {
            let interval = readings
                .get(i + 1)
                .map_or(0.0, |next| next.0 - readings[i - 1].0);
            let min = MIN_JUMP[k] * (interval / MIN_JUMP_SECONDS).powi(2).max(1.0);
            let after = deviations.get(i + 1).map_or(0.0, |d| d[k]);
            let of_neighbours = deviations[i - 1][k].max(after);
            deviations[i][k] > (MIN_JUMP_RATIO * typical[k]).max(min)
                && deviations[i][k] >= of_neighbours
        };
        let last = readings.len().saturating_sub(1);
        let kept: Vec<bool> = (0..readings.len())
            .map(|i| i == 0 || i == last || !(is_jump(i, 0) || is_jump(i, 1)))
            .collect();
        if kept.iter().all(|kept| *kept) {
            break;
        }
        let mut kept = kept.into_iter();
        readings.retain(|_| kept.next().unwrap_or(true));
    }
    readings
}

/// Returns the deviation of a reading from the line between its neighbours, metres and radians; zero
/// at the ends.
fn deviation(readings: &[(f64, RigidTransform)], i: usize) -> [f64; 2] {
    let (Some(before), Some(after)) = (i.checked_sub(1), readings.get(i + 1)) else {
        return [0.0; 2];
    };
    let ((from, a), (at, own), (to, b)) = (&readings[before], &readings[i], after);
    let share = (at - from) / (to - from).max(1e-9);
    let position = a.translation.lerp(b.translation, share);
    let rotation = a.rotation.slerp(b.rotation, share);
    [
        own.translation.distance(position),
        own.rotation.angle_between(rotation),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use penumbra_numerics::Random;

    #[test]
    fn removes_jumps_and_keeps_motion() {
        let mut random = Random::new(5);
        let readings: Vec<(f64, RigidTransform)> = (0..1200)
            .map(|i| {
                let t = f64::from(i) / 120.0;
                let swing = DVec3::new((9.0 * t).sin(), (7.0 * t).cos(), 0.2) * 0.2;
                let rotation = DQuat::from_scaled_axis(swing + random.normal3() * 1e-3);
                let position = 0.1 * swing + random.normal3() * 3e-4;
                (t, RigidTransform::new(rotation, position))
            })
            .collect();
        assert_eq!(without_jumps(readings.clone()).len(), readings.len());
        let mut with_jumps = readings;
        let jumped = [40, 41, 300, 777, 1100];
        for i in jumped {
            with_jumps[i].1.translation += DVec3::new(0.06, -0.02, 0.03);
            with_jumps[i].1.rotation *= DQuat::from_rotation_x(0.08);
        }
        let kept = without_jumps(with_jumps.clone());
        let removed: Vec<usize> = (0..with_jumps.len())
            .filter(|i| !kept.iter().any(|k| k.0 == with_jumps[*i].0))
            .collect();
        assert!(jumped.iter().all(|i| removed.contains(i)), "{removed:?}");
        // A good reading beside two successive jumps may be removed with them.
        assert!(removed.len() <= jumped.len() + 2, "{removed:?}");
        assert!(without_jumps(Vec::new()).is_empty());
        assert_eq!(without_jumps(with_jumps[..2].to_vec()).len(), 2);
    }
}
