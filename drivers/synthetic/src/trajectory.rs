//! Where a simulated sensor goes.

use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use std::f64::consts::TAU;
use thiserror::Error;

/// A path over time, endless.
#[derive(Clone, Debug, PartialEq)]
pub enum Trajectory {
    /// Once around a point in front of the transmitter, looking at it, with a slow nod.
    Orbit {
        /// The point looked at, metres.
        centre: DVec3,
        /// Metres.
        radius: f64,
        /// Seconds for a turn.
        period: f64,
    },
    /// Poses with their seconds, ascending; begins again after the last.
    Poses(Vec<(f64, RigidTransform)>),
}

impl Default for Trajectory {
    fn default() -> Self {
        Self::Orbit {
            centre: DVec3::new(0.55, 0.0, 0.1),
            radius: 0.25,
            period: 12.0,
        }
    }
}

/// A file of poses cannot be read. Says where and what would be right.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TrajectoryError {
    /// A line that is no pose.
    #[error("line {line}: {text:?} is no pose; write `seconds x y z qx qy qz qw`")]
    Line {
        /// From 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// Seconds that do not ascend.
    #[error("line {line}: its time is not after the line before")]
    Order {
        /// From 1.
        line: usize,
    },
    /// Not enough to move between.
    #[error("has {poses} poses; two are needed")]
    Short {
        /// How many.
        poses: usize,
    },
}

impl Trajectory {
    /// From lines of `seconds x y z qx qy qz qw` (TUM's form), metres, unit quaternions;
    /// `#` begins a comment.
    ///
    /// # Errors
    /// A line that is none, times that do not ascend, fewer than two poses.
    pub fn parse(text: &str) -> Result<Self, TrajectoryError> {
        let mut poses: Vec<(f64, RigidTransform)> = Vec::new();
        for (i, text) in text.lines().enumerate() {
            let line = i + 1;
            let content = text.split('#').next().unwrap_or_default().trim();
            if content.is_empty() {
                continue;
            }
            let pose = pose_line(content).ok_or_else(|| TrajectoryError::Line {
                line,
                text: text.chars().take(60).collect(),
            })?;
            if poses.last().is_some_and(|(before, _)| *before >= pose.0) {
                return Err(TrajectoryError::Order { line });
            }
            poses.push(pose);
        }
        match poses.len() {
            poses @ 0..2 => Err(TrajectoryError::Short { poses }),
            _ => Ok(Self::Poses(poses)),
        }
    }

    /// `transmitter_from_sensor` so many seconds after the beginning.
    #[must_use]
    pub fn pose_at(&self, seconds: f64) -> RigidTransform {
        match self {
            Self::Orbit {
                centre,
                radius,
                period,
            } => orbit(*centre, *radius, TAU * seconds / period),
            Self::Poses(poses) => between(poses, seconds),
        }
    }
}

/// On the circle at `angle`, x axis towards the centre, z axis as far down as it can.
fn orbit(centre: DVec3, radius: f64, angle: f64) -> RigidTransform {
    let nod = 0.2 * (3.0 * angle).sin();
    let offset = DVec3::new(angle.cos(), angle.sin(), nod) * radius;
    let forward = -offset.normalize();
    let right = DVec3::Z.cross(forward).normalize();
    let down = forward.cross(right);
    let rotation = DQuat::from_mat3(&DMat3::from_cols(forward, right, down));
    RigidTransform::new(rotation, centre + offset)
}

fn between(poses: &[(f64, RigidTransform)], seconds: f64) -> RigidTransform {
    let (Some(first), Some(last)) = (poses.first(), poses.last()) else {
        return RigidTransform::IDENTITY;
    };
    let at = first.0 + seconds.rem_euclid(last.0 - first.0);
    let after = poses.partition_point(|(time, _)| *time <= at);
    let (Some((t0, a)), Some((t1, b))) = (poses.get(after.max(1) - 1), poses.get(after)) else {
        return last.1;
    };
    let part = (at - t0) / (t1 - t0);
    RigidTransform::new(
        a.rotation.slerp(b.rotation, part),
        a.translation.lerp(b.translation, part),
    )
}

fn pose_line(line: &str) -> Option<(f64, RigidTransform)> {
    let mut values = [0.0; 8];
    let mut fields = line
        .split([' ', '\t', ','])
        .filter(|field| !field.is_empty());
    for value in &mut values {
        *value = fields
            .next()?
            .parse::<f64>()
            .ok()
            .filter(|v| v.is_finite())?;
    }
    let [seconds, x, y, z, qx, qy, qz, qw] = values;
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    let is_unit = (rotation.length() - 1.0).abs() < 0.01;
    (is_unit && fields.next().is_none()).then(|| {
        let pose = RigidTransform::new(rotation.normalize(), DVec3::new(x, y, z));
        (seconds, pose)
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]
    use super::*;

    #[test]
    fn an_orbit_looks_at_its_centre_and_closes() {
        let path = Trajectory::default();
        let centre = DVec3::new(0.55, 0.0, 0.1);
        for step in 0..24 {
            let pose = path.pose_at(f64::from(step) * 0.5);
            let ahead = pose.rotation * DVec3::X;
            let towards = (centre - pose.translation).normalize();
            assert!((ahead - towards).length() < 1e-9);
            assert!((pose.rotation * DVec3::Z).z > 0.5);
        }
        let turned = path.pose_at(12.0).translation - path.pose_at(0.0).translation;
        assert!(turned.length() < 1e-9);
    }

    #[test]
    fn poses_are_interpolated_and_begin_again() {
        let path = Trajectory::parse("# t x y z q\n5 0 0 0 0 0 0 1\n7 2 0 0 0 0 1 0\n").unwrap();
        let pose = path.pose_at(0.5);
        assert!((pose.translation.x - 0.5).abs() < 1e-12);
        assert!((pose.rotation.to_axis_angle().1 - TAU / 8.0).abs() < 1e-9);
        assert!((path.pose_at(2.5).translation.x - 0.5).abs() < 1e-12);
    }

    #[test]
    fn bad_files_say_where() {
        let error = |text| Trajectory::parse(text).unwrap_err().to_string();
        assert!(error("0 0 0 0 0 0 0 1\n1 2 3\n").starts_with("line 2: \"1 2 3\""));
        assert!(error("0 0 0 0 0 0 0 9\n").starts_with("line 1"));
        assert!(error("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").starts_with("line 2: its time"));
        assert!(error("").contains("two are needed"));
    }
}
