use super::*;
use glam::{DQuat, DVec3};
use proptest::prelude::*;

mod logs;

const MILLI: i64 = 1_000_000;

fn at(millis: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(millis * MILLI)
}

fn config(smoothing: Smoothing) -> HistoryConfig {
    HistoryConfig {
        smoothing,
        ..HistoryConfig::default()
    }
}

/// Uniform motion: 1 m/s along X, 1 rad/s about Z.
fn even(time: MonotonicTime) -> RigidTransform {
    let seconds = time.as_nanos() as f64 * 1e-9;
    RigidTransform::new(DQuat::from_rotation_z(seconds), DVec3::X * seconds)
}

fn filled(config: HistoryConfig, millis: impl Iterator<Item = i64>) -> PoseHistory {
    let mut history = PoseHistory::new(config);
    for millis in millis {
        assert_eq!(history.push(at(millis), even(at(millis))), Pushed::Kept);
    }
    history
}

fn assert_near(found: RigidTransform, expected: RigidTransform) {
    let turn = found.rotation.angle_between(expected.rotation);
    let moved = found.translation.distance(expected.translation);
    assert!(moved < 1e-6 && turn < 1e-6, "{found:?} for {expected:?}");
}

const LOCAL: Smoothing = Smoothing::Local {
    half_window_nanos: 100 * MILLI,
    degree: Degree::Quadratic,
};

proptest! {
    #[test]
    fn uniform_motion_is_interpolated_exactly(steps in prop::collection::vec(1_i64..30, 4..60), place in 0.0..1.2_f64, smooth in any::<bool>()) {
        let times: Vec<i64> = steps.iter().scan(1000, |t, step| { *t += step; Some(*t) }).collect();
        let smoothing = if smooth { LOCAL } else { Smoothing::None };
        let history = filled(config(smoothing), times.iter().copied());
        let (first, last) = (times[0], *times.last().unwrap());
        let asked = MonotonicTime::from_nanos(first * MILLI + ((last - first) as f64 * place * 1e6) as i64);
        if let Some(found) = history.at(asked) {
            let beyond = asked > at(last);
            // Readings over less than 15 ms do not tell a velocity; the last pose is kept.
            let moving = !beyond || last - first >= 15;
            assert_near(found.transmitter_from_sensor, even(if moving { asked } else { at(last) }));
            prop_assert!(found.age_nanos >= 0);
            prop_assert_eq!(found.provenance == Provenance::Predicted, beyond);
        } else {
            prop_assert!(asked > at(last + 100));
        }
    }

    #[test]
    fn arbitrary_streams_never_panic(
        pushes in prop::collection::vec((any::<i64>(), prop::array::uniform4(any::<f64>()), any::<bool>()), 0..60),
        asked in any::<i64>(),
    ) {
        let mut history = PoseHistory::new(HistoryConfig { capacity: 8, ..config(LOCAL) });
        for (nanos, [x, y, z, w], sane) in pushes {
            let rotation = if sane { DQuat::IDENTITY } else { DQuat::from_xyzw(x, y, z, w) };
            history.push(MonotonicTime::from_nanos(nanos), RigidTransform::new(rotation, DVec3::new(x, y, z)));
            prop_assert!(history.len() <= 8);
        }
        if let Some(found) = history.at(MonotonicTime::from_nanos(asked)) {
            prop_assert!(found.transmitter_from_sensor.rotation.is_finite());
        }
    }
}

#[test]
fn reports_provenance_and_age() {
    let history = filled(config(Smoothing::None), (0..20).map(|i| i * 10));
    let found = |millis| {
        history
            .at(at(millis))
            .map(|p| (p.provenance, p.age_nanos / MILLI))
    };
    assert_eq!(found(100), Some((Provenance::Exact, 0)));
    assert_eq!(found(103), Some((Provenance::Interpolated, 3)));
    assert_eq!(found(108), Some((Provenance::Interpolated, 2)));
    assert_eq!(found(250), Some((Provenance::Predicted, 60)));
    assert_eq!(found(291), None, "too long after the last reading");
    assert_eq!(found(-1), None, "before the first one");
}

