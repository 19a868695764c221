//! What a sphere in the scene camera's picture has shown of each direction so far.

use super::cube::CubeGrid;
use glam::Vec3;
use penumbra_interface::MonotonicTime;

/// Radiance by direction with its age. A direction that is out of sight keeps its last
/// good value.
#[derive(Clone, Debug)]
pub(super) struct DirectionMemory {
    /// Environment camera units.
    pub radiance: Vec<Vec3>,
    /// How much of the texel has been seen, 0..=1.
    pub coverage: Vec<f32>,
    seen_at: Vec<Option<MonotonicTime>>,
    neighbours: Vec<[u32; 8]>,
    solid_angles: Vec<f32>,
}

impl DirectionMemory {
    pub fn new(grid: &CubeGrid) -> Self {
        let n = grid.directions.len();
        Self {
            radiance: vec![Vec3::ZERO; n],
            coverage: vec![0.0; n],
            seen_at: vec![None; n],
            neighbours: grid.neighbours(),
            solid_angles: vec![0.0; n],
        }
    }

    pub fn is_empty(&self) -> bool {
        self.seen_at.iter().all(Option::is_none)
    }

    /// Takes over a picture's texels. A texel seen wholly replaces what was known; one
    /// seen in part (at the rim of the sphere, of the picture or of what is in front)
    /// counts by its coverage against what is remembered, whose weight fades with
    /// `memory_seconds`.
    pub fn remember(
        &mut self,
        texels: &[Vec3],
        coverage: &[f32],
        now: MonotonicTime,
        memory_seconds: f32,
    ) {
        for (i, (&texel, &seen)) in texels.iter().zip(coverage).enumerate() {
            if seen <= 0.01 {
                continue;
            }
            let age =
                self.seen_at[i].map_or(f64::INFINITY, |then| now.seconds_since(then).max(0.0));
            let old = self.coverage[i] * (-age / f64::from(memory_seconds.max(1e-3))).exp() as f32;
            let share = if seen > 0.99 {
                1.0
            } else {
                seen / (seen + old)
            };
            self.radiance[i] = self.radiance[i].lerp(texel, share);
            self.coverage[i] = self.coverage[i].max(seen);
            self.seen_at[i] = Some(now);
        }
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

    pub fn oldest_seconds(&self, now: MonotonicTime) -> Option<f64> {
        let seen = self.seen_at.iter().flatten();
        seen.map(|then| now.seconds_since(*then))
            .max_by(f64::total_cmp)
    }
}
