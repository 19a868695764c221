//! The automatic exposure: its target, and the smooth adaptation to it. Runs on the CPU.

/// Range and speed of an automatic exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AutoLimits {
    /// Shortest exposure, stops relative to the camera's, at most 0.
    pub darkest: f32,
    /// Longest exposure, stops relative to the camera's, at least 0: noise grows with it.
    pub brightest: f32,
    /// Mean linear brightness below which a picture may be brightened, and up to which virtual
    /// lights may make it brighter.
    pub key: f32,
    /// Time constant of the adaptation, in which it completes 63 % of a step, seconds; 0 = at once.
    pub adaptation_seconds: f32,
}

/// Mean luminances of the picture in the camera's exposure, linear.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Brightness {
    /// Mean of the camera's picture.
    pub camera: f32,
    /// Mean light that virtual lights add to it.
    pub added: f32,
    /// Mean light that virtual shadows remove from it.
    pub taken: f32,
}

impl Brightness {
    /// Mean of the real scene under virtual lights and shadows.
    #[must_use]
    pub fn lit(&self) -> f32 {
        (self.camera + self.added - self.taken).max(1e-4)
    }

    /// Returns the exposure, in stops, that preserves the mean brightness of the camera's picture,
    /// as its own automatic exposure would. A picture darker than the key is brightened up to the
    /// key, and is darkened only when virtual lights make it brighter than that.
    #[must_use]
    pub fn target_stops(&self, limits: &AutoLimits) -> f32 {
        let lit = self.lit();
        let mean = lit.clamp(limits.key, limits.key.max(self.camera));
        let stops = (mean / lit).log2();
        stops.clamp(limits.darkest.min(0.0), limits.brightest.max(0.0))
    }
}

/// Distance from the target below which the exposure is set to it, stops: a hundredth of a code.
const SNAP_STOPS: f32 = 1.0 / 1024.0;

/// Maximum time step, seconds: a longer one is a pause, or another recording.
const MAX_STEP_SECONDS: f64 = 1.0;

/// Approaches a target exposure exponentially, which never overshoots.
///
/// The target is measured on the picture before the exposure is changed, so that there is no
/// feedback loop that could oscillate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Follower {
    stops: f32,
    last_seconds: Option<f64>,
}

impl From<f32> for Follower {
    /// Creates a follower that starts at the exposure `stops`.
    fn from(stops: f32) -> Self {
        Self {
            stops,
            last_seconds: None,
        }
    }
}

impl Follower {
    /// Returns the exposure at `seconds`, in stops; a time before the last one counts as no time.
    pub fn follow(&mut self, target: f32, seconds: f64, adaptation_seconds: f32) -> f32 {
        let last = self.last_seconds.replace(seconds).unwrap_or(seconds);
        let elapsed = (seconds - last).clamp(0.0, MAX_STEP_SECONDS) as f32;
        let remaining = if adaptation_seconds > 0.0 {
            (-elapsed / adaptation_seconds).exp()
        } else {
            0.0
        };
        self.stops = target + (self.stops - target) * remaining;
        if (self.stops - target).abs() < SNAP_STOPS {
            self.stops = target;
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

    fn target_stops(camera: f32, added: f32, taken: f32) -> f32 {
        let b = Brightness {
            camera,
            added,
            taken,
        };
        b.target_stops(&LIMITS)
    }

    #[test]
    fn exposure_preserves_the_mean_of_the_camera_picture() {
        assert_eq!(target_stops(0.2, 0.0, 0.0), 0.0);
        assert!((target_stops(0.2, 0.2, 0.0) + 1.0).abs() < 1e-6);
        assert!((target_stops(0.2, 0.7, 0.1) + 2.0).abs() < 1e-6);
        assert_eq!(target_stops(0.2, 9.0, 0.0), -3.0);
        // Shadows alone darken the picture only to the key: the exposure is unchanged.
        assert_eq!(target_stops(0.2, 0.0, 0.1), 0.0);
    }

    #[test]
    fn dark_picture_is_darkened_only_above_the_key() {
        assert_eq!(target_stops(0.05, 0.05, 0.0), 0.0);
        assert!((target_stops(0.05, 0.15, 0.0) + 1.0).abs() < 1e-6);
        assert!((target_stops(0.0625, 0.0, 0.0) - 1.6_f32.log2()).abs() < 1e-6);
        assert_eq!(target_stops(0.001, 0.0, 0.0), 1.0);
        assert_eq!(target_stops(0.0, 0.0, 0.0), 1.0);
    }

    #[test]
    fn step_is_followed_with_the_time_constant() {
        let mut follower = Follower::default();
        assert_eq!(follower.follow(-2.0, 10.0, 0.5), 0.0);
        let after = follower.follow(-2.0, 10.5, 0.5);
        assert!(
            (after + 2.0 * (1.0 - (-1.0_f32).exp())).abs() < 1e-6,
            "{after}"
        );
        // The result does not depend on the number of time steps.
        let mut fine = Follower::default();
        let last = (0..=50).map(|i| fine.follow(-2.0, f64::from(i) * 0.01, 0.5));
        assert!((last.last().unwrap_or(0.0) - after).abs() < 1e-4);
        let mut at_once = Follower::default();
        assert_eq!(at_once.follow(-2.0, 0.0, 0.0), -2.0);
    }

    #[test]
    fn exposure_reaches_its_target_monotonically_and_returns_to_exactly_zero() {
        let mut follower = Follower::default();
        let mut frame = 0;
        let mut run = |target: f32, frames: i32| {
            let mut stops = Vec::new();
            for _ in 0..frames {
                frame += 1;
                stops.push(follower.follow(target, f64::from(frame) / 30.0, 0.5));
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
        fn exposure_stays_within_its_limits(
            camera in 0.0f32..4.0, added in 0.0f32..1e6, taken in 0.0f32..4.0,
            seconds in proptest::collection::vec(-1e6f64..1e6, 1..20),
        ) {
            let target = target_stops(camera, added, taken);
            prop_assert!((-3.0..=1.0).contains(&target));
            let mut follower = Follower::default();
            for s in seconds {
                let stops = follower.follow(target, s, 0.5);
                prop_assert!(stops >= target.min(0.0) && stops <= target.max(0.0));
            }
        }
    }
}