#[test]
fn does_not_interpolate_across_a_gap() {
    let millis = (0..10)
        .map(|i| i * 10)
        .chain((0..10).map(|i| 1000 + i * 10));
    let history = filled(config(LOCAL), millis);
    assert_eq!(
        history.at(at(150)).unwrap().provenance,
        Provenance::Predicted
    );
    assert_eq!(history.at(at(500)), None);
    let found = history.at(at(1005)).unwrap();
    assert_eq!(found.provenance, Provenance::Interpolated);
    assert_near(found.transmitter_from_sensor, even(at(1005)));
}

#[test]
fn smoothing_reduces_noise() {
    let mut raw = PoseHistory::new(config(Smoothing::None));
    let mut smooth = PoseHistory::new(config(LOCAL));
    let mut sign = 1.0;
    for i in 0..60 {
        // Alternating noise is the worst case between neighbours.
        sign = -sign;
        let mut pose = even(at(i * 8));
        pose.translation.y += 0.001 * sign;
        raw.push(at(i * 8), pose);
        smooth.push(at(i * 8), pose);
    }
    let error = |history: &PoseHistory| {
        let found = history.at(at(240)).unwrap().transmitter_from_sensor;
        found.translation.distance(even(at(240)).translation)
    };
    assert!((error(&raw) - 0.001).abs() < 1e-9);
    assert!(error(&smooth) < 0.000_2, "{}", error(&smooth));
}

#[test]
fn fast_motion_narrows_the_window() {
    // A hand that waves by 10 cm three times a second, read with 0.1 mm of noise.
    let wave = |millis: i64| {
        let phase = std::f64::consts::TAU * 3.0 * millis as f64 * 1e-3;
        DVec3::X * 0.1 * phase.sin()
    };
    let mut history = PoseHistory::new(config(LOCAL));
    for i in 0..60 {
        let noise = DVec3::Y * 0.0001 * f64::from(i as i32 * 7919 % 13 - 6) / 6.0;
        let pose = RigidTransform::new(DQuat::IDENTITY, wave(i * 8) + noise);
        history.push(at(i * 8), pose);
    }
    for millis in (150..330).step_by(5) {
        let found = history.at(at(millis)).unwrap().transmitter_from_sensor;
        let error = found.translation.distance(wave(millis));
        // A parabola over all of ±100 ms misses the crest by millimetres.
        assert!(error < 0.0005, "{millis} ms: {error}");
    }
}

#[test]
fn jump_back_in_time_restarts_the_history() {
    let mut history = filled(config(LOCAL), (500..600).map(|i| i * 10));
    assert_eq!(history.push(at(5985), even(at(5985))), Pushed::Late);
    assert_eq!(history.push(at(100), even(at(100))), Pushed::Restarted);
    assert_eq!(history.len(), 1);
    assert_eq!(history.newest(), Some(at(100)));
}

#[test]
fn rejects_single_outlier_and_accepts_lasting_jump() {
    let mut history = filled(config(LOCAL), (0..20).map(|i| i * 10));
    let mirrored = |millis| {
        let pose = even(at(millis));
        RigidTransform::new(pose.rotation, DVec3::splat(-3.0) - pose.translation)
    };
    assert_eq!(history.push(at(200), mirrored(200)), Pushed::Outlier);
    assert_eq!(history.push(at(210), even(at(210))), Pushed::Kept);
    for millis in [220, 230, 240] {
        assert_eq!(history.push(at(millis), mirrored(millis)), Pushed::Outlier);
    }
    assert_eq!(history.push(at(250), mirrored(250)), Pushed::Restarted);
    assert_eq!(history.at(at(205)), None);
}

