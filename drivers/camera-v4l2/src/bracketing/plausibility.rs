//! Checks whether a frame looks like the exposure that it is attributed to.

/// Frames in a row that look like another step until the lag is measured again.
const MAX_DOUBTFUL: u32 = 8;
/// Weight of a new frame in the level of its step.
const LEARNING_RATE: f64 = 0.3;
/// Minimum difference of two levels that can be distinguished, stops.
const MIN_DIFFERENCE: f64 = 0.3;

/// Plausibility of a frame's attribution by its brightness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Plausible,
    /// The frame looks like another step. Do not use it.
    Doubtful,
    /// Many frames in a row do: the lag has changed.
    OutOfStep,
}

/// Learns how bright the frames of each step are.
#[derive(Clone, Debug, Default)]
pub(crate) struct Plausibility {
    /// Brightness of each step in stops.
    levels: Vec<Option<f64>>,
    /// Doubtful frames in a row.
    doubtful: u32,
}

impl Plausibility {
    pub(crate) fn new(steps: usize) -> Self {
        Self {
            levels: vec![None; steps],
            doubtful: 0,
        }
    }

    /// Checks a frame of `step` by its brightness in stops.
    pub(crate) fn check(&mut self, step: usize, brightness: f64) -> Verdict {
        let Some(own) = self.levels.get(step).copied().flatten() else {
            if let Some(level) = self.levels.get_mut(step) {
                *level = Some(brightness);
            }
            return Verdict::Plausible;
        };
        let from_own = (brightness - own).abs();
        // Clearly different from its own level, and much closer to another one.
        let looks_like = |other: f64| {
            let from_other = (brightness - other).abs();
            (other - own).abs() > MIN_DIFFERENCE && from_own > MIN_DIFFERENCE + 2.0 * from_other
        };
        if self.levels.iter().flatten().any(|level| looks_like(*level)) {
            self.doubtful += 1;
            return if self.doubtful >= MAX_DOUBTFUL {
                Verdict::OutOfStep
            } else {
                Verdict::Doubtful
            };
        }
        self.doubtful = 0;
        self.levels[step] = Some(own + LEARNING_RATE * (brightness - own));
        Verdict::Plausible
    }
}
