//! Durations of the estimator's steps, for reports.

use std::time::{Duration, Instant};

/// The steps in order, each with its duration.
#[derive(Clone, Debug)]
pub struct Stages {
    times: Vec<(&'static str, Duration)>,
    last: Instant,
}

impl Default for Stages {
    fn default() -> Self {
        Self {
            times: Vec::new(),
            last: Instant::now(),
        }
    }
}

impl Stages {
    /// Clears the durations and starts the clock of the first step.
    pub(super) fn begin(&mut self) {
        self.times.clear();
        self.last = Instant::now();
    }

    /// Records the duration of a completed step.
    pub(super) fn done(&mut self, name: &'static str) {
        let now = Instant::now();
        self.times.push((name, now - self.last));
        self.last = now;
    }

    /// Returns the durations of the last update.
    #[must_use]
    pub fn times(&self) -> &[(&'static str, Duration)] {
        &self.times
    }
}