/// A misread record of a sensor at rest, or in vigorous motion, is off by less than a hand moves in
/// the time between two readings.
#[test]
fn motion_model_rejects_what_the_speed_alone_allows() {
    for (hertz, amplitude) in [(0.0, 0.0), (2.0, 0.1)] {
        let mut history = PoseHistory::new(config(LOCAL));
        let (mut rejected, mut worst) = (0, 0.0_f64);
        for i in 0..1200 {
            let time = MonotonicTime::from_nanos(i * 8_333_333);
            let phase = std::f64::consts::TAU * hertz * i as f64 / 120.0;
            let place = DVec3::X * amplitude * phase.sin();
            let is_misread = i % 100 == 50;
            let misread = place + DVec3::Y * if is_misread { 0.07 } else { 0.0 };
            let pose =
                |place| RigidTransform::new(DQuat::from_rotation_z(0.3 * phase.sin()), place);
            let pushed = history.push(time, pose(misread));
            assert_eq!(pushed == Pushed::Outlier, is_misread, "{i}: {pushed:?}");
            rejected += u64::from(pushed == Pushed::Outlier);
            if let Some(found) = history.at(time).filter(|_| i > 20) {
                let off = found.transmitter_from_sensor.translation.distance(place);
                worst = worst.max(off);
            }
        }
        assert_eq!(rejected, 12);
        assert!(worst < 0.01, "{worst} m");
    }
}

/// Readings that arrive late or in batches are no misreadings.
#[test]
fn motion_model_accepts_irregular_arrivals() {
    for batch in [1, 2, 4] {
        let mut history = PoseHistory::new(config(LOCAL));
        for i in 0..1200_i64 {
            let measured = i as f64 / 120.0;
            let arrived = (i / batch * batch + batch) * 8_333_333 + i % batch * 90_000;
            let late = (i * 7919 % 13) * 300_000 / batch;
            let time = MonotonicTime::from_nanos(arrived + late);
            let turn = (5.0 * measured).sin();
            let place = DVec3::new(0.12 * turn, 0.08 * (7.0 * measured).cos(), 0.0);
            let pose = RigidTransform::new(DQuat::from_rotation_y(0.3 * turn), place);
            let pushed = history.push(time, pose);
            assert_ne!(pushed, Pushed::Outlier, "{i} of batches of {batch}");
        }
    }
}

#[test]
fn history_has_bounded_length() {
    let small = HistoryConfig {
        capacity: 16,
        ..config(LOCAL)
    };
    let history = filled(small, 0..100);
    assert_eq!(history.len(), 16);
    assert_eq!(history.at(at(50)), None);
}

/// A hand's motion with permanent acceleration, metres and radians.
fn by_hand(seconds: f64) -> RigidTransform {
    let swing = |rate: f64, phase: f64| (rate * seconds + phase).sin();
    RigidTransform::new(
        DQuat::from_scaled_axis(DVec3::new(swing(3.1, 0.0), swing(2.3, 1.0), 0.5) * 0.3),
        DVec3::new(swing(2.9, 0.4), swing(4.1, 0.2), swing(3.3, 2.0)) * 0.1,
    )
}

#[test]
fn predicted_standard_deviation_matches_the_error() {
    for rate in [120.0, 30.0, 14.0] {
        check_predicted_deviation(rate);
    }
}

fn check_predicted_deviation(rate: f64) {
    use penumbra_numerics::Random;
    let mut random = Random::new(8);
    let mut history = PoseHistory::new(HistoryConfig::default());
    let at = |seconds: f64| MonotonicTime::from_nanos((seconds * 1e9) as i64 + 1_000_000_000);
    let (mut sums, mut stated, mut lines) = ([0.0; 3], [0.0; 3], 0.0);
    for k in 0..2400 {
        let t = f64::from(k) / rate;
        let pose = by_hand(t);
        let noisy = RigidTransform::new(
            (DQuat::from_scaled_axis(random.normal3() * 3e-4) * pose.rotation).normalize(),
            pose.translation + random.normal3() * 2e-4,
        );
        history.push(at(t), noisy);
        if k < 400 {
            continue;
        }
        for (bin, ahead) in [0.015, 0.055, 0.11].into_iter().enumerate() {
            let predicted = history.expected(at(t + ahead), at(t), 200_000_000);
            let predicted = predicted.unwrap();
            assert_eq!(predicted.provenance, Provenance::Predicted);
            let truth = by_hand(t + ahead);
            let off = predicted.transmitter_from_sensor.translation;
            sums[bin] += off.distance_squared(truth.translation);
            stated[bin] += predicted.sigma.unwrap()[0].powi(2);
        }
        lines += 1.0;
    }
    for (actual, predicted) in sums.iter().zip(stated) {
        let (actual, predicted) = ((actual / lines).sqrt(), (predicted / lines).sqrt());
        println!(
            "{rate} a second: error actual {:.3} mm, stated {:.3} mm",
            actual * 1e3,
            predicted * 1e3
        );
        assert!(
            (0.8..1.6).contains(&(predicted / actual)),
            "{predicted} for {actual}"
        );
    }
}

