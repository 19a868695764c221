//! What a sphere in the scene camera's picture has shown of each direction so far.
//!
//! ```text
//!  A picture shows a texel as x with the confidence c, 0..=1: how much of the texel it shows,
//!  how finely (θ²/(θ² + δ²) for texels of θ and pixels of δ radians, long strips near the rim),
//!  and how little of it clipped. What is remembered is the mean L of what was shown, with the
//!  weight W of the pictures in it and their mean confidence q:
//!      W' = W · exp(−Δt/τ) · k,   L ← (W' L + c x)/(W' + c),   W ← W' + c
//!  so noise averages out over τ seconds. k is 1 unless x differs from L by more than noise
//!  explains, z standard deviations of a picture: then the light has changed, or an edge has
//!  moved by a fraction of a texel, and to average would be late or smear it:
//!      k = 1 − t (1 − 1/(1 + (z/z₀)⁴)),   t from 0 to 1 over c/q = 1/4 ... 3/4.
//!  By t a strip at the rim does not contradict what the middle of the ball has shown: it
//!  takes over no faster than that fades.
//! ```

use super::cube::CubeGrid;
use glam::Vec3;
use penumbra_interface::MonotonicTime;

/// Standard deviation of a texel by the noise of pixels, their quantisation and compression: a
/// share of its value, and of white.
const NOISE_SHARE: f32 = 0.03;
const NOISE_FLOOR: f32 = 0.002;
/// Standard deviations at which a difference halves what is remembered (z₀).
const HALF_AT: f32 = 3.0;
/// What a texel that is clipped altogether has of another's confidence: it is as bright at
/// least, and how much brighter is an estimate.
const CLIPPED_CONFIDENCE: f32 = 0.05;
/// Coverage below which a texel counts as not seen.
const LEAST_COVERAGE: f32 = 0.01;

/// What one picture shows, texel by texel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Glance<'a> {
    /// Environment camera units.
    pub radiance: &'a [Vec3],
    /// Part of each texel that is seen, 0..=1.
    pub coverage: &'a [f32],
    /// [`confidence`] of what is seen.
    pub confidence: &'a [f32],
}

/// Confidence in the part of a texel that is seen: the texel's solid angle, steradians; how many
/// radians a pixel spans; and which part of it is clipped.
pub(super) fn confidence(solid_angle: f32, radians_per_pixel: f32, clipped: f32) -> f32 {
    let fine = solid_angle / (solid_angle + radians_per_pixel * radians_per_pixel);
    fine * (1.0 - (1.0 - CLIPPED_CONFIDENCE) * clipped.clamp(0.0, 1.0))
}

/// Radiance by direction with its confidence and age. A direction that is out of sight keeps
/// its last good value.
#[derive(Clone, Debug)]
pub(super) struct DirectionMemory {
    /// Environment camera units.
    pub radiance: Vec<Vec3>,
    /// How much of the texel has been seen, 0..=1.
    pub coverage: Vec<f32>,
    texels: Vec<Remembered>,
    neighbours: Vec<[u32; 8]>,
    solid_angles: Vec<f32>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Remembered {
    /// Sum of the confidences that are left of the pictures in the mean.
    weight: f32,
    /// Their mean.
    quality: f32,
    seen_at: Option<MonotonicTime>,
}

impl Remembered {
    /// Weight that is left after so many seconds.
    fn faded(&self, now: MonotonicTime, memory_seconds: f32) -> f32 {
        let age = self
            .seen_at
            .map_or(f64::INFINITY, |then| now.seconds_since(then).max(0.0));
        self.weight * (-age / f64::from(memory_seconds.max(1e-3))).exp() as f32
    }
}

/// How much of what is remembered stands (k in the module's head).
fn kept(old: Vec3, new: Vec3, relative_confidence: f32) -> f32 {
    let noise = old.abs().min(new.abs()) * NOISE_SHARE + NOISE_FLOOR;
    let z = ((new - old).abs() / noise).max_element() / HALF_AT;
    let trusted = ((relative_confidence - 0.25) / 0.5).clamp(0.0, 1.0);
    1.0 - trusted * (1.0 - 1.0 / (1.0 + z.powi(4)))
}

impl DirectionMemory {
    pub fn new(grid: &CubeGrid) -> Self {
        let n = grid.directions.len();
        Self {
            radiance: vec![Vec3::ZERO; n],
            coverage: vec![0.0; n],
            texels: vec![Remembered::default(); n],
            neighbours: grid.neighbours(),
            solid_angles: vec![0.0; n],
        }
    }

    pub fn is_empty(&self) -> bool {
        self.texels.iter().all(|t| t.seen_at.is_none())
    }

    /// Takes over what a picture shows; whether it shows anything.
    pub fn remember(&mut self, seen: &Glance, now: MonotonicTime, memory_seconds: f32) -> bool {
        let mut any = false;
        for (i, &covered) in seen.coverage.iter().enumerate() {
            if covered > LEAST_COVERAGE {
                any = true;
                let confidence = (covered * seen.confidence[i]).max(1e-6);
                self.take(i, seen.radiance[i], confidence, now, memory_seconds);
                self.coverage[i] = self.coverage[i].max(covered);
            }
        }
        any
    }

    fn take(&mut self, i: usize, new: Vec3, confidence: f32, now: MonotonicTime, seconds: f32) {
        let old = &mut self.texels[i];
        let relative = confidence / old.quality.max(1e-6);
        let left = old.faded(now, seconds) * kept(self.radiance[i], new, relative);
        let share = confidence / (confidence + left);
        self.radiance[i] = self.radiance[i].lerp(new, share);
        *old = Remembered {
            weight: left + confidence,
            quality: old.quality + (confidence - old.quality) * share,
            seen_at: Some(now),
        };
    }

    /// Solid angles of what has been seen (zero elsewhere), and who is next to whom.
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

    /// When the directions that were ever seen were seen last, on average.
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
