//! Hand–eye calibration: where the camera sits on the tracked sensor, and where the tracker's
//! transmitter stands in the world.
//!
//! Every pair of simultaneous poses says
//!
//! > `world_from_camera` = `world_from_transmitter` · `transmitter_from_sensor` · `sensor_from_camera`
//!
//! with the first and last factor on the right unknown. `relative` solves the motion form
//! A X = X B in closed form, `consensus` does so on the pairs that agree, `refine` brings
//! all pairs to the least error, with uncertainty.

mod closed;
mod refine;

pub(crate) use closed::best_rotation;

use glam::DVec3;
use penumbra_interface::RigidTransform;
use penumbra_numerics::median;
use thiserror::Error;

/// The same instant seen by both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePair {
    /// The tracker's.
    pub transmitter_from_sensor: RigidTransform,
    /// From markers or a board in the picture.
    pub world_from_camera: RigidTransform,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct HandEye {
    /// The camera's pose in the sensor's frame.
    pub sensor_from_camera: RigidTransform,
    /// The transmitter's pose in the world.
    pub world_from_transmitter: RigidTransform,
    /// 1σ of `sensor_from_camera`: rotation about the camera's axes, radians, and
    /// translation in the sensor's frame, metres.
    pub sensor_sigma: (DVec3, DVec3),
    /// 1σ of `world_from_transmitter`, likewise, about the world's axes.
    pub transmitter_sigma: (DVec3, DVec3),
    /// Root mean square of what is left of rotations, radians.
    pub rotation_rms: f64,
    /// And of positions, metres.
    pub position_rms: f64,
    /// Pairs that agree, in the order given.
    pub used: Vec<bool>,
    /// How far the motion was from turning about one axis: the second axis's share, radians.
    pub spread: f64,
}

/// The motion does not tell, or is no motion of one rig. Each text says what to do.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum HandEyeError {
    /// Too few pairs.
    #[error(
        "{pairs} pairs of poses; at least {least} are needed: move the rig for half a minute before the markers"
    )]
    TooFew {
        /// Given.
        pairs: usize,
        /// Needed.
        least: usize,
    },
    /// The rig was hardly turned.
    #[error(
        "the rig was turned by {degrees:.1} degrees at most; turn it by 30 degrees and more, about different axes"
    )]
    NoRotation {
        /// Largest angle between two poses.
        degrees: f64,
    },
    /// All turns were about one axis.
    #[error(
        "all turns were about nearly one axis ({degrees:.1} degrees about others): the position along it cannot be told; tilt and roll the rig as well"
    )]
    OneAxis {
        /// About the second axis.
        degrees: f64,
    },
    /// No camera on the sensor explains the pairs.
    #[error(
        "only {percent:.0} % of the poses agree with one mounting; check the time offset between tracker and camera, and that nothing moved on the rig"
    )]
    NoAgreement {
        /// Of the pairs.
        percent: f64,
    },
}

/// Fewest pairs.
const LEAST: usize = 6;
/// The least turn between two poses that are looked at together, radians.
const LEAST_TURN: f64 = 0.12;
/// The least second axis of all turns, radians.
const LEAST_SPREAD: f64 = 0.05;
/// Of the pairs, at least so many must agree.
const LEAST_SHARE: f64 = 0.5;

/// Solves for the mounting, robustly: wrong poses among the pairs are found and left out.
///
/// # Errors
/// Too little or degenerate motion; no mounting that half of the pairs agree on.
pub fn hand_eye(pairs: &[PosePair]) -> Result<HandEye, HandEyeError> {
    if pairs.len() < LEAST {
        return Err(HandEyeError::TooFew {
            pairs: pairs.len(),
            least: LEAST,
        });
    }
    let motions = closed::motions(pairs, LEAST_TURN);
    if motions.len() < 3 {
        return Err(HandEyeError::NoRotation {
            degrees: closed::largest_turn(pairs).to_degrees(),
        });
    }
    let spread = closed::spread_of_axes(&motions);
    if spread < LEAST_SPREAD {
        return Err(HandEyeError::OneAxis {
            degrees: spread.to_degrees(),
        });
    }
    let (start, mut used) = closed::consensus(pairs, &motions).ok_or(NO_AGREEMENT)?;
    let mut found = start;
    for _ in 0..8 {
        check_share(&used)?;
        found = refine::refine(pairs, &used, &found).ok_or(NO_AGREEMENT)?;
        let judged = refine::agreeing(pairs, &found);
        if judged == used {
            break;
        }
        used = judged;
    }
    check_share(&used)?;
    // What is left may turn about one axis though all of it did not.
    let kept: Vec<PosePair> = pairs
        .iter()
        .zip(&used)
        .filter_map(|(p, used)| used.then_some(*p))
        .collect();
    let spread = closed::spread_of_axes(&closed::motions(&kept, LEAST_TURN));
    if spread < LEAST_SPREAD {
        return Err(HandEyeError::OneAxis {
            degrees: spread.to_degrees(),
        });
    }
    refine::describe(pairs, used, &found, spread).ok_or(NO_AGREEMENT)
}

const NO_AGREEMENT: HandEyeError = HandEyeError::NoAgreement { percent: 0.0 };

fn check_share(used: &[bool]) -> Result<(), HandEyeError> {
    let agree = used.iter().filter(|u| **u).count();
    let share = agree as f64 / used.len() as f64;
    if share < LEAST_SHARE || agree < LEAST {
        return Err(HandEyeError::NoAgreement {
            percent: 100.0 * share,
        });
    }
    Ok(())
}

/// Both unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mounting {
    sensor_from_camera: RigidTransform,
    world_from_transmitter: RigidTransform,
}

impl Mounting {
    /// What is left of a pair: the rotation (vector, radians, camera's axes) and the position
    /// (metres, world) by which the picture's pose departs from the tracker's.
    fn residual(&self, pair: &PosePair) -> (DVec3, DVec3) {
        let by_tracker =
            self.world_from_transmitter * pair.transmitter_from_sensor * self.sensor_from_camera;
        let turn = by_tracker.rotation.inverse() * pair.world_from_camera.rotation;
        (
            closed::rotation_vector(turn),
            pair.world_from_camera.translation - by_tracker.translation,
        )
    }
}

/// The middle of the lengths.
fn middle(vectors: impl Iterator<Item = DVec3>) -> f64 {
    median(vectors.map(DVec3::length)).unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests;