#[test]
fn prediction_as_of_a_time_ignores_later_readings() {
    let config = config(Smoothing::None);
    let every = |range: std::ops::Range<i64>| range.map(|k| 8 * k);
    let mut complete = PoseHistory::new(config);
    let mut until = PoseHistory::new(config);
    for millis in every(0..100) {
        complete.push(at(millis), by_hand(millis as f64 * 1e-3));
    }
    for millis in every(0..51) {
        until.push(at(millis), by_hand(millis as f64 * 1e-3));
    }
    let (time, max_age) = (at(440), 250_000_000);
    let expected = complete.expected(time, at(400), max_age).unwrap();
    assert_eq!(expected.provenance, Provenance::Predicted);
    assert_eq!(expected.age_nanos, 40_000_000);
    let then = until.at(time).unwrap();
    assert_near(
        expected.transmitter_from_sensor,
        then.transmitter_from_sensor,
    );
    let now = complete.at(time).unwrap();
    assert_eq!(now.provenance, Provenance::Exact);
    assert_eq!(complete.expected(time, time, max_age), Some(now));
    assert_eq!(complete.expected(time, at(400), 30_000_000), None);
    assert_eq!(complete.expected(time, at(-5), max_age), None);
}

#[test]
fn interpolated_pose_has_standard_deviation_of_the_noise() {
    use penumbra_numerics::Random;
    let mut random = Random::new(9);
    let mut history = PoseHistory::new(HistoryConfig::default());
    let at = |seconds: f64| MonotonicTime::from_nanos((seconds * 1e9) as i64 + 1_000_000_000);
    for k in 0..240 {
        let t = f64::from(k) / 120.0;
        let mut pose = by_hand(t * 0.2);
        pose.translation += random.normal3() * 2e-4;
        history.push(at(t), pose);
    }
    let (mut actual, mut predicted) = (0.0, 0.0);
    for k in 30..200 {
        let t = f64::from(k) / 120.0 + 0.004;
        let pose = history.at(at(t)).unwrap();
        let off = pose.transmitter_from_sensor.translation;
        actual += off.distance_squared(by_hand(t * 0.2).translation);
        predicted += pose.sigma.unwrap()[0].powi(2);
    }
    let ratio = (predicted / actual).sqrt();
    assert!((0.6..1.6).contains(&ratio), "{ratio}");
}

