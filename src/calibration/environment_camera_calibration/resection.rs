//! The pose of a camera of any lens from what it sees at known places, or its orientation alone
//! from what it sees in known directions.
//!
//! ```text
//!  A sight is a bearing b and a target: a point X of the world, or a direction d. It is off by the
//!  angle between b and  R (X − p)  or  R d,  where R turns the world into the
//!  camera and p is the camera's place. Given p, two sights give R (RANSAC), many the R that
//!  makes Σ b · R d largest (Wahba 1965; the eigenvector of Davenport's 4×4 matrix). Where p is
//!  not known it is tried on a lattice about the points, each with its best R, so that no start is
//!  needed and both poses that a flat target allows are seen; the best are refined (Levenberg–
//!  Marquardt, Tukey's weights).
//! ```

use super::sharpen::{linearise, refine};
use crate::environment_camera_calibration::initial_poses::starts;
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;

/// Sights that are farther off than this contradict the others, in their own standard deviations.
pub(super) const OUTLIER: f64 = 5.0;
/// The second best pose must be this many times worse.
const CLEAR: f64 = 2.0;

/// Something whose place or direction in the world is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// World, metres.
    Point(DVec3),
    /// Unit vector, world: so far away that the camera's place does not matter.
    Direction(DVec3),
}

/// Seen by the environment camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Unit vector in the camera's frame.
    pub bearing: DVec3,
    /// What is there.
    pub target: Target,
    /// How sure bearing and target are together, radians.
    pub sigma: f64,
}

/// What is to be found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unknowns {
    /// Orientation; the camera is here (world, metres).
    Turn(DVec3),
    /// Orientation and place.
    Pose,
    /// Orientation; this point of the camera's frame is at that place of the world.
    About {
        /// Camera's frame, metres.
        in_camera: DVec3,
        /// World, metres.
        in_world: DVec3,
    },
}

/// A pose that sights speak for.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The camera in the world.
    pub world_from_camera: RigidTransform,
    /// Standard deviations of the orientation about the camera's own axes, radians.
    pub turn_sigma: DVec3,
    /// Of the place, world, metres; zero where it was given.
    pub place_sigma: DVec3,
    /// How far each sight is off, radians.
    pub offs: Vec<f64>,
    /// Which sights were believed.
    pub kept: Vec<bool>,
    /// Root mean square of those, radians.
    pub rms: f64,
    /// Another pose suits the sights nearly as well; turned by so much, radians.
    pub ambiguous: Option<f64>,
}

/// Sights leave the pose open.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoPose {
    /// Too few.
    #[error("{known} known points or directions are too few: {needed} are needed{}", if *.needed > 2 { " for a pose, 2 where its place is known" } else { "" })]
    TooFew {
        /// Used.
        known: usize,
        /// Needed.
        needed: usize,
    },
    /// They lie in one direction.
    #[error(
        "all known points lie in one direction (within {degrees:.0}°): the turn about it stays open; add points or lights on another side"
    )]
    OneDirection {
        /// Largest angle between two.
        degrees: f64,
    },
    /// They contradict one another.
    #[error(
        "the known points contradict one another: at most {agree} of {known} agree on a pose; check their coordinates and order"
    )]
    Contradiction {
        /// How many agree.
        agree: usize,
        /// Of how many.
        known: usize,
    },
}

/// Finds the pose. `near` is the pose where it is roughly known; of two that suit equally
/// the nearer is taken.
///
/// # Errors
/// [`NoPose`].
pub fn place(
    sights: &[Sight],
    unknowns: Unknowns,
    near: Option<RigidTransform>,
) -> Result<Placed, NoPose> {
    let usable: Vec<Sight> = sights.iter().filter_map(sane).collect();
    let needed = if unknowns == Unknowns::Pose { 4 } else { 2 };
    if usable.len() < needed {
        return Err(NoPose::TooFew {
            known: usable.len(),
            needed,
        });
    }
    let degrees = widest(&usable).to_degrees();
    if degrees < 3.0 {
        return Err(NoPose::OneDirection { degrees });
    }
    let mut found = starts(&usable, unknowns, near);
    found.retain_mut(|pose| match refine(&usable, unknowns, *pose) {
        Some(better) => {
            *pose = better;
            true
        }
        None => false,
    });
    let cost = |pose: &RigidTransform| cost(&usable, pose);
    found.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let Some(mut best) = found.first().copied() else {
        return Err(NoPose::Contradiction {
            agree: 0,
            known: usable.len(),
        });
    };
    let rival = found[1..]
        .iter()
        .find(|p| apart(p, &best) > 0.03 && front(&usable, p));
    let mut ambiguous =
        rival.filter(|p| cost(p) < CLEAR * cost(&best).max(usable.len() as f64 * 0.3));
    if let (Some(other), Some(near)) = (ambiguous, near) {
        let (one, two) = (apart(&best, &near), apart(other, &near));
        // A rough pose decides where it is much nearer to one of the two.
        if one.max(two) > 2.0 * one.min(two) + 0.05 {
            if two < one {
                best = *other;
            }
            ambiguous = None;
        }
    }
    let ambiguous = ambiguous.map(|p| apart(p, &best));
    conclude(sights, &usable, unknowns, best, ambiguous, degrees)
}

