//! A tracker's pose at any time.

use super::without_jumps;
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;

/// Readings that the window holds at least, to either side.
const NEIGHBOURS: f64 = 3.0;

/// Orientations, and places where they are known, by time; between them is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerTrack {
    times: Vec<f64>,
    rotations: Vec<DQuat>,
    /// As many, or none.
    places: Vec<DVec3>,
    /// Half the window, seconds.
    window: f64,
}

impl TrackerTrack {
    /// From readings (seconds by the tracker's stamps, `transmitter_from_sensor`); those out
    /// of order or far off for a moment are left out. Noise is smoothed over `smoothing` seconds to either side, or
    /// three readings if that is more.
    #[must_use]
    pub fn new(readings: impl IntoIterator<Item = (f64, DQuat)>, smoothing: f64) -> Self {
        let whole = |(time, rotation)| (time, RigidTransform::new(rotation, DVec3::ZERO));
        Self {
            places: Vec::new(),
            ..Self::of_poses(readings.into_iter().map(whole), smoothing)
        }
    }

    /// The same from readings of places, too.
    #[must_use]
    pub fn of_poses(
        readings: impl IntoIterator<Item = (f64, RigidTransform)>,
        smoothing: f64,
    ) -> Self {
        let mut kept: Vec<(f64, RigidTransform)> = Vec::new();
        for (time, pose) in readings {
            let finite = pose.rotation.is_finite() && pose.translation.is_finite();
            if kept.last().is_none_or(|last| time > last.0) && finite {
                kept.push((time, pose));
            }
        }
        let kept = without_jumps(kept);
        let times: Vec<f64> = kept.iter().map(|k| k.0).collect();
        let rotations = kept.iter().map(|k| k.1.rotation).collect();
        let places = kept.iter().map(|k| k.1.translation).collect();
        let count = times.len().saturating_sub(1).max(1) as f64;
        let interval = match (times.first(), times.last()) {
            (Some(first), Some(last)) => (last - first) / count,
            _ => 0.0,
        };
        Self {
            window: smoothing.max(NEIGHBOURS * interval).max(1e-9),
            times,
            rotations,
            places,
        }
    }

    /// Whether it tells places.
    #[must_use]
    pub fn has_places(&self) -> bool {
        !self.places.is_empty()
    }

    /// First and last reading; an empty span at 0 without any.
    #[must_use]
    pub fn span(&self) -> (f64, f64) {
        match (self.times.first(), self.times.last()) {
            (Some(first), Some(last)) => (*first, *last),
            _ => (0.0, 0.0),
        }
    }

    /// Mean of its places; zero where none are known.
    #[must_use]
    pub fn middle(&self) -> DVec3 {
        self.places.iter().sum::<DVec3>() / self.places.len().max(1) as f64
    }

    /// Whether there are readings close to a time on both sides: in a gap an answer is a guess.
    #[must_use]
    pub fn covers(&self, time: f64) -> bool {
        let after = self.times.partition_point(|t| *t < time);
        let near = |i: usize| {
            let reading = self.times.get(i);
            reading.is_some_and(|t| (t - time).abs() <= self.window)
        };
        near(after) && after.checked_sub(1).is_some_and(near)
    }

    // ┌ Rotation vectors y(tᵢ) from the nearest reading, weights w = (1 − u²)², u = (tᵢ − t)/h; ┐
    // └ the line of least squares at t. Interpolated between two readings instead, noise would  ┘
    //   be least half way between them, and pull the offset there: camera and tracker often keep
    //   step.
    /// The orientation at a time between the first and the last reading.
    #[must_use]
    pub fn at(&self, time: f64) -> Option<DQuat> {
        Some(self.pose_at(time)?.rotation)
    }

    /// The pose; its place is zero where none is known.
    #[must_use]
    pub fn pose_at(&self, time: f64) -> Option<RigidTransform> {
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
        let (mut p0, mut p1) = (DVec3::ZERO, DVec3::ZERO);
        let place = |i: usize| self.places.get(i).copied().unwrap_or(DVec3::ZERO);
        let near = place(nearest);
        for i in low..high {
            let u = (self.times[i] - time) / self.window;
            let w = (1.0 - u * u).powi(2);
            let turn = reference.inverse() * self.rotations[i];
            let y = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
            let p = place(i) - near;
            (s0, s1, s2) = (s0 + w, s1 + w * u, s2 + w * u * u);
            (y0, y1) = (y0 + y * w, y1 + y * (w * u));
            (p0, p1) = (p0 + p * w, p1 + p * (w * u));
        }
        let det = s0 * s2 - s1 * s1;
        let (turned, moved) = if det > 1e-6 * s0 * s0 {
            ((y0 * s2 - y1 * s1) / det, (p0 * s2 - p1 * s1) / det)
        } else {
            // A gap: the nearest reading alone.
            (DVec3::ZERO, DVec3::ZERO)
        };
        Some(RigidTransform::new(
            (reference * DQuat::from_scaled_axis(turned)).normalize(),
            near + moved,
        ))
    }
}
