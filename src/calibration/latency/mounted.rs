//! The offset by how pictures move that have no poses, where the camera's lens and its place on the
//! tracker's sensor are known.
//!
//! ```text
//!  At an offset τ the tracker tells the camera's motion between two pictures, R and t. A patch on the
//!  ray x (z = 1) of the first, with inverse depth ρ, is then seen in the second at
//!      π(R x + ρ t) ≈ π(R x) + ρ b,    b = (π(R x + ρ₀ t) − π(R x)) / ρ₀,
//!  with ρ₀ common to all. How near each patch is, nobody knows: ρ = ρ₀ ± σ_ρ leaves what is off along
//!  b open by σ_ρ |b|; what is off across it (the epipolar constraint, Longuet-Higgins 1981) and, where
//!  b is short, all of it tells τ.
//! ```
//!
//! So near and far scenes and a camera that circles its subject are no trouble, as they are for
//! [`super::from_motion`], which must fit the scene and the mounting along.

use super::scan::{Fit, scan};
use super::{
    CameraMotion, ClockOffset, LatencyError, TrackerTrack, covered, independent, settle, within,
};
use crate::latency::MOST_PATCHES;
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::median_absolute;
use penumbra_rig_model::RigCalibration;

/// Residuals of a pair of pictures: each patch's along b and across it.
const NUMBERS: usize = 2 * MOST_PATCHES;
/// Standard deviation of the patches' nearness, as a share of the common one,
const NEARNESS_SPREAD: f64 = 0.7;
/// which is no less than this, 1/m.
const LEAST_NEARNESS: f64 = 0.2;
/// What a patch is off by before that is measured, as a share of the picture's width.
const FIRST_NOISE: f64 = 1.0 / 160.0;
/// No patch is followed better, as a share of the picture's width.
const LEAST_NOISE: f64 = 1.0 / 16_000.0;
/// The first look takes no more pairs of pictures.
const FIRST_LOOK: usize = 100;
/// A residual of so many σ counts half.
const OUTLYING: f64 = 2.0;
/// Fitted: the offset, and how near the scene is.
const FITTED: f64 = 2.0;

/// A camera on a tracker's sensor.
#[derive(Clone, Debug)]
pub struct Mounted {
    camera: PinholeCamera,
    sensor_from_camera: RigidTransform,
}

impl Mounted {
    /// A camera that sits there.
    #[must_use]
    pub const fn new(camera: PinholeCamera, sensor_from_camera: RigidTransform) -> Self {
        Self {
            camera,
            sensor_from_camera,
        }
    }

    /// The scene camera, if the rig has a tracker.
    #[must_use]
    pub fn scene_camera(rig: &RigCalibration) -> Option<Self> {
        let mounting = rig.tracker.as_ref()?.sensor_from_scene_camera;
        Some(Self::new(rig.scene_camera.camera.clone(), mounting))
    }

    /// Ray of a place in the picture (a share of width and height), at z = 1.
    fn ray(&self, place: DVec2) -> Option<DVec3> {
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let ray = self.camera.unproject(place * size - 0.5);
        (ray.z > 0.05).then(|| ray / ray.z)
    }
}

/// From patches: the camera's motion as the tracker tells it at each offset.
///
/// # Errors
/// As [`super::from_rotations`].
pub fn from_patches(
    track: &TrackerTrack,
    motions: &[CameraMotion],
    mounted: &Mounted,
    range: f64,
) -> Result<ClockOffset, LatencyError> {
    let spans: Vec<(f64, f64)> = motions.iter().map(|m| (m.from, m.to)).collect();
    let kept = within(track, &spans, range)?;
    let width = f64::from(mounted.camera.width) / mounted.camera.focal.x;
    let thinned: Vec<usize> = kept
        .iter()
        .copied()
        .step_by(kept.len().div_ceil(FIRST_LOOK))
        .collect();
    let some = Seen::new(track, motions, &thinned, mounted);
    let first = FIRST_NOISE * width;
    let rough = scan(|offset| some.fit(offset, first), range, NUMBERS);
    let rough = rough.ok_or(LatencyError::NotAlike { percent: 0.0 })?;
    let noise = some.noise(rough.offset, first);
    let noise = noise.map_or(first, |n| n.max(LEAST_NOISE * width));
    let kept = covered(track, &spans, kept, rough.offset)?;
    let all = Seen::new(track, motions, &kept, mounted);
    let found = scan(|offset| all.fit(offset, noise), range, NUMBERS);
    settle(
        found,
        range,
        independent(&spans, &kept),
        (FITTED, kept.len()),
    )
}

