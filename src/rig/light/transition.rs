//! The light of a live rig: it goes from one estimate to the next over the time between two
//! environment pictures.
//!
//! ```text
//!   picture n captured        active           shown in full
//!   c_n ────── lag ───────── a_n ─── interval ── min(c_n + lag + interval, a_n + interval)
//! ```
//!
//! Lag (from an environment picture to its light) and interval are medians over the last pictures.
//! So the light follows the real one at its own speed, however irregular the estimates are, by at
//! most one interval later than without interpolation, and it never overshoots. Light that becomes
//! active before the previous one is shown in full waits for this; its own end stays. So both ends
//! of an interpolation are always estimates.
//!
//! Everything depends on the times of pictures alone, so a replay that activates the same lights
//! at the same pictures shows the same light.

use crate::light::blended::{Blend, interval, share};
use crate::light::state::LightState;
use penumbra_interface::MonotonicTime;

/// Number of recent pictures that determine lag and interval.
const RECENT: usize = 5;

/// The light that is shown, and the one to which it goes.
#[derive(Default)]
pub(crate) struct LightTransition {
    from: Option<LightState>,
    to: Option<LightState>,
    /// The instants at which `from` and `to` are shown.
    ends: [MonotonicTime; 2],
    /// The next light, and the instant at which it is to be shown.
    pending: Option<(LightState, MonotonicTime)>,
    intervals: Recent,
    lags: Recent,
}

impl LightTransition {
    /// Adds a light that becomes active with the picture captured at `at`.
    pub fn push(&mut self, state: LightState, at: MonotonicTime) {
        self.advance(at);
        let Some((newest, captured_at)) = self.newest().zip(state.captured_at()) else {
            return self.show(state);
        };
        if newest.captured_at() == Some(captured_at) {
            return self.replace_newest(state);
        }
        // Where pictures had no estimate, a large change is shown at once, too: it is late already.
        let Some(nanos) = interval(newest, &state, 1) else {
            return self.show(state);
        };
        self.intervals.add(nanos);
        self.lags.add(at.nanos_since(captured_at));
        let interval = self.intervals.median();
        let due = captured_at.offset_nanos(self.lags.median() + interval);
        let due = due.min(at.offset_nanos(interval)).max(at);
        if self.from.is_some() && at < self.ends[1] {
            self.pending = Some((state, due));
        } else {
            self.from = self.to.replace(state);
            self.ends = [at, due];
        }
    }

    /// Shows a light at once.
    fn show(&mut self, state: LightState) {
        (self.from, self.pending) = (None, None);
        self.to = Some(state);
    }

    fn replace_newest(&mut self, state: LightState) {
        match &mut self.pending {
            Some((pending, _)) => *pending = state,
            None => self.to = Some(state),
        }
    }

    /// Returns the newest light, which may not be shown yet.
    pub fn newest(&self) -> Option<&LightState> {
        let pending = self.pending.as_ref().map(|(state, _)| state);
        pending.or(self.to.as_ref())
    }

    /// Starts the next interpolation if the last one has ended.
    pub fn advance(&mut self, at: MonotonicTime) {
        if at >= self.ends[1]
            && let Some((state, due)) = self.pending.take()
        {
            self.from = self.to.replace(state);
            self.ends = [self.ends[1], due.max(self.ends[1])];
        }
    }

    /// Returns the light of a picture captured at `at`, no earlier than that of the last
    /// [`Self::advance`].
    pub fn blend_at(&self, at: MonotonicTime) -> Option<Blend<'_>> {
        let to = self.to.as_ref()?;
        let (from, to, ends) = match &self.pending {
            Some((next, due)) if at >= self.ends[1] => {
                let starts = self.ends[1];
                (Some(to), next, [starts, (*due).max(starts)])
            }
            _ => (self.from.as_ref(), to, self.ends),
        };
        let Some(from) = from else {
            return Some(Blend::single(to));
        };
        Some(Blend {
            from,
            to,
            weight: share(at, ends),
        })
    }
}

/// The last values of a quantity.
#[derive(Clone, Copy, Default)]
struct Recent {
    values: [i64; RECENT],
    count: usize,
}

impl Recent {
    fn add(&mut self, value: i64) {
        self.values[self.count % RECENT] = value;
        self.count += 1;
    }

