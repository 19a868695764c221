use super::*;

fn pairs(gains: DVec3, count: u32, outliers: u32) -> Vec<PhotometricPair> {
    (0..count)
        .map(|i| {
            let environment = DVec3::splat(0.05 + 0.002 * f64::from(i % 50));
            let wobble = 1.0 + 0.02 * f64::from(i % 5) - 0.04;
            let wrong = if i % count < outliers { 3.0 } else { 1.0 };
            PhotometricPair {
                scene: gains * environment * wobble * wrong,
                environment,
                variance: DVec3::splat(4e-4),
                cluster: i / 10,
            }
        })
        .collect()
}

fn seconds(s: f64) -> MonotonicTime {
    MonotonicTime::from_nanos((s * 1e9) as i64)
}

const GAINS: DVec3 = DVec3::new(3.0, 2.5, 4.0);

#[test]
fn tolerates_a_quarter_of_outliers() {
    let found = estimate_overlap(&pairs(GAINS, 200, 50)).unwrap();
    let error = found.estimate.percent_from(GAINS);
    assert!(error.abs().max_element() < 1.0, "{error}");
    assert_eq!(found.pairs, 150);
}

#[test]
fn ignores_clipped_channels() {
    let mut pairs = pairs(GAINS, 200, 0);
    for pair in pairs.iter_mut().step_by(2) {
        pair.scene.x = 1.0;
        pair.variance.x = f64::INFINITY;
    }
    let found = estimate_overlap(&pairs).unwrap();
    assert!(found.estimate.percent_from(GAINS).abs().max_element() < 1.0);
    assert_eq!(found.pairs, 100);
}

#[test]
fn rejects_too_few_and_inconsistent_patches() {
    assert!(matches!(
        estimate_overlap(&[]),
        Err(Shortage::TooFew { pairs: 0, .. })
    ));
    let few = estimate_overlap(&pairs(GAINS, 20, 0));
    assert!(matches!(few, Err(Shortage::TooFew { pairs: 20, .. })));
    let mut wild = pairs(GAINS, 200, 0);
    for (i, pair) in wild.iter_mut().enumerate() {
        pair.scene *= (0.02 * (i as f64 - 100.0)).exp();
    }
    let wild = estimate_overlap(&wild);
    assert!(
        matches!(wild, Err(Shortage::Inconsistent { .. })),
        "{wild:?}"
    );
}

fn answer(gains: DVec3, sd: f64) -> Result<OverlapEstimate, Shortage> {
    Ok(OverlapEstimate {
        estimate: GainEstimate {
            gains,
            relative_sd: DVec3::splat(sd),
        },
        pairs: 100,
        clusters: 10,
        spread: 0.03,
        log_brightness: DVec3::ZERO,
    })
}

fn timing(exposure_factor: f64, at: MonotonicTime) -> PairTiming {
    PairTiming {
        scene_at: at,
        environment_at: at,
        exposure_factor,
    }
}

#[test]
fn averaging_reduces_the_standard_error_down_to_the_systematic_error() {
    let mut tracker = GainTracker::new(SmoothingOptions {
        drift: 0.0,
        ..SmoothingOptions::default()
    });
    for i in 0..100 {
        let noisy = GAINS * (1.0 + 0.05 * if i % 2 == 0 { 1.0 } else { -1.0 });
        tracker.update(
            answer(noisy, 0.05),
            timing(1.0, seconds(0.1 * f64::from(i))),
        );
    }
    let found = tracker.estimate().unwrap();
    assert!(found.percent_from(GAINS).abs().max_element() < 0.3);
    let sd = found.relative_sd.x;
    let systematic = SYSTEMATIC.powi(2) + CLUSTER_SYSTEMATIC.powi(2) / 10.0;
    let expected = (0.05f64.powi(2) / 100.0 + systematic).sqrt();
    assert!((sd / expected - 1.0).abs() < 0.01, "{sd} {expected}");
}

#[test]
fn keeps_its_value_while_pairs_are_not_usable() {
    let mut tracker = GainTracker::new(SmoothingOptions::default());
    assert_eq!(tracker.estimate(), None);
    tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(0.0)));
    let before = tracker.estimate();
    let shortage = Shortage::TooFew {
        pairs: 3,
        clusters: 1,
    };
    tracker.update(Err(shortage), timing(1.0, seconds(1.0)));
    assert_eq!(tracker.frozen(), Some(shortage));
    assert_eq!(tracker.estimate(), before);
    tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(2.0)));
    assert_eq!(tracker.frozen(), None);
}

#[test]
fn ignores_a_short_jump_and_follows_a_persistent_one() {
    let mut tracker = GainTracker::new(SmoothingOptions::default());
    for i in 0..10 {
        tracker.update(
            answer(GAINS, 0.02),
            timing(1.0, seconds(0.1 * f64::from(i))),
        );
    }
    for i in 10..13 {
        tracker.update(
            answer(0.6 * GAINS, 0.02),
            timing(1.0, seconds(0.1 * f64::from(i))),
        );
    }
    assert!(matches!(tracker.frozen(), Some(Shortage::Jump { .. })));
    let held = tracker.estimate().unwrap();
    assert!(held.percent_from(GAINS).abs().max_element() < 0.1);
    tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(1.3)));
    for i in 14..20 {
        tracker.update(
            answer(0.6 * GAINS, 0.02),
            timing(1.0, seconds(0.1 * f64::from(i))),
        );
    }
    let followed = tracker.estimate().unwrap();
    assert!(followed.percent_from(0.6 * GAINS).abs().max_element() < 0.1);
    assert_eq!(tracker.frozen(), None);
}

#[test]
fn reported_exposure_change_is_no_jump() {
    let mut tracker = GainTracker::new(SmoothingOptions::default());
    tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(0.0)));
    tracker.update(answer(4.0 * GAINS, 0.02), timing(4.0, seconds(0.1)));
    assert_eq!(tracker.frozen(), None);
    let found = tracker.estimate().unwrap();
    assert!(found.percent_from(GAINS).abs().max_element() < 1e-6);
}

#[test]
fn corrects_for_light_that_dims_between_the_pictures() {
    let mut tracker = GainTracker::new(SmoothingOptions::default());
    let rate = -1.0f64; // ln units per second: a cloud
    let skew = 0.03;
    for i in 0..20 {
        let at = 0.066 * f64::from(i);
        let mut dimming = answer(GAINS * (rate * skew).exp(), 0.002).unwrap();
        dimming.log_brightness = DVec3::splat(rate * at);
        let timing = PairTiming {
            scene_at: seconds(at + skew),
            environment_at: seconds(at),
            exposure_factor: 1.0,
        };
        tracker.update(Ok(dimming), timing);
    }
    let found = tracker.estimate().unwrap();
    let error = found.percent_from(GAINS).abs().max_element();
    assert!(error < 1.0, "{error} % with the correction, 3 % without");
}
