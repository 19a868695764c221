//! The offset from the motion of image patches, where the camera's lens and its pose on the
//! tracker's sensor are known.
//!
//! ```text
//!  At an offset τ the tracker gives the camera's motion between two pictures, R and t. A patch on the
//!  ray x (z = 1) of the first, with inverse depth ρ, is then seen in the second at
//!      π(R x + ρ t) ≈ π(R x) + ρ b,    b = (π(R x + ρ₀ t) − π(R x)) / ρ₀,
//!  with ρ₀ common to all. The inverse depth of each patch is unknown: ρ = ρ₀ ± σ_ρ gives the residual
//!  along b a standard deviation of σ_ρ |b|. The residual across b (the epipolar constraint,
//!  Longuet-Higgins 1981) and, where b is short, the residual in both directions determine τ.
//! ```
//!
//! Scenes of varying depth and a camera that orbits its subject therefore do not degrade the result,
//! as they do for [`super::from_flow`], which fits the scene and the mounting along with the offset.

use super::image_motion::MAX_PATCHES;
use super::model::{CameraMotion, ClockOffset, LatencyError};
use super::scan::{Fit, scan};
use super::selection::{accept_minimum, covered_spans, independent_count, spans_within};
use super::track::TrackerTrack;
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::median_absolute;
use penumbra_rig_model::RigCalibration;

/// Residuals of a pair of pictures: along and across b for each patch.
const RESIDUALS: usize = 2 * MAX_PATCHES;
/// Standard deviation of the patches' inverse depth, relative to the common one.
const INVERSE_DEPTH_SIGMA: f64 = 0.7;
/// Minimum common inverse depth, 1/m.
const MIN_INVERSE_DEPTH: f64 = 0.2;
/// Assumed noise of a patch before it is measured, relative to the picture's width.
const INITIAL_NOISE: f64 = 1.0 / 160.0;
/// Minimum noise of a patch, relative to the picture's width.
const MIN_NOISE: f64 = 1.0 / 16_000.0;
/// Maximum number of pairs of pictures in the rough search.
const MAX_ROUGH_PAIRS: usize = 100;
/// Scale of Cauchy's loss, σ: a residual of this size has half the weight.
const CAUCHY_SCALE: f64 = 2.0;
/// Number of fitted parameters: the offset and the common inverse depth.
const FITTED: f64 = 2.0;

/// A camera with a known pose on a tracker's sensor.
#[derive(Clone, Debug)]
pub struct MountedCamera {
    camera: PinholeCamera,
    sensor_from_camera: RigidTransform,
}

impl MountedCamera {
    /// Creates a camera with this pose on the sensor.
    #[must_use]
    pub const fn new(camera: PinholeCamera, sensor_from_camera: RigidTransform) -> Self {
        Self {
            camera,
            sensor_from_camera,
        }
    }

    /// Returns the scene camera; `None` if the rig has no tracker.
    #[must_use]
    pub fn scene_camera(rig: &RigCalibration) -> Option<Self> {
        let mounting = rig.tracker.as_ref()?.sensor_from_scene_camera;
        Some(Self::new(rig.scene_camera.camera.clone(), mounting))
    }

    /// Returns the ray of a position in the picture (relative to width and height), at z = 1.
    fn ray(&self, position: DVec2) -> Option<DVec3> {
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let ray = self.camera.unproject(position * size - 0.5);
        (ray.z > 0.05).then(|| ray / ray.z)
    }
}

/// Finds the offset at which the patches move as the tracker predicts.
///
/// # Errors
/// As [`super::from_rotations`].
pub fn from_patches(
    track: &TrackerTrack,
    motions: &[CameraMotion],
    mounted: &MountedCamera,
    range: f64,
) -> Result<ClockOffset, LatencyError> {
    let spans: Vec<(f64, f64)> = motions.iter().map(|m| (m.from, m.to)).collect();
    let kept = spans_within(track, &spans, range)?;
    let width = f64::from(mounted.camera.width) / mounted.camera.focal.x;
    let thinned: Vec<usize> = kept
        .iter()
        .copied()
        .step_by(kept.len().div_ceil(MAX_ROUGH_PAIRS))
        .collect();
    let sparse = PatchPairs::new(track, motions, &thinned, mounted);
    let initial_noise = INITIAL_NOISE * width;
    let rough = scan(|offset| sparse.fit(offset, initial_noise), range, RESIDUALS);
    let rough = rough.ok_or(LatencyError::Uncorrelated { percent: 0.0 })?;
    let noise = sparse.noise(rough.offset, initial_noise);
    let noise = noise.map_or(initial_noise, |n| n.max(MIN_NOISE * width));
    let kept = covered_spans(track, &spans, kept, rough.offset)?;
    let all = PatchPairs::new(track, motions, &kept, mounted);
    let found = scan(|offset| all.fit(offset, noise), range, RESIDUALS);
    accept_minimum(
        found,
        range,
        independent_count(&spans, &kept),
        (FITTED, kept.len()),
    )
}

/// A pair of pictures.
struct Pair {
    from: f64,
    to: f64,
    /// Rays at z = 1 of each patch in both pictures.
    patches: [Option<(DVec3, DVec2)>; MAX_PATCHES],
}

struct PatchPairs<'a> {
    track: &'a TrackerTrack,
    mounted: &'a MountedCamera,
    pairs: Vec<Pair>,
}