/// A hand that swings at `rate` radians per second over `reach` metres, read 120 times per second
/// with 0.3 mm of noise: RMS error of predictions 40 ms ahead, metres.
fn error_ahead(rate: f64, reach: f64) -> f64 {
    use penumbra_numerics::Random;
    let mut random = Random::new(3);
    let mut history = PoseHistory::new(HistoryConfig::default());
    let at = |seconds: f64| MonotonicTime::from_nanos((seconds * 1e9) as i64 + 1_000_000_000);
    let place = |t: f64| {
        let swing = |k: f64| (k * rate * t + k).sin() * reach;
        DVec3::new(swing(1.0), swing(0.7), swing(1.3))
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..1200 {
        let t = f64::from(k) / 120.0;
        let read = place(t) + random.normal3() * 3e-4;
        history.push(at(t), RigidTransform::new(DQuat::IDENTITY, read));
        if k >= 240 {
            let (then, max_age) = (at(t + 0.04), 200_000_000);
            let predicted = history.expected(then, at(t), max_age).unwrap();
            let predicted = predicted.transmitter_from_sensor.translation;
            sum += predicted.distance_squared(place(t + 0.04));
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

/// The constant mean of line and parabola has an error of 0.66 mm in the slow motion and of
/// 15 mm in the fast one.
#[test]
fn prediction_adapts_to_fast_and_slow_motion() {
    let (quick, slow) = (error_ahead(6.0, 0.2), error_ahead(0.5, 0.2));
    println!("quick {:.2} mm, slow {:.2} mm", quick * 1e3, slow * 1e3);
    assert!(quick < 4e-3, "{quick}");
    assert!(slow < 0.8e-3, "{slow}");
}

/// White noise of standard deviation 1 on each axis, by a hash of `k`.
fn noise(k: i64) -> DVec3 {
    let uniform = |seed: i64| {
        let mut x = ((k + 7) * 1_000_003 + seed)
            .cast_unsigned()
            .wrapping_mul(0x9E37_79B9_7F4A_7C15);
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^= x >> 31;
        (x >> 11) as f64 / (1_u64 << 53) as f64
    };
    let axis = |a: i64| (0..12).map(|n| uniform(16 * a + n)).sum::<f64>() - 6.0;
    DVec3::new(axis(0), axis(1), axis(2))
}

/// Noisy readings of `place`, 120 a second.
fn noisy(place: impl Fn(f64) -> DVec3) -> PoseHistory {
    let mut history = PoseHistory::new(config(LOCAL));
    for k in 0..720 {
        let seconds = f64::from(k) / 120.0;
        let position = place(seconds) + 0.0003 * noise(i64::from(k));
        let turn = DQuat::from_scaled_axis(0.0005 * noise(i64::from(k) + 100_000));
        let at = MonotonicTime::from_nanos((seconds * 1e9) as i64);
        history.push(at, RigidTransform::new(turn, position));
    }
    history
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    f64::sqrt(sum / count)
}

#[test]
fn a_sensor_at_rest_hardly_trembles() {
    let history = noisy(|_| DVec3::ZERO);
    let steps = |ahead: i64| {
        rms((2500..5500).step_by(33).map(|t| {
            let pose = |t| history.expected(at(t + ahead), at(t), 200_000_000).unwrap();
            let (a, b) = (pose(t), pose(t + 33));
            a.transmitter_from_sensor
                .translation
                .distance(b.transmitter_from_sensor.translation)
        }))
    };
    let between = rms((2500..5500).step_by(33).map(|t| {
        let pose = |t| {
            history
                .at(at(t))
                .unwrap()
                .transmitter_from_sensor
                .translation
        };
        pose(t).distance(pose(t + 33))
    }));
    // Smoothing over ±100 ms alone leaves steps of 0.14 mm, predictions of 0.6 mm.
    assert!(between < 0.000_02, "{between}");
    assert!(steps(10) < 0.000_1, "{}", steps(10));
    assert!(history.at(at(5000)).unwrap().sigma.unwrap()[0] < 0.000_06);
}

#[test]
fn a_movement_out_of_rest_is_followed() {
    // At rest until 3 s, then 0.2 m/s, to rest again at 4 s; and a slow drift of 2 mm/s.
    let start = |s: f64| DVec3::X * 0.2 * (s - 3.0).clamp(0.0, 1.0);
    let drift = |s: f64| DVec3::X * 0.002 * s;
    let error = |place: &dyn Fn(f64) -> DVec3| {
        let history = noisy(place);
        let errors = (2000..5500).step_by(11).map(|t| {
            let found = history.at(at(t)).unwrap().transmitter_from_sensor;
            found.translation.distance(place(t as f64 * 1e-3))
        });
        errors.fold(0.0, f64::max)
    };
    // A corner in the path costs half a window's bend, drift what the noise hides.
    assert!(error(&start) < 0.001_2, "{}", error(&start));
    assert!(error(&drift) < 0.000_4, "{}", error(&drift));
}
