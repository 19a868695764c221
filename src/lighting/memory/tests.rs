use super::*;

/// Interval of pictures and time constant of the accumulation, seconds.
const STEP: f64 = 1.0 / 30.0;
const MEMORY: f32 = 0.25;

/// An accumulator that observes the same value in all texels.
struct UniformAccumulator {
    memory: RadianceAccumulator,
    seconds: f64,
}

impl UniformAccumulator {
    fn new() -> Self {
        Self {
            memory: RadianceAccumulator::new(&CubeGrid::new(2)),
            seconds: 0.0,
        }
    }

    /// Observes the value one picture later; returns the accumulated value.
    fn observe(&mut self, value: f32, confidence: f32) -> f32 {
        self.observe_part(value, confidence, 1.0)
    }

    fn observe_part(&mut self, value: f32, confidence: f32, covered: f32) -> f32 {
        let n = self.memory.radiance.len();
        self.seconds += STEP;
        let glance = Observation {
            radiance: &vec![Vec3::splat(value); n],
            coverage: &vec![covered; n],
            confidence: &vec![confidence; n],
        };
        let now = self.now();
        assert!(self.memory.accumulate(&glance, now, MEMORY));
        self.memory.radiance[0].x
    }

    fn now(&self) -> MonotonicTime {
        MonotonicTime::from_nanos((self.seconds * 1e9) as i64)
    }
}

/// The weights of pictures fall by a = e^(−Δt/τ) per picture: for alternating values ±d the error
/// of the mean is d (1 − a)/(1 + a).
#[test]
fn noise_averages_out_over_the_time_constant() {
    let mut fed = UniformAccumulator::new();
    let mut last = 0.0;
    for k in 0..400 {
        last = fed.observe(if k % 2 == 0 { 0.505 } else { 0.495 }, 0.5);
    }
    let a = (-STEP / f64::from(MEMORY)).exp() as f32;
    let exact = -0.005 * (1.0 - a) / (1.0 + a);
    assert!((last - 0.5 - exact).abs() < 1e-4, "{last} {exact}");
    assert!((last - 0.5).abs() < 0.1 * 0.005);
}

#[test]
fn random_noise_falls_with_number_of_pictures() {
    let mut fed = UniformAccumulator::new();
    let (mut state, mut sum) = (7_u32, 0.0);
    let mut uniform = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32 - 0.5
    };
    let sigma = 0.01;
    for k in 0..2000 {
        let value = fed.observe(0.5 + sigma * 12.0_f32.sqrt() * uniform(), 0.5);
        sum += if k < 50 { 0.0 } else { (value - 0.5).powi(2) };
    }
    let a = (-STEP / f64::from(MEMORY)).exp() as f32;
    let exact = sigma * ((1.0 - a) / (1.0 + a)).sqrt();
    let found = (sum / 1950.0).sqrt();
    // Slightly more, as larger differences count as changes.
    assert!((0.85..1.25).contains(&(found / exact)), "{found} {exact}");
}

#[test]
fn sudden_changes_are_followed_at_once_and_slow_ones_within_the_time_constant() {
    let mut fed = UniformAccumulator::new();
    (0..60).for_each(|_| {
        fed.observe(0.5, 0.5);
    });
    let first = fed.observe(1.0, 0.5);
    assert!((first - 1.0).abs() < 0.01, "{first}");
    assert!((fed.observe(0.1, 0.5) - 0.1).abs() < 0.005);
    // By 2 %: noise could explain it, so the mean follows it.
    (0..60).for_each(|_| {
        fed.observe(0.5, 0.5);
    });
    let after: Vec<f32> = (0..16).map(|_| fed.observe(0.51, 0.5)).collect();
    assert!(after[0] < 0.503 && after[15] > 0.508, "{after:?}");
}

#[test]
fn jittering_edge_stays_as_sharp_as_in_one_picture() {
    let mut fed = UniformAccumulator::new();
    for k in 0..60 {
        let shown = if k % 3 == 0 { 0.9 } else { 0.2 };
        let kept = fed.observe(shown, 0.5);
        assert!((kept - shown).abs() < 0.02 * shown, "{kept} {shown}");
    }
}

#[test]
fn rim_does_not_override_the_middle() {
    let mut fed = UniformAccumulator::new();
    (0..60).for_each(|_| {
        fed.observe(0.5, 0.5);
    });
    let rim = confidence(5e-4, 0.1, 0.0);
    assert!(rim < 0.06);
    let after = fed.observe(0.2, rim);
    assert!(after > 0.49, "{after}");
    // Nor after a tenth of a second of it; but finally, if nothing else is seen.
    fed.observe(0.2, rim);
    assert!(fed.observe(0.2, rim) > 0.47);
    let later = (0..60).map(|_| fed.observe(0.2, rim)).last().unwrap();
    assert!(later < 0.21, "{later}");
    // The middle is trusted again at once.
    assert!((fed.observe(0.5, 0.5) - 0.5).abs() < 0.01);
}

#[test]
fn clipped_values_do_not_override_unclipped_ones() {
    let (open, clipped) = (confidence(5e-4, 0.02, 0.0), confidence(5e-4, 0.02, 1.0));
    assert!((clipped / open - 0.05).abs() < 1e-6);
    let mut fed = UniformAccumulator::new();
    (0..60).for_each(|_| {
        fed.observe(3.0, open);
    });
    assert!(fed.observe(1.0, clipped) > 2.95);
    assert!((fed.observe(2.0, open) - 2.0).abs() < 0.02);
    // If it is clipped all the time, its estimate is followed.
    let mut fed = UniformAccumulator::new();
    (0..30).for_each(|_| {
        fed.observe(20.0, clipped);
    });
    assert!((fed.observe(30.0, clipped) - 30.0).abs() < 0.6);
}

#[test]
fn old_values_are_replaced_and_invisible_ones_kept() {
    let mut fed = UniformAccumulator::new();
    (0..60).for_each(|_| {
        fed.observe(0.5, 0.5);
    });
    let then = fed.now();
    fed.seconds += 5.0;
    assert_eq!(fed.memory.radiance[0].x, 0.5);
    assert!((fed.memory.oldest_seconds(fed.now()).unwrap() - 5.0).abs() < 1e-6);
    let mean = fed.memory.mean_seen_at(&[1.0; 24]).unwrap();
    assert!(mean.seconds_since(then).abs() < 1e-6);
    // Nothing remains of it even against a poor view.
    assert!((fed.observe(0.4, 0.01) - 0.4).abs() < 1e-3);
}

#[test]
fn partly_seen_texel_counts_in_part() {
    let mut fed = UniformAccumulator::new();
    fed.observe(0.5, 0.5);
    let a = (-STEP / f64::from(MEMORY)).exp() as f32;
    let share = 0.2 * 0.5 / (0.2 * 0.5 + 0.5 * a);
    let mixed = fed.observe_part(0.9, 0.5, 0.2);
    assert!((mixed - 0.5 - 0.4 * share).abs() < 1e-4, "{mixed}");
    let mut empty = UniformAccumulator::new();
    assert_eq!(empty.observe_part(0.7, 0.5, 0.2), 0.7);
    assert_eq!(empty.memory.coverage[0], 0.2);
}
