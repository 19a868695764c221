//! The automatic exposure: where it goes, and how it gets there. No GPU.

/// How far an automatic exposure may go, and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AutoLimits {
    /// Shortest exposure, stops beside the camera's, at most 0.
    pub darkest: f32,
    /// Longest exposure, stops beside the camera's, at least 0: noise grows with it.
    pub brightest: f32,
    /// Mean linear brightness below which a picture may be brightened, and up to which virtual
    /// lights may make it brighter.
    pub key: f32,
    /// Time in which a sudden change is followed to 63 %, seconds; 0 = at once.
    pub adaptation_seconds: f32,
}

/// Mean luminances of the picture in the camera's exposure, linear.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Brightness {
    /// Of the camera's picture.
    pub camera: f32,
    /// What virtual lights add to it.
    pub added: f32,
    /// What virtual shadows take from it.
    pub taken: f32,
}

impl Brightness {
    /// Of the real scene in virtual light.
    #[must_use]
    pub fn lit(&self) -> f32 {
        (self.camera + self.added - self.taken).max(1e-4)
    }

    /// The exposure that keeps the mean as bright as the camera had it, as its own automatic
    /// exposure would; but a dark picture may become as bright as the key before anything is
    /// darkened, and is brightened up to it.
    #[must_use]
    pub fn wanted(&self, limits: &AutoLimits) -> f32 {
        let lit = self.lit();
        let mean = lit.clamp(limits.key, limits.key.max(self.camera));
        let stops = (mean / lit).log2();
        stops.clamp(limits.darkest.min(0.0), limits.brightest.max(0.0))
    }
}

/// Nearer to its goal than this it is there: a hundredth of a code.
const THERE: f32 = 1.0 / 1024.0;

/// Longest step in time, seconds: what is longer is a pause, or another recording.
const LONGEST_STEP: f64 = 1.0;

/// Goes where it is wanted, smoothly.
///
/// What it measures is the picture before the exposure is changed, so that there is no loop
/// that could swing: an exponential, which never overshoots.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Follower {
    stops: f32,
    last_seconds: Option<f64>,
}

impl From<f32> for Follower {
    /// Where it begins, stops.
    fn from(stops: f32) -> Self {
        Self {
            stops,
            last_seconds: None,
        }
    }
}

impl Follower {
    /// The exposure at `seconds`; a time before the last one counts as no time.
    pub fn follow(&mut self, wanted: f32, seconds: f64, adaptation_seconds: f32) -> f32 {
        let last = self.last_seconds.replace(seconds).unwrap_or(seconds);
        let passed = (seconds - last).clamp(0.0, LONGEST_STEP) as f32;
        let left = if adaptation_seconds > 0.0 {
            (-passed / adaptation_seconds).exp()
        } else {
            0.0
        };
        self.stops = wanted + (self.stops - wanted) * left;
        if (self.stops - wanted).abs() < THERE {
            self.stops = wanted;
        }
        self.stops
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: AutoLimits = AutoLimits {
        darkest: -3.0,
        brightest: 1.0,
        key: 0.1,
        adaptation_seconds: 0.5,
    };

    fn wanted(camera: f32, added: f32, taken: f32) -> f32 {
        let b = Brightness {
            camera,
            added,
            taken,
        };
        b.wanted(&LIMITS)
    }

    #[test]
    fn the_mean_stays_as_the_camera_had_it() {
        assert_eq!(wanted(0.2, 0.0, 0.0), 0.0);
        assert!((wanted(0.2, 0.2, 0.0) + 1.0).abs() < 1e-6);
        assert!((wanted(0.2, 0.7, 0.1) + 2.0).abs() < 1e-6);
        assert_eq!(wanted(0.2, 9.0, 0.0), -3.0);
        // Shadows alone: darker than before, but no darker than the key.
        assert_eq!(wanted(0.2, 0.0, 0.1), 0.0);
    }

    #[test]
    fn a_dark_picture_becomes_as_bright_as_the_key_first() {
        assert_eq!(wanted(0.05, 0.05, 0.0), 0.0);
        assert!((wanted(0.05, 0.15, 0.0) + 1.0).abs() < 1e-6);
        assert!((wanted(0.0625, 0.0, 0.0) - 1.6_f32.log2()).abs() < 1e-6);
        assert_eq!(wanted(0.001, 0.0, 0.0), 1.0);
        assert_eq!(wanted(0.0, 0.0, 0.0), 1.0);
    }

    #[test]
    fn a_step_is_followed_as_its_time_constant_says() {
        let mut follower = Follower::default();
        assert_eq!(follower.follow(-2.0, 10.0, 0.5), 0.0);
        let after = follower.follow(-2.0, 10.5, 0.5);
        assert!(
            (after + 2.0 * (1.0 - (-1.0_f32).exp())).abs() < 1e-6,
            "{after}"
        );
        // However the time is cut, it is as far.
        let mut fine = Follower::default();
        let last = (0..=50).map(|i| fine.follow(-2.0, f64::from(i) * 0.01, 0.5));
        assert!((last.last().unwrap_or(0.0) - after).abs() < 1e-4);
        let mut at_once = Follower::default();
        assert_eq!(at_once.follow(-2.0, 0.0, 0.0), -2.0);
    }

    #[test]
    fn it_arrives_stays_and_is_exactly_nothing_again() {
        let mut follower = Follower::default();
        let mut frame = 0;
        let mut run = |wanted: f32, frames: i32| {
            let mut stops = Vec::new();
            for _ in 0..frames {
                frame += 1;
                stops.push(follower.follow(wanted, f64::from(frame) / 30.0, 0.5));
            }
            stops
        };
        let down = run(-1.5, 200);
        assert!(down.is_sorted_by(|a, b| a >= b));
        assert_eq!(down.last(), Some(&-1.5));
        let up = run(0.0, 200);
        assert!(up.is_sorted());
        assert_eq!(up.last(), Some(&0.0));
    }

    proptest! {
        #[test]
        fn whatever_is_measured_it_stays_within_its_limits(
            camera in 0.0f32..4.0, added in 0.0f32..1e6, taken in 0.0f32..4.0,
            seconds in proptest::collection::vec(-1e6f64..1e6, 1..20),
        ) {
            let to = wanted(camera, added, taken);
            prop_assert!((-3.0..=1.0).contains(&to));
            let mut follower = Follower::default();
            for s in seconds {
                let stops = follower.follow(to, s, 0.5);
                prop_assert!(stops >= to.min(0.0) && stops <= to.max(0.0));
            }
        }
    }
}
