//! A cycle of exposure times: measures how the camera follows, then labels every frame
//! with the exposure that it really has.
//!
//! No I/O here: frames come in by their counter and brightness, wishes to set an exposure
//! go out.

mod cycle;
mod lag;
mod plausible;

use cycle::{Cycle, Timing};
use lag::{LagMeter, MAX_LAG, Wish};
use penumbra_interface::BracketSettings;
use plausible::{Plausibility, Verdict};

/// One exposure of the cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    /// In the control's unit, as the camera took it.
    pub exposure: i64,
    /// Stops relative to the base exposure.
    pub ev: f64,
}

/// What is to be done with a frame, and which step is to be set after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Answer {
    /// The step that the frame has; `None`: it is dropped.
    pub step: Option<usize>,
    /// The step to set now.
    pub set: Option<usize>,
}

enum State {
    Measuring(LagMeter),
    Cycling(Cycle),
}

/// A bracketing camera's state.
pub(crate) struct Bracketing {
    steps: Vec<Step>,
    hold: u64,
    base: usize,
    /// The step that is set: what the camera was told last.
    set: usize,
    /// Whether the lag is configured: then brightness is not asked.
    lag_is_known: bool,
    state: State,
    plausibility: Plausibility,
    /// What was found out about the camera's timing, in one line.
    pub(crate) finding: Option<String>,
}

/// The values to try for the settings' stops, with the base exposure in the control's unit.
pub(crate) fn exposures(settings: &BracketSettings, base: i64) -> Vec<i64> {
    let wanted = settings.stops.iter();
    wanted
        .map(|stops| (base as f64 * stops.exp2()).round().max(1.0) as i64)
        .collect()
}

/// The steps that a camera has after it took those values: equal ones (the range ended, or
/// its steps are coarse) are one.
pub(crate) fn steps(taken: &[i64], base: i64) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::with_capacity(taken.len());
    for &exposure in taken.iter().filter(|exposure| **exposure > 0) {
        if steps.iter().all(|step| step.exposure != exposure) {
            let ev = (exposure as f64 / base.max(1) as f64).log2();
            steps.push(Step { exposure, ev });
        }
    }
    steps
}

impl Bracketing {
    /// For a camera that has the base exposure now; `None` if fewer than two exposures, or
    /// no base among them, are left.
    pub(crate) fn new(settings: &BracketSettings, steps: Vec<Step>) -> Option<Self> {
        let base = steps.iter().position(|step| step.ev == 0.0)?;
        if steps.len() < 2 {
            return None;
        }
        let hold = u64::from(settings.hold.clamp(1, 30));
        let mut bracketing = Self {
            hold,
            base,
            set: base,
            lag_is_known: settings.lag.is_some(),
            state: State::Measuring(LagMeter::default()),
            plausibility: Plausibility::new(steps.len()),
            steps,
            finding: None,
        };
        if let Some(lag) = settings.lag {
            let timing = Timing {
                lag: lag.min(10).into(),
                guard: 0,
            };
            bracketing.start_cycle(Some(timing), 0);
        }
        Some(bracketing)
    }

    pub(crate) fn steps(&self) -> &[Step] {
        &self.steps
    }

    pub(crate) fn base(&self) -> Step {
        self.steps[self.base]
    }

    /// Whether [`Self::take`] needs the brightness of the pictures.
    pub(crate) const fn wants_brightness(&self) -> bool {
        !self.lag_is_known
    }

    /// Takes a frame by its counter and brightness (stops).
    pub(crate) fn take(&mut self, sequence: u64, stops: Option<f64>) -> Answer {
        match &mut self.state {
            State::Measuring(meter) => {
                let wish = stops.map_or(Wish::Frame, |stops| meter.take(sequence, stops));
                self.measured(sequence, wish)
            }
            State::Cycling(cycle) => {
                let set = cycle.due(sequence);
                let step = cycle.attribute(sequence);
                let verdict = match (step, stops) {
                    (Some(step), Some(stops)) => self.plausibility.judge(step, stops),
                    _ => Verdict::Fits,
                };
                self.judged(Answer { step, set }, verdict)
            }
        }
    }

    fn measured(&mut self, sequence: u64, wish: Wish) -> Answer {
        let set = match wish {
            Wish::Frame => None,
            Wish::Toggle if self.set == self.base => Some(self.farthest()),
            Wish::Toggle => Some(self.base),
            Wish::Done(timing) => {
                self.start_cycle(timing, sequence);
                None
            }
        };
        Answer { step: None, set }
    }

    fn judged(&mut self, answer: Answer, verdict: Verdict) -> Answer {
        let step = match verdict {
            Verdict::Fits => answer.step,
            Verdict::Doubtful => None,
            Verdict::Slipped => {
                self.state = State::Measuring(LagMeter::default());
                return Answer {
                    step: None,
                    set: Some(self.base),
                };
            }
        };
        Answer { step, ..answer }
    }

    /// The step was set after frame `sequence` was received.
    pub(crate) fn was_set(&mut self, sequence: u64, step: usize) {
        self.set = step;
        match &mut self.state {
            State::Measuring(meter) => meter.toggled(sequence),
            State::Cycling(cycle) => cycle.was_set(sequence, step),
        }
    }

    /// The step that differs most from the base: the easiest to see.
    fn farthest(&self) -> usize {
        let distance = |step: &Step| step.ev.abs();
        let steps = self.steps.iter().enumerate();
        let farthest = steps.max_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
        farthest.map_or(self.base, |(place, _)| place)
    }

    /// Begins to cycle. A camera whose lag could not be seen is given time enough for the
    /// longest one.
    fn start_cycle(&mut self, timing: Option<Timing>, sequence: u64) {
        let unknown = Timing {
            lag: 0,
            guard: MAX_LAG + 1,
        };
        self.finding = Some(match timing {
            Some(Timing { lag, .. }) => format!("bracketing: exposures apply after {lag} frames"),
            None => format!(
                "bracketing: the pictures do not show when an exposure applies (too dark, or too \
                 little light changes); each is kept for {} frames, set bracket.lag to be faster",
                unknown.guard + 1
            ),
        });
        let mut timing = timing.unwrap_or(unknown);
        if self.hold >= 2 {
            timing.guard = timing.guard.max(1);
        }
        let now = (self.set, sequence);
        self.plausibility = Plausibility::new(self.steps.len());
        self.state = State::Cycling(Cycle::new(self.steps.len(), self.hold, timing, now));
    }
}

#[cfg(test)]
mod tests;
