//! Cycles the exposure time (exposure bracketing) and labels every frame with the exposure
//! that it really has.
//!
//! Cameras apply a new exposure time some frames late. How late is measured first, from the
//! brightness of frames. There is no I/O here: frames come in with their counter and
//! brightness, and requests to set an exposure go out.

mod cycle;
mod lag;
mod plausibility;

use cycle::{Cycle, Timing};
use lag::{LagEstimator, MAX_LAG, Request};
use penumbra_interface::BracketSettings;
use plausibility::{Plausibility, Verdict};

/// The longest lag in frames that the settings may give.
const MAX_CONFIGURED_LAG: u32 = 10;
/// The most frames for which the settings may hold an exposure.
const MAX_HOLD: u32 = 30;

/// One exposure of the cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    /// In the unit of the control, as the camera has accepted it.
    pub exposure: i64,
    /// Stops relative to the base exposure.
    pub ev: f64,
}

/// What to do with a frame, and what to set after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Decision {
    /// The step that the frame was exposed with, as an index; `None`: drop the frame.
    pub step: Option<usize>,
    /// The step to set now, as an index.
    pub set: Option<usize>,
}

enum State {
    MeasuringLag(LagEstimator),
    Cycling(Cycle),
}

/// The state of a camera whose exposures are bracketed.
pub(crate) struct Bracketing {
    steps: Vec<Step>,
    hold: u64,
    /// Index of the base exposure.
    base: usize,
    /// Index of the step that was set last.
    set: usize,
    /// Whether the settings give the lag. Brightness is then not needed.
    lag_is_configured: bool,
    state: State,
    plausibility: Plausibility,
    /// What was found out about the camera's timing, for the user.
    pub(crate) timing_note: Option<String>,
}

/// The exposures to try for the stops in the settings. `base` and the result are in the unit of
/// the control.
pub(crate) fn exposures(settings: &BracketSettings, base: i64) -> Vec<i64> {
    let stops = settings.stops.iter();
    stops
        .map(|stops| (base as f64 * stops.exp2()).round().max(1.0) as i64)
        .collect()
}

/// The steps of a camera, from the exposures that it accepted. Exposures that became equal,
/// because the control's range ended or its steps are coarse, are one step.
pub(crate) fn steps(accepted: &[i64], base: i64) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::with_capacity(accepted.len());
    for &exposure in accepted.iter().filter(|exposure| **exposure > 0) {
        if steps.iter().all(|step| step.exposure != exposure) {
            let ev = (exposure as f64 / base.max(1) as f64).log2();
            steps.push(Step { exposure, ev });
        }
    }
    steps
}

impl Bracketing {
    /// For a camera that has the base exposure at present. `None` if there are fewer than two
    /// steps or none of them is the base.
    pub(crate) fn new(settings: &BracketSettings, steps: Vec<Step>) -> Option<Self> {
        let base = steps.iter().position(|step| step.ev == 0.0)?;
        if steps.len() < 2 {
            return None;
        }
        let mut bracketing = Self {
            hold: u64::from(settings.hold.clamp(1, MAX_HOLD)),
            base,
            set: base,
            lag_is_configured: settings.lag.is_some(),
            state: State::MeasuringLag(LagEstimator::default()),
            plausibility: Plausibility::new(steps.len()),
            steps,
            timing_note: None,
        };
        if let Some(lag) = settings.lag {
            let timing = Timing {
                lag: lag.min(MAX_CONFIGURED_LAG).into(),
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

    /// Whether [`Self::on_frame`] needs the brightness of the frames.
    pub(crate) const fn needs_brightness(&self) -> bool {
        !self.lag_is_configured
    }

    /// Handles a frame, given by its counter and its brightness in stops.
    pub(crate) fn on_frame(&mut self, sequence: u64, brightness: Option<f64>) -> Decision {
        match &mut self.state {
            State::MeasuringLag(estimator) => {
                let request = brightness.map_or(Request::NextFrame, |brightness| {
                    estimator.on_frame(sequence, brightness)
                });
                Decision {
                    step: None,
                    set: self.on_request(request, sequence),
                }
            }
            State::Cycling(cycle) => {
                let set = cycle.next_step(sequence);
                let step = cycle.step_of(sequence);
                let verdict = match (step, brightness) {
                    (Some(step), Some(brightness)) => self.plausibility.check(step, brightness),
                    _ => Verdict::Plausible,
                };
                self.on_verdict(Decision { step, set }, verdict)
            }
        }
    }

    /// The step to set for a request of the lag estimator.
    fn on_request(&mut self, request: Request, sequence: u64) -> Option<usize> {
        match request {
            Request::NextFrame => None,
            Request::Toggle if self.set == self.base => Some(self.farthest_from_base()),
            Request::Toggle => Some(self.base),
            Request::Done(timing) => {
                self.start_cycle(timing, sequence);
                None
            }
        }
    }

    fn on_verdict(&mut self, decision: Decision, verdict: Verdict) -> Decision {
        match verdict {
            Verdict::Plausible => decision,
            Verdict::Doubtful => Decision {
                step: None,
                ..decision
            },
            Verdict::OutOfStep => {
                self.state = State::MeasuringLag(LagEstimator::default());
                Decision {
                    step: None,
                    set: Some(self.base),
                }
            }
        }
    }

    /// Call this when a step was set, after frame `sequence` was received.
    pub(crate) fn on_set(&mut self, sequence: u64, step: usize) {
        self.set = step;
        match &mut self.state {
            State::MeasuringLag(estimator) => estimator.on_toggle(sequence),
            State::Cycling(cycle) => cycle.on_set(sequence, step),
        }
    }

    /// The step that differs most from the base, because its effect is the easiest to see.
    fn farthest_from_base(&self) -> usize {
        let distance = |step: &Step| step.ev.abs();
        let steps = self.steps.iter().enumerate();
        let farthest = steps.max_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
        farthest.map_or(self.base, |(index, _)| index)
    }

    /// Starts to cycle. If the lag could not be measured, the longest possible one is assumed.
    fn start_cycle(&mut self, timing: Option<Timing>, sequence: u64) {
        let unknown = Timing {
            lag: 0,
            guard: MAX_LAG + 1,
        };
        self.timing_note = Some(match timing {
            Some(Timing { lag, .. }) => {
                format!("bracketing: new exposures take effect after {lag} frames")
            }
            None => format!(
                "bracketing: the pictures do not show when a new exposure takes effect (too dark, \
                 or too little difference); each is kept for {} frames, set bracket.lag to be \
                 faster",
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