/// With unit vectors and a sigma above nothing; `None` of what is no direction.
fn sane(sight: &Sight) -> Option<Sight> {
    let target = match sight.target {
        Target::Direction(d) => Target::Direction(d.try_normalize()?),
        Target::Point(p) => Target::Point(p.is_finite().then_some(p)?),
    };
    Some(Sight {
        bearing: sight.bearing.try_normalize()?,
        target,
        sigma: sight.sigma.max(1e-5),
    })
}

fn widest(seen: &[Sight]) -> f64 {
    let pairs = seen.iter().flat_map(|a| seen.iter().map(move |b| (a, b)));
    pairs.fold(0.0, |most, (a, b)| {
        a.bearing.angle_between(b.bearing).max(most)
    })
}

fn apart(a: &RigidTransform, b: &RigidTransform) -> f64 {
    a.rotation
        .angle_between(b.rotation)
        .hypot(0.3 * a.translation.distance(b.translation))
}

/// Direction of a target from a place, world.
pub(super) fn direction(target: Target, place: DVec3) -> DVec3 {
    match target {
        Target::Direction(d) => d,
        Target::Point(p) => (p - place).normalize_or(DVec3::Z),
    }
}

pub(super) fn off(seen: &Sight, pose: &RigidTransform) -> f64 {
    let world = direction(seen.target, pose.translation);
    (pose.rotation * seen.bearing).angle_between(world)
}

/// Squares of the sights' distances in their standard deviations, none more than an outlier's.
fn cost(seen: &[Sight], pose: &RigidTransform) -> f64 {
    let one = |s: &Sight| (off(s, pose) / s.sigma).min(OUTLIER).powi(2);
    seen.iter().map(one).sum()
}

/// Most targets are before the camera.
fn front(seen: &[Sight], pose: &RigidTransform) -> bool {
    2 * seen.iter().filter(|s| off(s, pose) < 1.0).count() > seen.len()
}

/// Where the camera is, if its orientation tells.
pub(super) fn place_of(unknowns: Unknowns, world_from_camera: DQuat) -> Option<DVec3> {
    match unknowns {
        Unknowns::Turn(place) => Some(place),
        Unknowns::Pose => None,
        Unknowns::About {
            in_camera,
            in_world,
        } => Some(in_world - world_from_camera * in_camera),
    }
}

fn conclude(
    all: &[Sight],
    usable: &[Sight],
    unknowns: Unknowns,
    pose: RigidTransform,
    ambiguous: Option<f64>,
    degrees: f64,
) -> Result<Placed, NoPose> {
    let agree = usable
        .iter()
        .filter(|s| off(s, &pose) < OUTLIER * s.sigma)
        .count();
    let needed = if unknowns == Unknowns::Pose { 4 } else { 2 };
    if agree < needed || 3 * agree < 2 * usable.len() {
        return Err(NoPose::Contradiction {
            agree,
            known: usable.len(),
        });
    }
    let normal = linearise(usable, &pose, unknowns, 2.0 * OUTLIER);
    let free = (2 * agree).saturating_sub(normal.gradient.len());
    let kept_cost: f64 = usable
        .iter()
        .map(|s| (off(s, &pose) / s.sigma).powi(2))
        .filter(|x| *x < OUTLIER * OUTLIER)
        .sum();
    // What the residuals say may be worse than what was promised, never better.
    let factor = if free == 0 {
        1.0
    } else {
        (kept_cost / free as f64).max(1.0)
    };
    let Some(chol) = normal.hessian.cholesky() else {
        return Err(NoPose::OneDirection { degrees });
    };
    let inverse = chol.inverse();
    let sigma = |i: usize| (factor * inverse[(i, i)]).sqrt();
    let place_sigma = match unknowns {
        Unknowns::Pose => DVec3::new(sigma(3), sigma(4), sigma(5)),
        _ => DVec3::ZERO,
    };
    let offs: Vec<f64> = all.iter().map(|s| off(s, &pose)).collect();
    let kept: Vec<bool> = all
        .iter()
        .zip(&offs)
        .map(|(s, off)| *off < OUTLIER * s.sigma.max(1e-5))
        .collect();
    let squares: f64 = offs
        .iter()
        .zip(&kept)
        .filter(|o| *o.1)
        .map(|o| o.0 * o.0)
        .sum();
    Ok(Placed {
        world_from_camera: pose,
        turn_sigma: DVec3::new(sigma(0), sigma(1), sigma(2)),
        place_sigma,
        rms: (squares / agree as f64).sqrt(),
        offs,
        kept,
        ambiguous,
    })
}

#[cfg(test)]
mod tests;
