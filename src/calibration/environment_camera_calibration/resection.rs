//! The pose of a camera with any lens from observations of known points, or its orientation alone from
//! observations in known directions.
//!
//! ```text
//!  An observation is a bearing b of a target: a point X of the world, or a direction d. Its deviation
//!  is the angle between b and  R (X − p)  or  R d,  where R maps world to camera axes and p is the
//!  camera's position. Given p, two observations give R (RANSAC), more the R that maximises Σ b · R d
//!  (Wahba 1965). An unknown p is sampled on a lattice about the points, each with its best R, so that
//!  no initial pose is needed and both poses that a planar target allows are found; the best are
//!  refined (Levenberg–Marquardt, Tukey's weights).
//! ```

mod initial_poses;
mod model;
mod refine;

pub use model::{Observation, Target, Unknowns};

use glam::DVec3;
use initial_poses::initial_poses;
use model::{OUTLIER, deviation};
use penumbra_interface::RigidTransform;
use refine::{linearise, refine};

/// The pose is ambiguous unless the cost of the second best is this many times larger.
const MIN_COST_RATIO: f64 = 2.0;

/// A pose computed from observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Resection {
    /// The camera in the world.
    pub world_from_camera: RigidTransform,
    /// Standard deviations of the orientation about the camera's own axes, radians.
    pub rotation_sigma: DVec3,
    /// Standard deviations of the position, world, metres; zero where it was given.
    pub position_sigma: DVec3,
    /// Deviation of each observation, radians.
    pub deviations: Vec<f64>,
    /// Whether each observation was used; outliers were not.
    pub kept: Vec<bool>,
    /// Root mean square deviation of those used, radians.
    pub rms: f64,
    /// Difference to another pose that fits nearly as well, radians.
    pub ambiguous: Option<f64>,
}

/// Why observations do not determine the pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoPose {
    /// Too few.
    #[error("{known} known points or directions; at least {needed} are needed{}", if *.needed > 2 { " (2 with a known position)" } else { "" })]
    TooFew {
        /// Observations given.
        known: usize,
        /// Observations needed.
        needed: usize,
    },
    /// All lie in nearly one direction.
    #[error(
        "all known points lie in one direction (within {degrees:.0}°), which leaves the rotation about it undetermined; add points or lights on another side"
    )]
    OneDirection {
        /// Largest angle between two bearings.
        degrees: f64,
    },
    /// The observations are inconsistent.
    #[error(
        "the known points are inconsistent: at most {consistent} of {known} fit one pose; check their coordinates and order"
    )]
    Inconsistent {
        /// Number of consistent observations.
        consistent: usize,
        /// Number of observations.
        known: usize,
    },
}

/// Computes the pose. `near` is an approximate pose, if known; of two poses that fit equally well, the
/// nearer is returned.
///
/// # Errors
/// There are too few observations, they lie in one direction, or they are inconsistent.
pub fn resect(
    observations: &[Observation],
    unknowns: Unknowns,
    near: Option<RigidTransform>,
) -> Result<Resection, NoPose> {
    let usable: Vec<Observation> = observations.iter().filter_map(validated).collect();
    let needed = if unknowns == Unknowns::Pose { 4 } else { 2 };
    if usable.len() < needed {
        return Err(NoPose::TooFew {
            known: usable.len(),
            needed,
        });
    }
    let degrees = largest_angle(&usable).to_degrees();
    if degrees < 3.0 {
        return Err(NoPose::OneDirection { degrees });
    }
    let mut found = initial_poses(&usable, unknowns, near);
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
        return Err(NoPose::Inconsistent {
            consistent: 0,
            known: usable.len(),
        });
    };
    let rival = found[1..]
        .iter()
        .find(|p| apart(p, &best) > 0.03 && is_in_front(&usable, p));
    let mut ambiguous =
        rival.filter(|p| cost(p) < MIN_COST_RATIO * cost(&best).max(usable.len() as f64 * 0.3));
    if let (Some(other), Some(near)) = (ambiguous, near) {
        let (one, two) = (apart(&best, &near), apart(other, &near));
        // The approximate pose decides if it is much nearer to one of the two.
        if one.max(two) > 2.0 * one.min(two) + 0.05 {
            if two < one {
                best = *other;
            }
            ambiguous = None;
        }
    }
    let ambiguous = ambiguous.map(|p| apart(p, &best));
    conclude(observations, &usable, unknowns, best, ambiguous, degrees)
}