/// Motion of a patch against the tracker's prediction, at z = 1.
#[derive(Clone, Copy, Default)]
struct Compared {
    /// Displacement that the rotation does not explain.
    residual: DVec2,
    /// Derivative of the displacement by the inverse depth (b).
    by_inverse_depth: DVec2,
    /// Displacement of the patch.
    moved: DVec2,
}

impl<'a> PatchPairs<'a> {
    fn new(
        track: &'a TrackerTrack,
        motions: &[CameraMotion],
        kept: &[usize],
        mounted: &'a MountedCamera,
    ) -> Self {
        let pair = |&i: &usize| {
            let CameraMotion { from, to, flow } = motions[i];
            let patches = flow.patches.map(|patch| {
                let patch = patch?;
                Some((mounted.ray(patch.from)?, mounted.ray(patch.to)?.truncate()))
            });
            Pair { from, to, patches }
        };
        Self {
            track,
            mounted,
            pairs: kept.iter().map(pair).collect(),
        }
    }

    /// Compares all patches at an offset; patches that could not be tracked are zero.
    fn compared(&self, offset: f64) -> Option<Vec<Compared>> {
        let mut out = Vec::with_capacity(self.pairs.len() * MAX_PATCHES);
        for pair in &self.pairs {
            let camera = |time: f64| {
                let pose = self.track.pose_at(time + offset)?;
                Some(pose * self.mounted.sensor_from_camera)
            };
            let motion = camera(pair.to)?.inverse() * camera(pair.from)?;
            out.extend(pair.patches.iter().map(|patch| {
                patch
                    .and_then(|(ray, to)| compare(motion, ray, to))
                    .unwrap_or_default()
            }));
        }
        Some(out)
    }

    /// Returns the residuals in units of the noise, with Cauchy's loss.
    fn fit(&self, offset: f64, noise: f64) -> Option<Fit> {
        let compared = self.compared(offset)?;
        let inverse_depth = inverse_depth(&compared, noise);
        let residuals = compared.iter().flat_map(|c| {
            let [along, across] = along_and_across(c, inverse_depth, noise);
            [cauchy_root(along), cauchy_root(across)]
        });
        let residuals: Vec<f64> = residuals.collect();
        let displacements = compared.iter().map(|c| c.moved / noise);
        let power = displacements
            .map(|m| cauchy_root(m.x).powi(2) + cauchy_root(m.y).powi(2))
            .sum();
        Some(Fit::new(residuals, power))
    }

    /// Returns the robust standard deviation (1.4826 MAD) of the residuals across b, as a tangent.
    fn noise(&self, offset: f64, initial_noise: f64) -> Option<f64> {
        let compared = self.compared(offset)?;
        let inverse_depth = inverse_depth(&compared, initial_noise);
        let tracked = compared.iter().filter(|c| c.moved != DVec2::ZERO);
        let across =
            tracked.map(|c| along_and_across(c, inverse_depth, initial_noise)[1] * initial_noise);
        Some(1.4826 * median_absolute(across))
    }
}

fn compare(motion: RigidTransform, ray: DVec3, to: DVec2) -> Option<Compared> {
    let at = |p: DVec3| (p.z > 0.05).then(|| p.truncate() / p.z);
    let rotated = motion.rotation * ray;
    let far = at(rotated)?;
    let near = at(rotated + motion.translation * MIN_INVERSE_DEPTH)?;
    Some(Compared {
        residual: to - far,
        by_inverse_depth: (near - far) / MIN_INVERSE_DEPTH,
        moved: to - ray.truncate(),
    })
}

/// Returns the common inverse depth ρ₀, 1/m, by least squares with Cauchy's weights.
fn inverse_depth(compared: &[Compared], noise: f64) -> f64 {
    let mut found = MIN_INVERSE_DEPTH;
    for _ in 0..3 {
        let (mut along, mut square) = (0.0, 0.0);
        for c in compared {
            let sigma = noise.hypot(INVERSE_DEPTH_SIGMA * found * c.by_inverse_depth.length());
            let error = (c.residual - c.by_inverse_depth * found).length() / (CAUCHY_SCALE * sigma);
            let weight = 1.0 / ((1.0 + error * error) * sigma * sigma);
            along += weight * c.residual.dot(c.by_inverse_depth);
            square += weight * c.by_inverse_depth.length_squared();
        }
        found = (along / square.max(1e-300)).max(MIN_INVERSE_DEPTH);
    }
    found
}

/// Returns the residuals along and across b, in σ.
fn along_and_across(c: &Compared, inverse_depth: f64, noise: f64) -> [f64; 2] {
    let length = c.by_inverse_depth.length();
    let direction = c.by_inverse_depth.try_normalize().unwrap_or(DVec2::X);
    let error = c.residual - c.by_inverse_depth * inverse_depth;
    let sigma = noise.hypot(INVERSE_DEPTH_SIGMA * inverse_depth * length);
    [
        error.dot(direction) / sigma,
        error.perp_dot(direction) / noise,
    ]
}

/// Returns a residual whose square is Cauchy's loss of the given one.
fn cauchy_root(residual: f64) -> f64 {
    let share = residual / CAUCHY_SCALE;
    CAUCHY_SCALE * (1.0 + share * share).ln().sqrt().copysign(residual)
}
