//! How long each step on the way from picture to light took, for reports.

use std::time::{Duration, Instant};

/// Steps in their order, each with the time since the one before it ended.
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
    /// Forgets the last picture; the next step begins now.
    pub(super) fn begin(&mut self) {
        self.times.clear();
        self.last = Instant::now();
    }

    /// A step is done.
    pub(super) fn done(&mut self, name: &'static str) {
        let now = Instant::now();
        self.times.push((name, now - self.last));
        self.last = now;
    }

    /// Of the last picture.
    #[must_use]
    pub fn times(&self) -> &[(&'static str, Duration)] {
        &self.times
    }
}
