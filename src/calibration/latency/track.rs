//! A tracker's orientation at any time.

use glam::{DQuat, DVec3};

/// Readings that the window holds at least, to either side.
const NEIGHBOURS: f64 = 3.0;

/// Orientations by time, between which is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerTrack {
    times: Vec<f64>,
    rotations: Vec<DQuat>,
    /// Half the window, seconds.
    window: f64,
}

impl TrackerTrack {
    /// From readings (seconds by the tracker's stamps, `transmitter_from_sensor`); those out
    /// of order are left out. Noise is smoothed over `smoothing` seconds to either side, or
    /// three readings if that is more.
    #[must_use]
    pub fn new(readings: impl IntoIterator<Item = (f64, DQuat)>, smoothing: f64) -> Self {
        let (mut times, mut rotations): (Vec<f64>, Vec<DQuat>) = (Vec::new(), Vec::new());
        for (time, rotation) in readings {
            if times.last().is_none_or(|last| time > *last) && rotation.is_finite() {
                times.push(time);
                rotations.push(rotation);
            }
        }
        let count = times.len().saturating_sub(1).max(1) as f64;
        let interval = match (times.first(), times.last()) {
            (Some(first), Some(last)) => (last - first) / count,
            _ => 0.0,
        };
        Self {
            window: smoothing.max(NEIGHBOURS * interval).max(1e-9),
            times,
            rotations,
        }
    }

    /// First and last reading; an empty span at 0 without any.
    #[must_use]
    pub fn span(&self) -> (f64, f64) {
        match (self.times.first(), self.times.last()) {
            (Some(first), Some(last)) => (*first, *last),
            _ => (0.0, 0.0),
        }
    }

    // ┌ Rotation vectors y(tᵢ) from the nearest reading, weights w = (1 − u²)², u = (tᵢ − t)/h; ┐
    // └ the line of least squares at t. Interpolated between two readings instead, noise would  ┘
    //   be least half way between them, and pull the offset there: camera and tracker often keep
    //   step.
    /// The orientation at a time between the first and the last reading.
    #[must_use]
    pub fn at(&self, time: f64) -> Option<DQuat> {
        let (first, last) = self.span();
        if self.times.is_empty() || time < first || time > last {
            return None;
        }
        let low = self.times.partition_point(|t| *t <= time - self.window);
        let high = self.times.partition_point(|t| *t < time + self.window);
        let nearest = self
            .times
            .partition_point(|t| *t < time)
            .min(self.times.len() - 1);
        let reference = self.rotations[nearest];
        let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
        let (mut y0, mut y1) = (DVec3::ZERO, DVec3::ZERO);
        for (t, q) in self.times[low..high].iter().zip(&self.rotations[low..high]) {
            let u = (t - time) / self.window;
            let w = (1.0 - u * u).powi(2);
            let turn = reference.inverse() * *q;
            let y = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
            (s0, s1, s2) = (s0 + w, s1 + w * u, s2 + w * u * u);
            (y0, y1) = (y0 + y * w, y1 + y * (w * u));
        }
        let det = s0 * s2 - s1 * s1;
        let value = if det > 1e-6 * s0 * s0 {
            (y0 * s2 - y1 * s1) / det
        } else {
            // A gap: the nearest reading alone.
            DVec3::ZERO
        };
        Some((reference * DQuat::from_scaled_axis(value)).normalize())
    }
}
