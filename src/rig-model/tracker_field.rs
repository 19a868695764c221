//! Field distortion of an electromagnetic tracker: a static map of corrections.
//!
//! ```text
//!  u = (p − low)/h,   w_ijk = B(u_x − i) B(u_y − j) B(u_z − k)   (uniform cubic B-spline)
//!  p' = p + s Σ w_ijk shift_ijk,   R' = exp(s Σ w_ijk turn_ijk) R
//!  s = 1 within the volume, falls to 0 within one cell's width outside of it
//! ```
//! (Ikits et al., "An improved calibration framework for electromagnetic tracking devices",
//! IEEE VR 2001; Kindratenko's survey, Virtual Reality 5, 2000.)

use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::smoothstep;

/// Corrections at a grid of control points, in the transmitter's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerField {
    grid: Grid,
    /// Translation (metres) and rotation vector (radians) by control point, x fastest.
    values: Vec<(DVec3, DVec3)>,
}

/// A grid of cubic cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Minimum corner of the volume, transmitter's frame, metres.
    pub low: DVec3,
    /// Edge of a cell, metres.
    pub spacing: f64,
    /// Number of cells along each axis; there are three more control points.
    pub cells: [usize; 3],
}

impl Grid {
    /// Number of control points along an axis.
    #[must_use]
    pub const fn points(&self, axis: usize) -> usize {
        self.cells[axis] + 3
    }

    /// Total number of control points.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.points(0) * self.points(1) * self.points(2)
    }

    /// Index of a control point.
    #[must_use]
    pub const fn index(&self, x: usize, y: usize, z: usize) -> usize {
        (z * self.points(1) + y) * self.points(0) + x
    }

    /// Maximum corner of the volume, metres.
    #[must_use]
    pub fn high(&self) -> DVec3 {
        self.low + DVec3::from(self.cells.map(|c| c as f64)) * self.spacing
    }

    /// Calls `with` for the 64 control points around a position with their weights, which sum to 1.
    pub fn weigh(&self, place: DVec3, mut with: impl FnMut(usize, f64)) {
        let inside = place.clamp(self.low, self.high());
        let u = (inside - self.low) / self.spacing;
        let (mut first, mut weights) = ([0; 3], [[0.0; 4]; 3]);
        for axis in 0..3 {
            first[axis] = (u[axis] as usize).min(self.cells[axis] - 1);
            weights[axis] = cubic(u[axis] - first[axis] as f64);
        }
        for (k, z) in weights[2].iter().enumerate() {
            for (j, y) in weights[1].iter().enumerate() {
                for (i, x) in weights[0].iter().enumerate() {
                    let at = self.index(first[0] + i, first[1] + j, first[2] + k);
                    with(at, x * y * z);
                }
            }
        }
    }

    /// Blending weight: 1 within the volume, 0 beyond one cell outside of it.
    fn presence(&self, place: DVec3) -> f64 {
        let outside = place.distance(place.clamp(self.low, self.high()));
        smoothstep(0.0, 1.0, 1.0 - outside / self.spacing)
    }
}

/// The four pieces of the cubic B-spline at `t` from 0 to 1.
fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3, back) = (t * t, t * t * t, 1.0 - t);
    [
        back * back * back / 6.0,
        (3.0 * t3 - 6.0 * t2 + 4.0) / 6.0,
        (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0) / 6.0,
        t3 / 6.0,
    ]
}

impl TrackerField {
    /// Creates a field; `None` if the number of corrections is not that of the control points.
    #[must_use]
    pub fn new(grid: Grid, values: Vec<(DVec3, DVec3)>) -> Option<Self> {
        let sound = grid.spacing > 0.0 && grid.cells.iter().all(|c| (1..=64).contains(c));
        (sound && values.len() == grid.count()).then_some(Self { grid, values })
    }

    /// The grid.
    #[must_use]
    pub const fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Translations (metres) and rotation vectors (radians) by control point, x fastest.
    #[must_use]
    pub fn values(&self) -> &[(DVec3, DVec3)] {
        &self.values
    }

    /// Corrects a reading. Far outside of the volume, the reading is returned unchanged.
    #[must_use]
    pub fn correct(&self, transmitter_from_sensor: RigidTransform) -> RigidTransform {
        let (shift, turn) = self.at(transmitter_from_sensor.translation);
        RigidTransform::new(
            (DQuat::from_scaled_axis(turn) * transmitter_from_sensor.rotation).normalize(),
            transmitter_from_sensor.translation + shift,
        )
    }

    /// Returns the correction (translation in metres, rotation vector in radians) at a read position.
    #[must_use]
    pub fn at(&self, place: DVec3) -> (DVec3, DVec3) {
        let presence = self.grid.presence(place);
        if presence <= 0.0 || !place.is_finite() {
            return (DVec3::ZERO, DVec3::ZERO);
        }
        let (mut shift, mut turn) = (DVec3::ZERO, DVec3::ZERO);
        self.grid.weigh(place, |i, weight| {
            let (s, t) = self.values[i];
            (shift, turn) = (shift + s * weight, turn + t * weight);
        });
        (shift * presence, turn * presence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid {
            low: DVec3::new(0.2, -0.1, -0.3),
            spacing: 0.1,
            cells: [3, 2, 1],
        }
    }

    #[test]
    fn uniform_corrections_apply_inside_and_vanish_far_outside() {
        let (shift, turn) = (DVec3::new(0.01, -0.02, 0.003), DVec3::new(0.0, 0.05, 0.01));
        let field = TrackerField::new(grid(), vec![(shift, turn); grid().count()]).unwrap();
        let pose = RigidTransform::new(DQuat::from_rotation_x(0.3), DVec3::new(0.3, 0.0, -0.25));
        let corrected = field.correct(pose);
        assert!((corrected.translation - pose.translation).distance(shift) < 1e-12);
        let turned = corrected.rotation * pose.rotation.inverse();
        assert!(turned.angle_between(DQuat::from_scaled_axis(turn)) < 1e-7);
        let far = RigidTransform::new(pose.rotation, DVec3::new(2.0, 0.0, 0.0));
        assert_eq!(field.correct(far).translation, far.translation);
    }

    #[test]
    fn correction_is_continuous() {
        let values = (0..grid().count()).map(|i| {
            let v = DVec3::splat((i as f64 * 0.7).sin()) * 0.02;
            (v, v)
        });
        let field = TrackerField::new(grid(), values.collect()).unwrap();
        let mut last = field.at(DVec3::new(-0.2, 0.03, -0.27)).0;
        for i in 0..20_000 {
            let here = field
                .at(DVec3::new(-0.2 + f64::from(i) * 5e-5, 0.03, -0.27))
                .0;
            assert!(here.distance(last) < 1e-4, "{i}");
            last = here;
        }
    }

    #[test]
    fn rejects_wrong_number_of_corrections() {
        assert_eq!(TrackerField::new(grid(), Vec::new()), None);
    }
}
