//! The motion of a simulated sensor.

use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use std::f64::consts::TAU;
use thiserror::Error;

/// A motion that repeats without end.
#[derive(Clone, Debug, PartialEq)]
pub enum Trajectory {
    /// A circle around a point in front of the transmitter, looking at the point and moving up
    /// and down.
    Orbit {
        /// Centre of the circle, metres.
        centre: DVec3,
        /// Radius of the circle, metres.
        radius: f64,
        /// Duration of one turn, seconds.
        period: f64,
    },
    /// Poses with their times in seconds, ascending. After the last one, the first one follows.
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

/// A file of poses is malformed. The message names the line and the expected format.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TrajectoryError {
    /// A line is not a pose.
    #[error("line {line}: {text:?} is not a pose; write `seconds x y z qx qy qz qw`")]
    Line {
        /// Line number, from 1.
        line: usize,
        /// The line.
        text: String,
    },
    /// The times do not ascend.
    #[error("line {line}: its time is not later than that of the line before")]
    Order {
        /// Line number, from 1.
        line: usize,
    },
    /// Fewer than two poses.
    #[error("has {poses} poses; at least two are needed")]
    Short {
        /// Number of poses.
        poses: usize,
    },
}

impl Trajectory {
    /// Parses lines of `seconds x y z qx qy qz qw` (the format of the TUM RGB-D benchmark) in
    /// metres, with unit quaternions; `#` begins a comment.
    ///
    /// # Errors
    /// A line is not a pose, the times do not ascend, or there are fewer than two poses.
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

    /// `transmitter_from_sensor` at `seconds` after the start.
    #[must_use]
    pub fn pose_at(&self, seconds: f64) -> RigidTransform {
        match self {
            Self::Orbit {
                centre,
                radius,
                period,
            } => orbit(*centre, *radius, TAU * seconds / period),
            Self::Poses(poses) => interpolated(poses, seconds),
        }
    }
}

/// The pose on the circle at `angle`: x axis towards the centre, z axis as far down as possible.
fn orbit(centre: DVec3, radius: f64, angle: f64) -> RigidTransform {
    let height = 0.2 * (3.0 * angle).sin();
    let offset = DVec3::new(angle.cos(), angle.sin(), height) * radius;
    let forward = -offset.normalize();
    let right = DVec3::Z.cross(forward).normalize();
    let down = forward.cross(right);
    let rotation = DQuat::from_mat3(&DMat3::from_cols(forward, right, down));
    RigidTransform::new(rotation, centre + offset)
}

/// The pose at `seconds`, interpolated.
fn interpolated(poses: &[(f64, RigidTransform)], seconds: f64) -> RigidTransform {
    let (Some(first), Some(last)) = (poses.first(), poses.last()) else {
        return RigidTransform::IDENTITY;
    };
    let at = first.0 + seconds.rem_euclid(last.0 - first.0);
    let after = poses.partition_point(|(time, _)| *time <= at);
    let (Some((t0, a)), Some((t1, b))) = (poses.get(after.max(1) - 1), poses.get(after)) else {
        return last.1;
    };
    let fraction = (at - t0) / (t1 - t0);
    RigidTransform::new(
        a.rotation.slerp(b.rotation, fraction),
        a.translation.lerp(b.translation, fraction),
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
    fn poses_are_interpolated_and_repeat() {
        let path = Trajectory::parse("# t x y z q\n5 0 0 0 0 0 0 1\n7 2 0 0 0 0 1 0\n").unwrap();
        let pose = path.pose_at(0.5);
        assert!((pose.translation.x - 0.5).abs() < 1e-12);
        assert!((pose.rotation.to_axis_angle().1 - TAU / 8.0).abs() < 1e-9);
        assert!((path.pose_at(2.5).translation.x - 0.5).abs() < 1e-12);
    }

    #[test]
    fn errors_name_the_line() {
        let error = |text| Trajectory::parse(text).unwrap_err().to_string();
        assert!(error("0 0 0 0 0 0 0 1\n1 2 3\n").starts_with("line 2: \"1 2 3\""));
        assert!(error("0 0 0 0 0 0 0 9\n").starts_with("line 1"));
        assert!(error("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").starts_with("line 2: its time"));
        assert!(error("").contains("two are needed"));
    }
}
