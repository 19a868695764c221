//! The light of a recording: at each picture's time, between the environment pictures before and
//! after it.

use crate::light::blended::{Blend, MAX_INTERVAL_NANOS, interval, share};
use crate::light::state::LightState;
use penumbra_interface::MonotonicTime;
use std::collections::VecDeque;

/// Lights in the order of their environment pictures, from the one before the next frame on.
#[derive(Default)]
pub(crate) struct LightTimeline(VecDeque<LightState>);

impl LightTimeline {
    /// Adds a light. One of the same instant replaces the newest; an earlier instant starts a new
    /// time line.
    pub fn push(&mut self, state: LightState) {
        let Some(at) = state.captured_at() else {
            return;
        };
        match self.newest().and_then(LightState::captured_at) {
            Some(newest) if newest == at => drop(self.0.pop_back()),
            Some(newest) if newest > at => self.0.clear(),
            _ => (),
        }
        self.0.push_back(state);
    }

    /// Returns the newest light.
    pub fn newest(&self) -> Option<&LightState> {
        self.0.back()
    }

    /// Returns whether the light at `at` is known: no later environment picture can change it.
    pub fn is_settled(&self, at: MonotonicTime) -> bool {
        let newest = self.newest().and_then(LightState::captured_at);
        newest.is_none_or(|newest| at <= newest || at.nanos_since(newest) > MAX_INTERVAL_NANOS)
    }

    /// Forgets lights that are not needed at `at` or later.
    pub fn advance(&mut self, at: MonotonicTime) {
        while let Some(second) = self.0.get(1).and_then(LightState::captured_at)
            && second <= at
        {
            self.0.pop_front();
        }
    }

    /// Returns the light at `at`, no earlier than that of the last [`Self::advance`]: before the first
    /// light this one, and after the newest that one. Where the light jumps, it is that of the picture
    /// before.
    pub fn blend_at(&self, at: MonotonicTime) -> Option<Blend<'_>> {
        let is_over = |state: &&LightState| state.captured_at().is_some_and(|then| then <= at);
        let first = self.0.iter().skip(1).take_while(is_over).count();
        let from = self.0.get(first)?;
        let Some(to) = self.0.get(first + 1) else {
            return Some(Blend::single(from));
        };
        let pictures = to.number.saturating_sub(from.number);
        if interval(from, to, u32::try_from(pictures).unwrap_or(u32::MAX)).is_none() {
            return Some(Blend::single(from));
        }
        let ends = [from.captured_at()?, to.captured_at()?];
        Some(Blend {
            from,
            to,
            weight: share(at, ends),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::scheduler::tests::{at, blended, light_state, total};

    fn flux_at(timeline: &mut LightTimeline, millis: i64) -> Option<f32> {
        timeline.advance(at(millis));
        let blend = timeline.blend_at(at(millis))?;
        Some(blended(blend))
    }

    #[test]
    fn light_is_that_of_the_pictures_instant() {
        let mut timeline = LightTimeline::default();
        assert!(timeline.is_settled(at(0)) && timeline.blend_at(at(0)).is_none());
        for (millis, flux) in [(100, 1.0), (200, 1.1), (300, 1.05)] {
            timeline.push(light_state(millis, flux));
        }
        assert!(timeline.is_settled(at(300)) && !timeline.is_settled(at(301)));
        let all = [50, 100, 150, 175, 200, 250, 300, 400].map(|t| flux_at(&mut timeline, t));
        let expected = [1.0, 1.0, 1.05, 1.075, 1.1, 1.075, 1.05, 1.05];
        for (found, expected) in all.iter().zip(expected) {
            assert!((found.unwrap() - expected).abs() < 1e-6, "{all:?}");
        }
        // The last is held, without waiting for ever.
        assert!(timeline.is_settled(at(2301)));
    }

    #[test]
    fn later_light_is_known_before_earlier_light_is_forgotten() {
        let mut timeline = LightTimeline::default();
        for (millis, flux) in [(100, 1.0), (200, 1.1), (300, 1.05)] {
            timeline.push(light_state(millis, flux));
        }
        assert!((flux_at(&mut timeline, 120).unwrap() - 1.02).abs() < 1e-6);
        let later = timeline.blend_at(at(250)).unwrap();
        assert_eq!((total(later.from), total(later.to)), (1.1, 1.05));
        assert!((flux_at(&mut timeline, 150).unwrap() - 1.05).abs() < 1e-6);
    }

    #[test]
    fn switched_lamp_jumps_at_the_next_environment_picture() {
        let mut timeline = LightTimeline::default();
        timeline.push(light_state(100, 1.0));
        timeline.push(light_state(200, 2.0));
        assert_eq!(flux_at(&mut timeline, 199), Some(1.0));
        assert_eq!(flux_at(&mut timeline, 200), Some(2.0));
    }

    #[test]
    fn fading_light_is_interpolated_where_pictures_have_no_estimate() {
        let mut timeline = LightTimeline::default();
        for (millis, flux, number) in [(100, 1.0, 7), (300, 0.6, 10)] {
            timeline.push(LightState {
                number,
                ..light_state(millis, flux)
            });
        }
        assert!((flux_at(&mut timeline, 200).unwrap() - 0.8).abs() < 1e-6);
    }

    #[test]
    fn long_pause_is_not_bridged() {
        let mut timeline = LightTimeline::default();
        timeline.push(light_state(0, 1.0));
        timeline.push(light_state(2001, 1.1));
        assert_eq!(flux_at(&mut timeline, 1900), Some(1.0));
    }

    #[test]
    fn repeated_and_earlier_lights_are_accepted() {
        let mut timeline = LightTimeline::default();
        timeline.push(light_state(100, 1.0));
        timeline.push(light_state(200, 1.1));
        timeline.push(light_state(200, 1.2));
        assert_eq!(flux_at(&mut timeline, 200), Some(1.2));
        // Time went back: another loop or a reset clock.
        timeline.push(light_state(50, 0.9));
        assert_eq!(flux_at(&mut timeline, 60), Some(0.9));
        assert!(!timeline.is_settled(at(60)));
    }
}