    /// The upper median; 0 without values.
    fn median(&self) -> i64 {
        let mut sorted = self.values;
        let sorted = &mut sorted[..self.count.min(RECENT)];
        sorted.sort_unstable();
        sorted.get(sorted.len() / 2).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::scheduler::tests::{at, blended, light_state};

    fn flux_at(light: &mut LightTransition, millis: i64) -> f32 {
        light.advance(at(millis));
        blended(light.blend_at(at(millis)).unwrap())
    }

    /// Environment pictures every 100 ms whose light becomes active after `lags` in turn, under
    /// a light that grows by a tenth each time; returns the light of pictures every 20 ms.
    fn followed(lags: &[i64]) -> Vec<f32> {
        let mut light = LightTransition::default();
        let mut shown = Vec::new();
        let active = |k: usize| 100 * k as i64 + lags[k % lags.len()];
        let mut next = 0;
        for millis in (0..2_000).step_by(20) {
            while next < 20 && active(next) <= millis {
                light.push(
                    light_state(100 * next as i64, 1.0 + 0.1 * next as f32),
                    at(millis),
                );
                next += 1;
            }
            shown.push(if next == 0 {
                1.0
            } else {
                flux_at(&mut light, millis)
            });
        }
        shown
    }

    #[test]
    fn live_light_follows_smoothly_and_at_most_one_interval_late() {
        for lags in [&[40][..], &[40, 60, 20, 80, 40], &[20, 90]] {
            let shown = followed(lags);
            let steps: Vec<f32> = shown.windows(2).map(|w| w[1] - w[0]).collect();
            // Never back, hence no overshoot of a light that only grows; a picture's step is a
            // fifth of an interval, and may be larger after a late estimate.
            assert!(steps.iter().all(|s| *s >= -1e-6), "{lags:?} {steps:?}");
            assert!(steps.iter().all(|s| *s < 0.1 + 1e-5), "{lags:?} {steps:?}");
            for (k, flux) in shown.iter().enumerate() {
                let latest = (20.0 * k as f32 - 120.0 - 100.0) / 100.0;
                assert!(
                    *flux >= 1.0 + 0.1 * latest.min(19.0) - 1e-4,
                    "{lags:?} at {k}: {flux}"
                );
            }
        }
        let steady = followed(&[40]);
        let steps = steady[10..90].windows(2).map(|w| w[1] - w[0]);
        assert!(steps.into_iter().all(|s| (s - 0.02).abs() < 1e-5));
    }

    #[test]
    fn shown_light_lies_between_its_ends() {
        let mut light = LightTransition::default();
        light.push(light_state(0, 1.0), at(30));
        light.push(light_state(100, 1.2), at(130));
        light.push(light_state(200, 1.0), at(150));
        light.push(light_state(210, 1.1), at(155));
        for millis in 130..500 {
            let flux = flux_at(&mut light, millis);
            assert!(
                (1.0 - 1e-6..=1.2 + 1e-6).contains(&flux),
                "{flux} at {millis}"
            );
        }
        assert!((flux_at(&mut light, 500) - 1.1).abs() < 1e-6);
    }

    #[test]
    fn later_light_is_known_as_far_as_it_is_estimated() {
        let mut light = LightTransition::default();
        light.push(light_state(0, 1.0), at(30));
        light.push(light_state(100, 1.2), at(130));
        light.push(light_state(200, 1.0), at(150));
        let coming: Vec<f32> = [200, 300, 400]
            .map(|millis| blended(light.blend_at(at(millis)).unwrap()))
            .to_vec();
        let shown: Vec<f32> = [200, 300, 400].map(|t| flux_at(&mut light, t)).to_vec();
        assert_eq!(coming, shown);
    }

    #[test]
    fn switched_lamp_is_shown_at_once() {
        let mut light = LightTransition::default();
        for (k, flux) in [(0, 1.0), (1, 1.1), (2, 3.0)] {
            light.push(light_state(100 * k, flux), at(100 * k + 30));
        }
        assert_eq!(flux_at(&mut light, 231), 3.0);
        light.push(light_state(300, 1.0), at(330));
        assert_eq!(flux_at(&mut light, 330), 1.0);
    }

    #[test]
    fn light_that_switches_ten_times_a_second_is_never_in_between() {
        let mut light = LightTransition::default();
        for k in 0..100 {
            let flux = if k % 2 == 0 { 1.0 } else { 3.0 };
            light.push(light_state(100 * k, flux), at(100 * k + 30));
            for millis in (100 * k + 30..100 * k + 130).step_by(33) {
                assert_eq!(flux_at(&mut light, millis), flux);
            }
        }
    }

    #[test]
    fn late_repeated_and_earlier_lights_are_accepted() {
        let mut light = LightTransition::default();
        light.push(light_state(0, 1.0), at(30));
        light.push(light_state(100, 1.1), at(130));
        light.push(light_state(100, 1.15), at(140));
        assert!((flux_at(&mut light, 400) - 1.15).abs() < 1e-6);
        // Time went back.
        light.push(light_state(20, 1.1), at(410));
        assert!((flux_at(&mut light, 410) - 1.1).abs() < 1e-6);
        // After a pause of more than two seconds.
        light.push(light_state(5000, 1.0), at(5030));
        assert!((flux_at(&mut light, 5030) - 1.0).abs() < 1e-6);
    }

    /// A replay also composes pictures that the live rig skipped.
    #[test]
    fn other_pictures_in_between_change_nothing() {
        let run = |every: i64| {
            let mut light = LightTransition::default();
            let mut shown = Vec::new();
            for millis in (0..1000).step_by(10) {
                if millis % 90 == 0 {
                    let flux = 1.0 + 0.001 * (millis % 170) as f32;
                    light.push(light_state(millis - 5, flux), at(millis));
                }
                if millis % every == 0 {
                    let flux = flux_at(&mut light, millis);
                    shown.extend((millis % 30 == 0).then_some(flux));
                }
            }
            shown
        };
        assert_eq!(run(10), run(30));
    }
}
