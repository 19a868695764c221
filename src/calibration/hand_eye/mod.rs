//! Hand–eye calibration: the camera's pose on the tracked sensor, and the pose of the tracker's
//! transmitter in the world.
//!
//! Every pair of simultaneous poses satisfies
//!
//! > `world_from_camera` = `world_from_transmitter` · `transmitter_from_sensor` · `sensor_from_camera`
//!
//! with the first and last factor on the right unknown. `model` holds the data; `closed_form`
//! solves the motion form A X = X B, robustly by consensus; `refine` minimises the residuals of
//! all consistent pairs and derives the uncertainty.

mod closed_form;
mod model;
mod refine;

pub use model::{HandEye, PosePair};

use model::MIN_PAIRS;
use thiserror::Error;

/// Why the mounting could not be found. Each message says what to do.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum HandEyeError {
    /// Too few pairs.
    #[error(
        "{pairs} pairs of poses, at least {needed} are needed; move the rig in view of the markers for half a minute"
    )]
    TooFew {
        /// Pairs given.
        pairs: usize,
        /// Pairs needed.
        needed: usize,
    },
    /// The rig was hardly rotated.
    #[error(
        "the rig was rotated by {degrees:.1} degrees at most; rotate it by 30 degrees or more about different axes"
    )]
    NoRotation {
        /// Largest rotation angle between two poses.
        degrees: f64,
    },
    /// All rotations were about one axis.
    #[error(
        "all rotations were about nearly one axis ({degrees:.1} degrees about others), which leaves the position along it undetermined; tilt and roll the rig as well"
    )]
    OneAxis {
        /// RMS rotation about the second axis.
        degrees: f64,
    },
    /// No fixed mounting of the camera on the sensor explains the pairs.
    #[error(
        "only {percent:.0} % of the poses are consistent with one mounting; check the time offset between tracker and camera, and that nothing on the rig moved"
    )]
    Inconsistent {
        /// Share of the pairs that are consistent.
        percent: f64,
    },
}

/// Minimum rotation between two poses for their motion to be used, radians.
const MIN_ROTATION: f64 = 0.12;
/// Minimum RMS rotation about the second principal axis, radians.
const MIN_SECOND_AXIS: f64 = 0.05;
/// Minimum share of the pairs that must be consistent.
const MIN_CONSISTENT_SHARE: f64 = 0.5;

/// Solves for the mounting robustly: wrong poses among the pairs are rejected as outliers.
///
/// # Errors
/// Too few pairs; too little rotation, or rotation about one axis only; no mounting with which
/// half of the pairs are consistent.
pub fn hand_eye(pairs: &[PosePair]) -> Result<HandEye, HandEyeError> {
    if pairs.len() < MIN_PAIRS {
        return Err(HandEyeError::TooFew {
            pairs: pairs.len(),
            needed: MIN_PAIRS,
        });
    }
    let motions = closed_form::motions(pairs, MIN_ROTATION);
    if motions.len() < 3 {
        return Err(HandEyeError::NoRotation {
            degrees: closed_form::largest_rotation(pairs).to_degrees(),
        });
    }
    let second_axis = closed_form::second_axis(&motions);
    if second_axis < MIN_SECOND_AXIS {
        return Err(HandEyeError::OneAxis {
            degrees: second_axis.to_degrees(),
        });
    }
    let (start, mut used) = closed_form::consensus(pairs, &motions).ok_or(INCONSISTENT)?;
    let mut found = start;
    for _ in 0..8 {
        check_share(&used)?;
        found = refine::refine(pairs, &used, &found).ok_or(INCONSISTENT)?;
        let consistent = refine::consistent(pairs, &found);
        if consistent == used {
            break;
        }
        used = consistent;
    }
    check_share(&used)?;
    // The remaining pairs may rotate about one axis only, though all pairs together did not.
    let kept: Vec<PosePair> = pairs
        .iter()
        .zip(&used)
        .filter_map(|(p, used)| used.then_some(*p))
        .collect();
    let second_axis = closed_form::second_axis(&closed_form::motions(&kept, MIN_ROTATION));
    if second_axis < MIN_SECOND_AXIS {
        return Err(HandEyeError::OneAxis {
            degrees: second_axis.to_degrees(),
        });
    }
    refine::describe(pairs, used, &found, second_axis).ok_or(INCONSISTENT)
}

const INCONSISTENT: HandEyeError = HandEyeError::Inconsistent { percent: 0.0 };

fn check_share(used: &[bool]) -> Result<(), HandEyeError> {
    let consistent = used.iter().filter(|u| **u).count();
    let share = consistent as f64 / used.len() as f64;
    if share < MIN_CONSISTENT_SHARE || consistent < MIN_PAIRS {
        return Err(HandEyeError::Inconsistent {
            percent: 100.0 * share,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
