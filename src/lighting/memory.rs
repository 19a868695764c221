//! Temporal accumulation of what a sphere in the scene camera's picture has shown of each
//! direction.
//!
//! ```text
//!  A picture shows a texel as x with the confidence c, 0..=1: the visible part of the texel, its
//!  resolution (θ²/(θ² + δ²) for texels of θ and pixels of δ radians, long strips near the rim),
//!  and the unclipped part. The accumulated value is the mean L of the observations, with the
//!  weight W of the pictures in it and their mean confidence q:
//!      W' = W · exp(−Δt/τ) · k,   L ← (W' L + c x)/(W' + c),   W ← W' + c
//!  so noise averages out over τ seconds. k is 1 unless x differs from L by more than noise
//!  explains, z standard deviations of a picture: then the light has changed, or an edge has
//!  moved by a fraction of a texel, and averaging would delay the change or smear the edge:
//!      k = 1 − t (1 − 1/(1 + (z/z₀)⁴)),   t from 0 to 1 over c/q = 1/4 ... 3/4.
//!  By t, a strip at the rim does not override an observation from the middle of the sphere: it
//!  replaces it only as fast as that fades.
//! ```

use super::cube::CubeGrid;
use glam::Vec3;
use penumbra_interface::MonotonicTime;

/// Standard deviation of a texel by pixel noise, quantisation and compression: relative to its
/// value, and absolute, relative to white.
const NOISE_SHARE: f32 = 0.03;
const NOISE_FLOOR: f32 = 0.002;
/// Number of standard deviations (z₀) at which a difference halves the accumulated weight.
const HALF_WEIGHT_SIGMAS: f32 = 3.0;
/// Relative confidence of a fully clipped texel: its value is a lower bound, and its excess is an
/// estimate.
const CLIPPED_CONFIDENCE: f32 = 0.05;
/// Minimum coverage of a texel that counts as seen.
const MIN_COVERAGE: f32 = 0.01;

/// The observation of one picture, texel by texel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation<'a> {
    /// Radiance, environment camera units.
    pub radiance: &'a [Vec3],
    /// Visible part of each texel, 0..=1.
    pub coverage: &'a [f32],
    /// [`confidence`] of the visible part.
    pub confidence: &'a [f32],
}

/// Returns the confidence in the visible part of a texel: from the texel's solid angle, steradians;
/// the angle that a pixel subtends, radians; and the clipped part.
pub(super) fn confidence(solid_angle: f32, radians_per_pixel: f32, clipped: f32) -> f32 {
    let fine = solid_angle / (solid_angle + radians_per_pixel * radians_per_pixel);
    fine * (1.0 - (1.0 - CLIPPED_CONFIDENCE) * clipped.clamp(0.0, 1.0))
}

/// Radiance by direction with its confidence and age. A direction that is no longer visible keeps
/// its last valid value.
#[derive(Clone, Debug)]
pub(super) struct RadianceAccumulator {
    /// Radiance, environment camera units.
    pub radiance: Vec<Vec3>,
    /// Part of the texel that has been seen, 0..=1.
    pub coverage: Vec<f32>,
    texels: Vec<Accumulated>,
    neighbours: Vec<[u32; 8]>,
    solid_angles: Vec<f32>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Accumulated {
    /// Sum of the remaining confidences of the pictures in the mean.
    weight: f32,
    /// Mean confidence of those pictures.
    quality: f32,
    seen_at: Option<MonotonicTime>,
}

impl Accumulated {
    /// Weight that remains at `now`.
    fn faded(&self, now: MonotonicTime, memory_seconds: f32) -> f32 {
        let age = self
            .seen_at
            .map_or(f64::INFINITY, |then| now.seconds_since(then).max(0.0));
        self.weight * (-age / f64::from(memory_seconds.max(1e-3))).exp() as f32
    }
}

/// Share of the accumulated weight that remains (k in the module's head).
fn retained_share(old: Vec3, new: Vec3, relative_confidence: f32) -> f32 {
    let noise = old.abs().min(new.abs()) * NOISE_SHARE + NOISE_FLOOR;
    let z = ((new - old).abs() / noise).max_element() / HALF_WEIGHT_SIGMAS;
    let trusted = ((relative_confidence - 0.25) / 0.5).clamp(0.0, 1.0);
    1.0 - trusted * (1.0 - 1.0 / (1.0 + z.powi(4)))
}

impl RadianceAccumulator {
    pub fn new(grid: &CubeGrid) -> Self {
        let n = grid.directions.len();
        Self {
            radiance: vec![Vec3::ZERO; n],
            coverage: vec![0.0; n],
            texels: vec![Accumulated::default(); n],
            neighbours: grid.neighbours(),
            solid_angles: vec![0.0; n],
        }
    }

    pub fn is_empty(&self) -> bool {
        self.texels.iter().all(|t| t.seen_at.is_none())
    }

    /// Accumulates an observation; returns whether it shows anything.
    pub fn accumulate(
        &mut self,
        seen: &Observation,
        now: MonotonicTime,
        memory_seconds: f32,
    ) -> bool {
        let mut any = false;
        for (i, &covered) in seen.coverage.iter().enumerate() {
            if covered > MIN_COVERAGE {
                any = true;
                let confidence = (covered * seen.confidence[i]).max(1e-6);
                self.update_texel(i, seen.radiance[i], confidence, now, memory_seconds);
                self.coverage[i] = self.coverage[i].max(covered);
            }
        }
        any
    }

    fn update_texel(
        &mut self,
        i: usize,
        new: Vec3,
        confidence: f32,
        now: MonotonicTime,
        seconds: f32,
    ) {
        let old = &mut self.texels[i];
        let relative = confidence / old.quality.max(1e-6);
        let left = old.faded(now, seconds) * retained_share(self.radiance[i], new, relative);
        let share = confidence / (confidence + left);
        self.radiance[i] = self.radiance[i].lerp(new, share);
        *old = Accumulated {
            weight: left + confidence,
            quality: old.quality + (confidence - old.quality) * share,
            seen_at: Some(now),
        };
    }

    /// Returns the solid angles of the seen texels (zero elsewhere), and the neighbours of each
    /// texel.
    pub fn seen(&mut self, solid_angles: &[f32]) -> (&[f32], &[[u32; 8]]) {
        for ((out, w), c) in self
            .solid_angles
            .iter_mut()
            .zip(solid_angles)
            .zip(&self.coverage)
        {
            *out = if *c > 0.5 { *w } else { 0.0 };
        }
        (&self.solid_angles, &self.neighbours)
    }

    /// Returns the mean time at which the directions ever seen were seen last.
    pub fn mean_seen_at(&self, solid_angles: &[f32]) -> Option<MonotonicTime> {
        let seen = || self.texels.iter().filter_map(|t| t.seen_at);
        let first = seen().min()?;
        let (mut sum, mut total) = (0.0, 0.0);
        for (texel, &w) in self.texels.iter().zip(solid_angles) {
            if let Some(at) = texel.seen_at {
                sum += f64::from(w) * at.seconds_since(first);
                total += f64::from(w);
            }
        }
        let mean = sum / total.max(f64::MIN_POSITIVE);
        Some(first.offset_nanos((mean * 1e9) as i64))
    }

    pub fn oldest_seconds(&self, now: MonotonicTime) -> Option<f64> {
        let seen = self.texels.iter().filter_map(|t| t.seen_at);
        seen.map(|then| now.seconds_since(then))
            .max_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests;
