use super::*;
use proptest::prelude::*;
use std::collections::VecDeque;

/// A noisy camera that applies a new exposure `lag` frames late, or sometimes one more.
struct Simulated {
    lag: u64,
    /// Every this many changes, one takes effect a frame later; 0: none.
    late_every: u64,
    changes: u64,
    exposures: VecDeque<(u64, usize)>,
    noise: f64,
    random: u64,
}

impl Simulated {
    fn new(lag: u64) -> Self {
        Self {
            lag,
            late_every: 0,
            changes: 0,
            exposures: VecDeque::from([(0, 0)]),
            noise: 0.0,
            random: 88_172_645_463_325_252,
        }
    }

    /// Uniform in ±1 (xorshift).
    fn random(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn step_of(&self, sequence: u64) -> usize {
        let applies = self
            .exposures
            .iter()
            .rev()
            .find(|(from, _)| *from <= sequence);
        applies.unwrap().1
    }

    fn set(&mut self, sequence: u64, step: usize) {
        self.changes += 1;
        let late = self.late_every > 0 && self.changes.is_multiple_of(self.late_every);
        let from = sequence + 1 + self.lag + u64::from(late);
        self.exposures.push_back((from, step));
    }
}

const STOPS: [f64; 3] = [0.0, -2.0, -4.0];

fn bracketing(hold: u32, lag: Option<u32>) -> Bracketing {
    let settings = BracketSettings {
        stops: STOPS.to_vec(),
        hold,
        lag,
    };
    let values = exposures(&settings, 160);
    assert_eq!(values, [160, 40, 10]);
    Bracketing::new(&settings, steps(&values, 160)).unwrap()
}

struct Outcome {
    labelled: Vec<(u64, usize)>,
    wrong: usize,
    each: [usize; 3],
}

/// Feeds frames to the bracketing. `lose` selects lost frames, `scene` adds stops to the
/// brightness.
fn run(
    bracketing: &mut Bracketing,
    camera: &mut Simulated,
    frames: std::ops::Range<u64>,
    lose: impl Fn(u64) -> bool,
    scene: impl Fn(u64) -> f64,
) -> Outcome {
    let mut outcome = Outcome {
        labelled: Vec::new(),
        wrong: 0,
        each: [0; 3],
    };
    for sequence in frames {
        if lose(sequence) {
            continue;
        }
        let truth = camera.step_of(sequence);
        // Because of the gamma curve, two stops of exposure are about one of code values.
        let stops = 6.0 + scene(sequence) + STOPS[truth] * 0.5 + camera.noise * camera.random();
        let decision = bracketing.on_frame(sequence, Some(stops));
        if let Some(step) = decision.set {
            camera.set(sequence, step);
            bracketing.on_set(sequence, step);
        }
        if let Some(step) = decision.step {
            outcome.labelled.push((sequence, step));
            outcome.wrong += usize::from(step != truth);
            outcome.each[step] += 1;
        }
    }
    outcome
}

const STEADY: fn(u64) -> f64 = |_| 0.0;
const NONE: fn(u64) -> bool = |_| false;

#[test]
fn the_lag_is_measured_and_all_labels_are_correct() {
    for lag in 0..=4 {
        for noise in [0.0, 0.05, 0.1] {
            let mut camera = Simulated::new(lag);
            camera.noise = noise;
            let mut bracketing = bracketing(2, None);
            let outcome = run(&mut bracketing, &mut camera, 0..400, NONE, STEADY);
            let note = bracketing.timing_note.as_deref().unwrap();
            assert_eq!(
                note,
                format!("bracketing: new exposures take effect after {lag} frames")
            );
            assert_eq!(outcome.wrong, 0, "lag {lag}, noise {noise}");
            assert!(outcome.each.iter().all(|n| *n > 40), "{:?}", outcome.each);
        }
    }
}

#[test]
fn occasional_delays_of_a_frame_cause_no_wrong_labels() {
    for lag in 0..=4 {
        let mut camera = Simulated::new(lag);
        (camera.late_every, camera.noise) = (4, 0.05);
        let outcome = run(&mut bracketing(2, None), &mut camera, 0..600, NONE, STEADY);
        assert_eq!(outcome.wrong, 0, "lag {lag}");
        assert!(outcome.labelled.len() > 100);
    }
}

#[test]
fn lost_frames_do_not_shift_labels() {
    for lag in 0..=4 {
        let mut camera = Simulated::new(lag);
        camera.noise = 0.05;
        let lose = |n: u64| n % 7 == 3 || (200..206).contains(&n);
        let outcome = run(&mut bracketing(2, None), &mut camera, 0..600, lose, STEADY);
        assert_eq!(outcome.wrong, 0, "lag {lag}");
        assert!(outcome.each.iter().all(|n| *n > 30), "{:?}", outcome.each);
    }
}

#[test]
fn a_configured_lag_labels_from_the_first_frame() {
    let mut camera = Simulated::new(2);
    let mut bracketing = bracketing(1, Some(2));
    assert!(!bracketing.needs_brightness());
    let outcome = run(&mut bracketing, &mut camera, 0..90, NONE, STEADY);
    assert_eq!((outcome.labelled.len(), outcome.wrong), (90, 0));
    assert!(outcome.each.iter().all(|n| *n >= 28), "{:?}", outcome.each);
}

#[test]
fn without_a_visible_lag_the_cycle_is_slow_and_correct() {
    let mut camera = Simulated::new(3);
    let mut bracketing = bracketing(2, None);
    let mut wrong = 0;
    let mut labelled = 0;
    for sequence in 0..600 {
        let truth = camera.step_of(sequence);
        let decision = bracketing.on_frame(sequence, Some(-1.0));
        if let Some(step) = decision.set {
            camera.set(sequence, step);
            bracketing.on_set(sequence, step);
        }
        wrong += usize::from(decision.step.is_some_and(|step| step != truth));
        labelled += usize::from(decision.step.is_some());
    }
    assert_eq!(wrong, 0);
    assert!(labelled > 30, "{labelled}");
    assert!(bracketing.timing_note.unwrap().contains("do not show"));
}

#[test]
fn a_lag_that_changes_is_measured_again() {
    let mut camera = Simulated::new(1);
    let mut bracketing = bracketing(2, None);
    let before = run(&mut bracketing, &mut camera, 0..300, NONE, STEADY);
    assert_eq!(before.wrong, 0);
    camera.lag = 4;
    let slipped = run(&mut bracketing, &mut camera, 300..500, NONE, STEADY);
    assert!(
        slipped.wrong <= 3,
        "{}: doubtful frames are dropped",
        slipped.wrong
    );
    let after = run(&mut bracketing, &mut camera, 500..800, NONE, STEADY);
    assert_eq!(after.wrong, 0);
    assert!(
        bracketing
            .timing_note
            .as_deref()
            .unwrap()
            .contains("after 4 frames")
    );
}

#[test]
fn a_change_of_light_causes_no_wrong_labels() {
    let mut camera = Simulated::new(2);
    let lamp = |n: u64| if n >= 250 { -1.0 } else { 0.0 };
    let mut bracketing = bracketing(2, None);
    let outcome = run(&mut bracketing, &mut camera, 0..700, NONE, lamp);
    assert_eq!(outcome.wrong, 0);
    let late = outcome.labelled.iter().filter(|(n, _)| *n > 400).count();
    assert!(late > 100, "{late}");
}

#[test]
fn equal_exposures_are_one_step() {
    let steps = steps(&[100, 25, 25, 0, 3], 100);
    let listed: Vec<i64> = steps.iter().map(|s| s.exposure).collect();
    assert_eq!(listed, [100, 25, 3]);
    assert_eq!(steps[1].ev, -2.0);
    assert!(
        (steps[2].ev - (0.03_f64).log2()).abs() < 1e-12,
        "the accepted exposure, not the requested one"
    );
    let settings = BracketSettings::default();
    assert!(Bracketing::new(&settings, steps[..1].to_vec()).is_none());
    assert!(
        Bracketing::new(&settings, steps[1..].to_vec()).is_none(),
        "no base"
    );
}

proptest! {
    #[test]
    fn no_label_is_ever_wrong(
        lag in 0_u64..=4, hold in 1_u32..6, lost in 0_u64..9, seed in 1_u64..u64::MAX
    ) {
        let mut camera = Simulated::new(lag);
        camera.noise = 0.05;
        camera.random = seed;
        let lose = |n: u64| lost > 1 && (n.wrapping_mul(seed) >> 7) % lost == 0;
        let outcome = run(&mut bracketing(hold, None), &mut camera, 0..500, lose, STEADY);
        prop_assert_eq!(outcome.wrong, 0);
    }
}
