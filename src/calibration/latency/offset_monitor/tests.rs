use super::*;
use glam::DVec3;
use penumbra_numerics::Random;

/// Orientation of a hand-held rig that is rotated irregularly, at a time in seconds.
fn hand(t: f64) -> DQuat {
    let swing = DVec3::new(
        0.25 * (2.9 * t).sin() + 0.1 * (5.3 * t + 1.0).sin(),
        0.3 * (2.1 * t + 0.5).sin() + 0.08 * (6.1 * t).sin(),
        0.15 * (1.3 * t).sin(),
    );
    DQuat::from_scaled_axis(swing)
}

fn stamp(seconds: f64) -> MonotonicTime {
    MonotonicTime::from_nanos(((1000.0 + seconds) * 1e9) as i64)
}

/// A pose at a fixed position.
fn still(rotation: DQuat) -> RigidTransform {
    RigidTransform::new(rotation, DVec3::ZERO)
}

/// A rig with a clock offset and a motion of its own.
struct Rig<O: Fn(f64) -> f64, H: Fn(f64) -> DQuat> {
    monitor: OffsetMonitor,
    offset: O,
    hand: H,
    random: Random,
}

impl<O: Fn(f64) -> f64, H: Fn(f64) -> DQuat> Rig<O, H> {
    fn new(offset: O, hand: H) -> Self {
        Self {
            monitor: OffsetMonitor::default(),
            offset,
            hand,
            random: Random::new(7),
        }
    }

    /// Runs the rig and returns the state after each estimate, with its time.
    fn run(&mut self, from: f64, to: f64) -> Vec<(f64, OffsetState)> {
        let mount = DQuat::from_euler(glam::EulerRot::XYZ, 1.2, -0.4, 2.0);
        let mut states = Vec::new();
        for i in (from * 60.0) as i32..(to * 60.0) as i32 {
            let t = f64::from(i) / 60.0;
            let noise = DQuat::from_scaled_axis(self.random.normal3() * 0.002);
            let reading = noise * (self.hand)(t);
            self.monitor
                .add_reading(stamp(t + (self.offset)(t)), still(reading));
            if i % 4 != 0 {
                continue;
            }
            let noise = DQuat::from_scaled_axis(self.random.normal3() * 0.002);
            let pose = (self.hand)(t + 0.003) * mount * noise;
            self.monitor.add_pose(stamp(t + 0.003), pose);
            if self.monitor.is_due() {
                states.push((t, self.monitor.estimate()));
            }
        }
        states
    }
}

#[test]
fn tracks_drift_of_a_millisecond_per_minute() {
    let offset = |t: f64| 0.012 + 1e-3 * t / 60.0;
    let mut rig = Rig::new(offset, hand);
    let states = rig.run(0.0, 180.0);
    assert!(states.len() > 30, "{}", states.len());
    for (t, state) in &states[3..] {
        let found = state.offset.unwrap();
        let error = found.seconds - offset(*t);
        assert!(
            error.abs() < 1e-3 && error.abs() < 3.0 * found.sigma,
            "{t}: {error} {found:?}"
        );
        assert!(
            found.sigma < 2e-3 && found.method == OffsetMethod::Poses,
            "{found:?}"
        );
    }
}

#[test]
fn uncertainty_grows_at_rest() {
    let still = |t: f64| hand(t.min(30.0));
    let mut rig = Rig::new(|_| 0.02, still);
    rig.run(0.0, 30.0);
    let states = rig.run(30.0, 330.0);
    let (first, last) = (states[5].1, states[states.len() - 1].1);
    assert_eq!(last.refusal, Some(LatencyError::AtRest));
    let [first, last] = [first, last].map(|f| f.offset.unwrap());
    assert!((last.seconds - 0.02).abs() < 1e-3, "{last:?}");
    assert!(
        last.sigma > 1.5 * first.sigma && last.sigma > 1.8e-3,
        "{last:?}"
    );
    assert_eq!(last.estimated_at, first.estimated_at);
}

#[test]
fn refuses_periodic_motion() {
    let periodic = |t: f64| {
        let swing = DVec3::new(1.0, 0.4, 0.2) * 0.25 * (t * std::f64::consts::TAU / 0.22).sin();
        DQuat::from_scaled_axis(swing)
    };
    let mut rig = Rig::new(|_| 0.02, periodic);
    let states = rig.run(0.0, 25.0);
    for (_, state) in &states {
        assert_eq!(state.offset, None);
    }
    let (_, last) = states[states.len() - 1];
    assert!(
        matches!(last.refusal, Some(LatencyError::Ambiguous { .. })),
        "{last:?}"
    );
}

fn offset(seconds: f64) -> ClockOffset {
    ClockOffset {
        seconds,
        sigma: 5e-4,
        correlation: 0.99,
        samples: 300,
    }
}

#[test]
fn rejects_outlier_but_accepts_changed_clock() {
    let mut filter = OffsetFilter::default();
    for _ in 0..8 {
        filter.predict(INTERVAL);
        assert!(filter.update(&offset(0.010), 5e-4, 0.25));
    }
    filter.predict(INTERVAL);
    assert!(!filter.update(&offset(0.050), 5e-4, 0.25));
    assert!(filter.update(&offset(0.0102), 5e-4, 0.25));
    let (x, _) = filter.offset.unwrap();
    assert!((x - 0.010).abs() < 3e-4, "{x}");
    // More successive estimates than a window holds are consistent with another offset.
    let accepted = (0..MIN_REPEATS).filter(|_| {
        filter.predict(INTERVAL);
        filter.update(&offset(0.050), 5e-4, 0.25)
    });
    assert_eq!(accepted.count(), 1);
    let (x, _) = filter.offset.unwrap();
    assert!((x - 0.050).abs() < 1e-9, "{x}");
}

#[test]
fn overlapping_windows_are_weighted_by_their_new_share() {
    let mut filter = OffsetFilter::default();
    for _ in 0..4 {
        assert!(filter.update(&offset(0.010), 5e-4, 0.25));
    }
    let (_, variance) = filter.offset.unwrap();
    // The first window in full, and three quarters of another.
    let expected = 5e-4 * 5e-4 / 1.75;
    assert!((variance / expected - 1.0).abs() < 1e-6, "{variance}");
}

#[test]
fn ignores_decreasing_time_stamps_and_invalid_readings() {
    let mut monitor = OffsetMonitor::default();
    monitor.add_reading(stamp(1.0), still(DQuat::IDENTITY));
    monitor.add_reading(stamp(0.5), still(DQuat::IDENTITY));
    monitor.add_reading(stamp(2.0), still(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0)));
    assert_eq!(monitor.readings.len(), 1);
    assert_eq!(monitor.estimate(), OffsetState::default());
}