/// Normalises an observation; `None` if it has no valid bearing or target.
fn validated(observation: &Observation) -> Option<Observation> {
    let target = match observation.target {
        Target::Direction(d) => Target::Direction(d.try_normalize()?),
        Target::Point(p) => Target::Point(p.is_finite().then_some(p)?),
    };
    Some(Observation {
        bearing: observation.bearing.try_normalize()?,
        target,
        sigma: observation.sigma.max(1e-5),
    })
}

/// Returns the largest angle between two bearings, radians.
fn largest_angle(seen: &[Observation]) -> f64 {
    let pairs = seen.iter().flat_map(|a| seen.iter().map(move |b| (a, b)));
    pairs.fold(0.0, |most, (a, b)| {
        a.bearing.angle_between(b.bearing).max(most)
    })
}

/// Returns the difference of two poses, radians; 0.3 rad per metre of translation.
fn apart(a: &RigidTransform, b: &RigidTransform) -> f64 {
    a.rotation
        .angle_between(b.rotation)
        .hypot(0.3 * a.translation.distance(b.translation))
}

/// Returns the sum of squared deviations in standard deviations, each limited to an outlier's.
fn cost(seen: &[Observation], pose: &RigidTransform) -> f64 {
    let one = |s: &Observation| (deviation(s, pose) / s.sigma).min(OUTLIER).powi(2);
    seen.iter().map(one).sum()
}

/// Returns whether most targets are in front of the camera.
fn is_in_front(seen: &[Observation], pose: &RigidTransform) -> bool {
    2 * seen.iter().filter(|s| deviation(s, pose) < 1.0).count() > seen.len()
}

/// Returns the result at a pose, with its uncertainty.
fn conclude(
    all: &[Observation],
    usable: &[Observation],
    unknowns: Unknowns,
    pose: RigidTransform,
    ambiguous: Option<f64>,
    degrees: f64,
) -> Result<Resection, NoPose> {
    let consistent = usable
        .iter()
        .filter(|s| deviation(s, &pose) < OUTLIER * s.sigma)
        .count();
    let needed = if unknowns == Unknowns::Pose { 4 } else { 2 };
    if consistent < needed || 3 * consistent < 2 * usable.len() {
        return Err(NoPose::Inconsistent {
            consistent,
            known: usable.len(),
        });
    }
    let normal = linearise(usable, &pose, unknowns, 2.0 * OUTLIER);
    let free = (2 * consistent).saturating_sub(normal.gradient.len());
    let kept_cost: f64 = usable
        .iter()
        .map(|s| (deviation(s, &pose) / s.sigma).powi(2))
        .filter(|x| *x < OUTLIER * OUTLIER)
        .sum();
    // The residuals may increase the stated uncertainties, never decrease them.
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
    let position_sigma = match unknowns {
        Unknowns::Pose => DVec3::new(sigma(3), sigma(4), sigma(5)),
        _ => DVec3::ZERO,
    };
    let deviations: Vec<f64> = all.iter().map(|s| deviation(s, &pose)).collect();
    let kept: Vec<bool> = all
        .iter()
        .zip(&deviations)
        .map(|(s, d)| *d < OUTLIER * s.sigma.max(1e-5))
        .collect();
    let squares: f64 = deviations
        .iter()
        .zip(&kept)
        .filter(|o| *o.1)
        .map(|o| o.0 * o.0)
        .sum();
    Ok(Resection {
        world_from_camera: pose,
        rotation_sigma: DVec3::new(sigma(0), sigma(1), sigma(2)),
        position_sigma,
        rms: (squares / consistent as f64).sqrt(),
        deviations,
        kept,
        ambiguous,
    })
}

#[cfg(test)]
mod tests;
