//! A tracker's pose at any time.

use super::jumps::without_jumps;
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{rotation_vector, tukey_weight};

/// Minimum number of readings in the window to either side.
const MIN_NEIGHBOURS: f64 = 3.0;

/// Orientations, and positions where they are known, with local fits between them.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerTrack {
    times: Vec<f64>,
    rotations: Vec<DQuat>,
    /// One for each time, or none.
    positions: Vec<DVec3>,
    /// Half the window, seconds.
    window: f64,
}

impl TrackerTrack {
    /// Creates a track from readings (tracker's time stamp in seconds, `transmitter_from_sensor`).
    /// Readings out of order and momentary jumps are dropped. Noise is smoothed over `smoothing`
    /// seconds to either side, or three readings if those span more.
    #[must_use]
    pub fn new(readings: impl IntoIterator<Item = (f64, DQuat)>, smoothing: f64) -> Self {
        let pose = |(time, rotation)| (time, RigidTransform::new(rotation, DVec3::ZERO));
        Self {
            positions: Vec::new(),
            ..Self::from_poses(readings.into_iter().map(pose), smoothing)
        }
    }

    /// Creates a track from readings with positions; see [`Self::new`].
    #[must_use]
    pub fn from_poses(
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
        let positions = kept.iter().map(|k| k.1.translation).collect();
        let count = times.len().saturating_sub(1).max(1) as f64;
        let interval = match (times.first(), times.last()) {
            (Some(first), Some(last)) => (last - first) / count,
            _ => 0.0,
        };
        Self {
            window: smoothing.max(MIN_NEIGHBOURS * interval).max(1e-9),
            times,
            rotations,
            positions,
        }
    }

    /// Returns whether positions are known.
    #[must_use]
    pub fn has_positions(&self) -> bool {
        !self.positions.is_empty()
    }

    /// Returns the times of the first and the last reading; zeros without readings.
    #[must_use]
    pub fn span(&self) -> (f64, f64) {
        match (self.times.first(), self.times.last()) {
            (Some(first), Some(last)) => (*first, *last),
            _ => (0.0, 0.0),
        }
    }

    /// Returns the mean position; zero where positions are unknown.
    #[must_use]
    pub fn mean_position(&self) -> DVec3 {
        self.positions.iter().sum::<DVec3>() / self.positions.len().max(1) as f64
    }

    /// Returns whether there are readings close to a time on both sides; within a gap the pose is a
    /// guess.
    #[must_use]
    pub fn covers(&self, time: f64) -> bool {
        let after = self.times.partition_point(|t| *t < time);
        let near = |i: usize| {
            let reading = self.times.get(i);
            reading.is_some_and(|t| (t - time).abs() <= self.window)
        };
        near(after) && after.checked_sub(1).is_some_and(near)
    }

    /// Returns the orientation at a time between the first and the last reading.
    #[must_use]
    pub fn rotation_at(&self, time: f64) -> Option<DQuat> {
        Some(self.pose_at(time)?.rotation)
    }

    // ┌ Rotation vectors y(tᵢ) from the nearest reading, weights w = (1 − u²)², u = (tᵢ − t)/h;  ┐
    // │ the line of least squares at t. With interpolation between two readings instead, noise   │
    // │ would be least half way between them, which would bias the offset, as the frequencies of │
    // └ camera and tracker are often multiples of each other.                                    ┘
    /// Returns the pose at a time between the first and the last reading; its position is zero where
    /// positions are unknown.
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
        let position = |i: usize| self.positions.get(i).copied().unwrap_or(DVec3::ZERO);
        let near = position(nearest);
        for i in low..high {
            let u = (self.times[i] - time) / self.window;
            let w = tukey_weight(u);
            let y = rotation_vector(reference.inverse() * self.rotations[i]);
            let p = position(i) - near;
            (s0, s1, s2) = (s0 + w, s1 + w * u, s2 + w * u * u);
            (y0, y1) = (y0 + y * w, y1 + y * (w * u));
            (p0, p1) = (p0 + p * w, p1 + p * (w * u));
        }
        let det = s0 * s2 - s1 * s1;
        let (rotation, translation) = if det > 1e-6 * s0 * s0 {
            ((y0 * s2 - y1 * s1) / det, (p0 * s2 - p1 * s1) / det)
        } else {
            // In a gap, the nearest reading alone.
            (DVec3::ZERO, DVec3::ZERO)
        };
        Some(RigidTransform::new(
            (reference * DQuat::from_scaled_axis(rotation)).normalize(),
            near + translation,
        ))
    }
}
