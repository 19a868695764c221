//! Estimates the pose at an instant by local least squares through noisy readings.

use glam::{DMat4, DQuat, DVec3, DVec4};
use penumbra_interface::RigidTransform;
use penumbra_numerics::rotation_vector;

/// Degree of the polynomial in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degree {
    /// Constant velocity within the window.
    Linear,
    /// Constant acceleration within the window.
    Quadratic,
    /// Constant jerk within the window.
    Cubic,
}

/// A reading near the requested instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    /// Time relative to the requested instant, seconds.
    pub time: f64,
    /// Weight in the fit, above 0.
    pub weight: f64,
    /// The reading.
    pub pose: RigidTransform,
}

/// A fitted pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Pose at time 0.
    pub pose: RigidTransform,
    /// Variance of the fitted value over the variance of one reading.
    pub noise_gain: f64,
}

/// Estimates the pose at time 0 by a weighted least-squares polynomial of `degree` through the
/// readings (Savitzky & Golay 1964, generalised to irregular times). Rotations are fitted as rotation
/// vectors from `reference`, which must be close to all of them.
///
/// With basis φ(t) = (1, t, t², …) and moments A = Σ wᵢ φ(tᵢ) φ(tᵢ)ᵀ the value at 0 is
///
/// > Σ wᵢ (c · φ(tᵢ)) yᵢ   where   A c = φ(0)
///
/// so position and rotation share the coefficients c. `None` if the readings do not
/// determine the polynomial.
pub(super) fn value_at_zero(
    readings: impl Iterator<Item = Reading> + Clone,
    degree: Degree,
    reference: DQuat,
) -> Option<Fit> {
    // Times relative to the middle of the readings, in units of half their span, keep A well
    // conditioned for any distance of the instant.
    let times = readings.clone().map(|r| r.time);
    let (first, last) = times.fold((f64::MAX, f64::MIN), |(a, b), t| (a.min(t), b.max(t)));
    let (middle, scale) = (0.5 * (first + last), 0.5 * (last - first));
    if scale <= 0.0 {
        return None;
    }
    let basis = |time: f64| {
        let t = (time - middle) / scale;
        DVec4::new(1.0, t, t * t, t * t * t)
    };
    let coefficients = solve(readings.clone(), degree, basis)?;
    let mut translation = DVec3::ZERO;
    let mut rotation = DVec3::ZERO;
    let mut noise_gain = 0.0;
    for reading in readings {
        let share = reading.weight * coefficients.dot(basis(reading.time));
        noise_gain += share * share;
        translation += share * reading.pose.translation;
        rotation += share * rotation_vector(reference.inverse() * reading.pose.rotation);
    }
    let rotation = (reference * DQuat::from_scaled_axis(rotation)).normalize();
    let pose = RigidTransform::new(rotation, translation);
    let finite = translation.is_finite() && rotation.is_finite();
    finite.then_some(Fit { pose, noise_gain })
}