/// A pair of pictures.
struct Pair {
    from: f64,
    to: f64,
    /// Rays at z = 1 of each patch in both.
    patches: [Option<(DVec3, DVec2)>; MOST_PATCHES],
}

struct Seen<'a> {
    track: &'a TrackerTrack,
    mounted: &'a Mounted,
    pairs: Vec<Pair>,
}

/// How a patch compares with what the tracker tells.
#[derive(Clone, Copy, Default)]
struct Compared {
    /// What is left after the turn.
    off: DVec2,
    /// By nearness.
    by_nearness: DVec2,
    /// How it moved.
    moved: DVec2,
}

impl<'a> Seen<'a> {
    fn new(
        track: &'a TrackerTrack,
        motions: &[CameraMotion],
        kept: &[usize],
        mounted: &'a Mounted,
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

    /// All patches at an offset; those that were not followed are zero.
    fn compared(&self, offset: f64) -> Option<Vec<Compared>> {
        let mut out = Vec::with_capacity(self.pairs.len() * MOST_PATCHES);
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

    /// Residuals in units of the noise, large ones bent down.
    fn fit(&self, offset: f64, noise: f64) -> Option<Fit> {
        let compared = self.compared(offset)?;
        let nearness = nearness(&compared, noise);
        let residuals = compared.iter().flat_map(|c| {
            let [along, across] = residual(c, nearness, noise);
            [bent(along), bent(across)]
        });
        let residuals: Vec<f64> = residuals.collect();
        let still = compared.iter().map(|c| c.moved / noise);
        let power = still.map(|m| bent(m.x).powi(2) + bent(m.y).powi(2)).sum();
        Some(Fit::new(residuals, power))
    }

    /// The usual rest across, as a tangent.
    fn noise(&self, offset: f64, first: f64) -> Option<f64> {
        let compared = self.compared(offset)?;
        let nearness = nearness(&compared, first);
        let seen = compared.iter().filter(|c| c.moved != DVec2::ZERO);
        let across = seen.map(|c| residual(c, nearness, first)[1] * first);
        Some(1.4826 * median_absolute(across))
    }
}

fn compare(motion: RigidTransform, ray: DVec3, to: DVec2) -> Option<Compared> {
    let at = |p: DVec3| (p.z > 0.05).then(|| p.truncate() / p.z);
    let turned = motion.rotation * ray;
    let far = at(turned)?;
    let near = at(turned + motion.translation * LEAST_NEARNESS)?;
    Some(Compared {
        off: to - far,
        by_nearness: (near - far) / LEAST_NEARNESS,
        moved: to - ray.truncate(),
    })
}

/// How near the scene is as a whole, 1/m: ρ₀ by least squares with Cauchy's weights.
fn nearness(compared: &[Compared], noise: f64) -> f64 {
    let mut found = LEAST_NEARNESS;
    for _ in 0..3 {
        let (mut along, mut square) = (0.0, 0.0);
        for c in compared {
            let open = noise.hypot(NEARNESS_SPREAD * found * c.by_nearness.length());
            let rest = (c.off - c.by_nearness * found).length() / (OUTLYING * open);
            let weight = 1.0 / ((1.0 + rest * rest) * open * open);
            along += weight * c.off.dot(c.by_nearness);
            square += weight * c.by_nearness.length_squared();
        }
        found = (along / square.max(1e-300)).max(LEAST_NEARNESS);
    }
    found
}

/// Along and across b, in σ.
fn residual(c: &Compared, nearness: f64, noise: f64) -> [f64; 2] {
    let length = c.by_nearness.length();
    let way = c.by_nearness.try_normalize().unwrap_or(DVec2::X);
    let left = c.off - c.by_nearness * nearness;
    let open = noise.hypot(NEARNESS_SPREAD * nearness * length);
    [left.dot(way) / open, left.perp_dot(way) / noise]
}

/// Its square is Cauchy's loss.
fn bent(residual: f64) -> f64 {
    let share = residual / OUTLYING;
    OUTLYING * (1.0 + share * share).ln().sqrt().copysign(residual)
}