/// The mean of poses, each with the same weight. Rotations are averaged as rotation vectors from
/// `reference`, which must be close to all of them. `None` without poses.
pub(super) fn mean<'a>(
    poses: impl Iterator<Item = &'a RigidTransform>,
    reference: DQuat,
) -> Option<Fit> {
    let inverse = reference.inverse();
    let (mut translation, mut rotation, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for pose in poses {
        translation += pose.translation;
        rotation += rotation_vector(inverse * pose.rotation);
        count += 1.0;
    }
    (count > 0.0).then(|| Fit {
        pose: RigidTransform::new(
            (reference * DQuat::from_scaled_axis(rotation / count)).normalize(),
            translation / count,
        ),
        noise_gain: 1.0 / count,
    })
}

/// Minimum determinant of the scaled moments; below it the readings are too close together to
/// determine the polynomial.
const MIN_DETERMINANT: f64 = 1e-9;

/// Solves A c = φ(0) for the terms of `degree`.
fn solve(
    readings: impl Iterator<Item = Reading>,
    degree: Degree,
    basis: impl Fn(f64) -> DVec4,
) -> Option<DVec4> {
    let mut a = DMat4::ZERO;
    for reading in readings {
        let phi = basis(reading.time);
        let weighted = reading.weight * phi;
        a += DMat4::from_cols(
            weighted * phi.x,
            weighted * phi.y,
            weighted * phi.z,
            weighted * phi.w,
        );
    }
    let (at, s0) = (basis(0.0), a.x_axis.x);
    // Higher terms are replaced by an identity with a right side of 0.
    let terms = match degree {
        Degree::Linear => 2,
        Degree::Quadratic => 3,
        Degree::Cubic => 4,
    };
    let mut wanted = at;
    for k in terms..4 {
        for j in 0..4 {
            a.col_mut(k)[j] = 0.0;
            a.col_mut(j)[k] = 0.0;
        }
        a.col_mut(k)[k] = s0;
        wanted[k] = 0.0;
    }
    (a.determinant() > MIN_DETERMINANT * s0.powi(4)).then(|| a.inverse() * wanted)
}

/// Estimates the variance of one reading's noise (metres², radians²; summed over the axes) from third
/// divided differences of neighbours, scaled to the variance of a reading: any motion of constant
/// acceleration vanishes in them, also where the times are irregular. Readings are in order of time.
/// `None` below four.
pub(super) fn noise_variance<'a>(
    readings: impl Iterator<Item = (f64, &'a RigidTransform)> + Clone,
) -> Option<[f64; 2]> {
    let reference = readings.clone().next()?.1.rotation.inverse();
    let mut recent = [(0.0, [DVec3::ZERO; 2]); 4];
    let (mut sums, mut count) = ([0.0; 2], 0);
    for (i, (time, pose)) in readings.enumerate() {
        recent.rotate_left(1);
        let turned = rotation_vector(reference * pose.rotation);
        recent[3] = (time, [pose.translation, turned]);
        if i < 3 {
            continue;
        }
        let weights = third_difference(recent.map(|(time, _)| time));
        for (axis, sum) in sums.iter_mut().enumerate() {
            let terms = recent.iter().zip(weights);
            let third: DVec3 = terms.map(|((_, value), w)| w * value[axis]).sum();
            *sum += third.length_squared();
        }
        count += 1;
    }
    (count > 0).then(|| sums.map(|sum| sum / f64::from(count)))
}

/// Weights of values at four increasing times in their third divided difference; the sum of their
/// squares is 1.
fn third_difference(times: [f64; 4]) -> [f64; 4] {
    let span = times[3] - times[0];
    let weights: [f64; 4] = std::array::from_fn(|i| {
        let others = (0..4).filter(|j| *j != i);
        others.map(|j| span / (times[i] - times[j])).product()
    });
    let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    weights.map(|w| w / norm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn readings(times: &[f64], pose: impl Fn(f64) -> RigidTransform) -> Vec<Reading> {
        let reading = |time: &f64| Reading {
            time: *time,
            weight: 1.0,
            pose: pose(*time),
        };
        times.iter().map(reading).collect()
    }

    proptest! {
        #[test]
        fn fits_polynomial_motion_exactly(
            a in prop::array::uniform3(-1.0..1.0_f64),
            v in prop::array::uniform3(-2.0..2.0_f64),
            g in prop::array::uniform3(-9.0..9.0_f64),
            turn in prop::array::uniform3(-3.0..3.0_f64),
            times in prop::collection::vec(-0.05..0.05_f64, 6..20),
        ) {
            let [a, v, g, turn] = [a, v, g, turn].map(DVec3::from_array);
            let start = DQuat::from_rotation_x(0.7);
            let motion = |degree: Degree| move |t: f64| {
                let bend = if degree == Degree::Quadratic { g * t * t } else { DVec3::ZERO };
                let rotation = start * DQuat::from_scaled_axis(turn * t);
                RigidTransform::new(rotation, a + v * t + bend)
            };
            let spread = times.iter().copied().fold(f64::MIN, f64::max)
                - times.iter().copied().fold(f64::MAX, f64::min);
            prop_assume!(spread > 0.02);
            for degree in [Degree::Linear, Degree::Quadratic] {
                let readings = readings(&times, motion(degree));
                if let Some(Fit { pose: found, noise_gain }) = value_at_zero(readings.iter().copied(), degree, start) {
                    prop_assert!(noise_gain > 0.0);
                    prop_assert!((found.translation - a).length() < 1e-6);
                    prop_assert!(found.rotation.angle_between(start) < 1e-6);
                } else {
                    prop_assert_eq!(degree, Degree::Quadratic, "a line is determined by spread");
                }
            }
        }
    }

    #[test]
    fn readings_at_one_instant_determine_no_fit() {
        let still = |_| RigidTransform::IDENTITY;
        for degree in [Degree::Linear, Degree::Quadratic] {
            for times in [&[][..], &[0.0; 9], &[0.01; 9]] {
                let readings = readings(times, still);
                let found = value_at_zero(readings.iter().copied(), degree, DQuat::IDENTITY);
                assert_eq!(found, None, "{degree:?} {times:?}");
            }
        }
    }

    #[test]
    fn mean_of_n_readings_has_one_nth_of_the_variance() {
        let readings = readings(&[-0.03, -0.01, 0.01, 0.03], |_| RigidTransform::IDENTITY);
        let fit = value_at_zero(readings.iter().copied(), Degree::Linear, DQuat::IDENTITY);
        assert!((fit.unwrap().noise_gain - 0.25).abs() < 1e-12);
    }

    #[test]
    fn noise_estimate_ignores_smooth_motion() {
        let alternating = |i: i32| f64::from(1 - 2 * (i % 2)) * 0.001;
        let poses: Vec<_> = (0..20)
            .map(|i| {
                let t = f64::from(i) * 0.01;
                let place = DVec3::new(t, t * t, alternating(i));
                (t, RigidTransform::new(DQuat::from_rotation_z(t), place))
            })
            .collect();
        let poses: Vec<_> = poses.iter().map(|(t, pose)| (*t, pose)).collect();
        let [moved, turned] = noise_variance(poses.iter().copied()).unwrap();
        // Third differences of ±1 are ±8, so the estimate is 64 / 20.
        assert!((moved / 1e-6 - 3.2).abs() < 1e-6 && turned < 1e-20);
        assert_eq!(noise_variance(poses[..3].iter().copied()), None);
    }

    #[test]
    fn irregular_times_of_smooth_motion_are_no_noise() {
        let times = [0.0, 0.003, 0.02, 0.021, 0.05, 0.08, 0.081];
        let bend = |t: f64| RigidTransform::new(DQuat::IDENTITY, DVec3::X * (t + 4.0 * t * t));
        let poses = times.map(|t| (t, bend(t)));
        let [moved, _] = noise_variance(poses.iter().map(|(t, p)| (*t, p))).unwrap();
        assert!(moved < 1e-20, "{moved}");
    }

    #[test]
    fn fits_quaternions_of_either_sign() {
        let turned = DQuat::from_rotation_z(0.2);
        let mut readings = readings(&[-0.02, -0.01, 0.01, 0.02], |_| {
            RigidTransform::new(turned, DVec3::ONE)
        });
        readings[1].pose.rotation = -turned;
        let found = value_at_zero(readings.iter().copied(), Degree::Linear, turned).unwrap();
        assert!(found.pose.rotation.angle_between(turned) < 1e-9);
    }
}
