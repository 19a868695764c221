//! The radiance map prefiltered for glossy materials: GGX, split sum (Karis 2013).
//!
//! ```text
//!  With v = n = r the half vector's density D(h)(n·h) becomes D(h)/4 over the light's
//!  directions, and a level is   Σ L(l) (n·l) / Σ (n·l)   over l = reflect(n, h), h drawn
//!  from D(h)(n·h). Each sample stands for 4/(N D) steradians and is read from the level
//!  of the unfiltered pyramid whose texels are about as large (Křivánek & Colbert 2008).
//! ```
//! The samples, their levels and weights depend on the geometry alone and are tabulated,
//! so a frame costs one sparse matrix product and the same input gives the same bytes.

use super::cube::{CubeGrid, halve, tangent_frame, texel_of, texel_solid_angle};
use super::light::CubeMap;
use glam::Vec3;
use std::f32::consts::PI;

/// Samples of the GGX lobe for a texel of level 1; doubled from level to level.
const FIRST_LEVEL_SAMPLES: usize = 24;

/// The table for one size of cube.
#[derive(Clone, Debug)]
pub struct Prefilter {
    size: u32,
    /// Per level from 1: starts into `entries`, one more than texels.
    levels: Vec<Level>,
    /// Where each level of the unfiltered pyramid begins.
    pyramid_starts: Vec<usize>,
}

#[derive(Clone, Debug)]
struct Level {
    starts: Vec<u32>,
    /// Index into the pyramid laid end to end, and weight.
    entries: Vec<(u32, f32)>,
}

impl Prefilter {
    /// `size` is a power of two.
    #[must_use]
    pub fn new(size: u32) -> Self {
        let count = size.ilog2() as usize + 1;
        let mut pyramid_starts = vec![0];
        for level in 0..count {
            let side = (size >> level) as usize;
            pyramid_starts.push(pyramid_starts[level] + 6 * side * side);
        }
        let levels = (1..count)
            .map(|m| Level::new(size, m, count, &pyramid_starts))
            .collect();
        Self {
            size,
            levels,
            pyramid_starts,
        }
    }

    /// The radiance map of `texels` (level 0 is `texels` itself).
    #[must_use]
    pub fn apply(&self, texels: &[Vec3]) -> CubeMap {
        let pyramid = self.pyramid(texels);
        let mut levels = vec![texels.iter().map(Vec3::to_array).collect()];
        levels.extend(self.levels.iter().map(|l| l.apply(&pyramid)));
        CubeMap {
            size: self.size,
            levels,
        }
    }

    fn pyramid(&self, texels: &[Vec3]) -> Vec<Vec3> {
        let mut pyramid = texels.to_vec();
        let mut side = self.size;
        for start in &self.pyramid_starts[..self.pyramid_starts.len() - 2] {
            let smaller = halve(side, &pyramid[*start..]);
            pyramid.extend(smaller);
            side /= 2;
        }
        pyramid
    }
}

impl Level {
    fn new(size: u32, level: usize, count: usize, pyramid_starts: &[usize]) -> Self {
        let roughness = level as f32 / (count - 1) as f32;
        let samples = FIRST_LEVEL_SAMPLES << level.min(5);
        let lobe = Lobe::new(roughness * roughness, samples, size, count);
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for &n in &CubeGrid::new(size >> level).directions {
            lobe.add(n, size, pyramid_starts, &mut entries);
            let first = starts.last().map_or(0, |&s| s as usize);
            merge_from(&mut entries, first);
            starts.push(entries.len() as u32);
        }
        Self { starts, entries }
    }

    fn apply(&self, pyramid: &[Vec3]) -> Vec<[f32; 3]> {
        self.starts
            .windows(2)
            .map(|range| {
                self.entries[range[0] as usize..range[1] as usize]
                    .iter()
                    .map(|&(i, w)| pyramid[i as usize] * w)
                    .sum::<Vec3>()
                    .to_array()
            })
            .collect()
    }
}

/// Sorts and adds up entries of the same texel from index `first` on; weights add up to 1.
fn merge_from(entries: &mut Vec<(u32, f32)>, first: usize) {
    entries[first..].sort_unstable_by_key(|e| e.0);
    let total: f32 = entries[first..].iter().map(|e| e.1).sum();
    let mut write = first;
    for read in first..entries.len() {
        let (index, weight) = entries[read];
        if write > first && entries[write - 1].0 == index {
            entries[write - 1].1 += weight / total;
        } else {
            entries[write] = (index, weight / total);
            write += 1;
        }
    }
    entries.truncate(write);
}

/// Directions of light in the normal's frame, with weight n·l and pyramid level.
struct Lobe {
    samples: Vec<(Vec3, f32, f32)>,
}

impl Lobe {
    fn new(alpha: f32, count: usize, size: u32, levels: usize) -> Self {
        let texel = 4.0 * PI / (6.0 * (size * size) as f32);
        let samples = (0..count)
            .filter_map(|i| {
                let (u, v) = ((i as f32 + 0.5) / count as f32, radical_inverse(i as u32));
                let cos_h = ((1.0 - v) / (1.0 + (alpha * alpha - 1.0) * v)).sqrt();
                let sin_h = (1.0 - cos_h * cos_h).max(0.0).sqrt();
                let phi = 2.0 * PI * u;
                let h = Vec3::new(sin_h * phi.cos(), sin_h * phi.sin(), cos_h);
                let l = 2.0 * cos_h * h - Vec3::Z;
                let q = cos_h * cos_h * (alpha * alpha - 1.0) + 1.0;
                let density = alpha * alpha / (PI * q * q) / 4.0;
                let lod = 0.5 * (1.0 / (count as f32 * density) / texel).log2() + 0.5;
                let lod = lod.clamp(0.0, (levels - 1) as f32);
                (l.z > 0.0).then_some((l, l.z, lod))
            })
            .collect();
        Self { samples }
    }

    fn add(&self, n: Vec3, size: u32, pyramid_starts: &[usize], entries: &mut Vec<(u32, f32)>) {
        let (right, up) = tangent_frame(n);
        for &(l, weight, lod) in &self.samples {
            let direction = right * l.x + up * l.y + n * l.z;
            let low = lod as usize;
            for (level, part) in [(low, 1.0 - lod.fract()), (low + 1, lod.fract())] {
                if part > 0.0 && level + 1 < pyramid_starts.len() {
                    add_bilinear(
                        size >> level,
                        pyramid_starts[level],
                        direction,
                        weight * part,
                        entries,
                    );
                }
            }
        }
    }
}

/// Reads a level by the solid-angle-weighted mean of the texels that a texel-sized square
/// around the direction touches: bilinear, across the edges of faces too.
fn add_bilinear(side: u32, start: usize, d: Vec3, weight: f32, entries: &mut Vec<(u32, f32)>) {
    let (right, up) = tangent_frame(d);
    let major = d.abs().max_element();
    // Half a texel where the direction points: texels shrink by major^1.5 towards corners.
    let reach = 0.5 / side as f32 * major.powf(1.5);
    for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let moved = d + (right * a + up * b) * reach;
        entries.push(((start + texel_of(side, moved)) as u32, 0.25 * weight));
    }
}

/// Van der Corput's sequence in base 2.
fn radical_inverse(i: u32) -> f32 {
    (i.reverse_bits() >> 8) as f32 / (1u32 << 24) as f32
}

/// Mean of a level over the sphere, for tests and status.
#[must_use]
pub fn level_mean(map: &CubeMap, level: usize) -> Vec3 {
    let side = map.size >> level;
    let n = (side * side) as usize;
    let Some(texels) = map.levels.get(level) else {
        return Vec3::ZERO;
    };
    let sum: Vec3 = texels
        .iter()
        .enumerate()
        .map(|(i, t)| {
            let k = (i % n) as u32;
            Vec3::from(*t) * texel_solid_angle(side, k % side, k / side) as f32
        })
        .sum();
    sum / (4.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::cube::sample;

    #[test]
    fn a_constant_stays_constant_at_every_roughness() {
        let map = Prefilter::new(32).apply(&vec![Vec3::new(0.2, 1.0, 3.0); 6 * 32 * 32]);
        assert_eq!(map.levels.len(), 6);
        for (m, level) in map.levels.iter().enumerate() {
            assert_eq!(level.len(), 6 * (32usize >> m).pow(2));
            for t in level {
                assert!(
                    (t[1] - 1.0).abs() < 1e-3 && (t[2] - 3.0).abs() < 3e-3,
                    "{m} {t:?}"
                );
            }
        }
    }

    /// A spot seen at roughness ½ against brute-force integration of the split sum.
    #[test]
    fn a_spot_spreads_as_the_integral_says() {
        let grid = CubeGrid::new(64);
        let spot = Vec3::new(0.3, 0.5, 0.81).normalize();
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|d| {
                if d.dot(spot) > 0.99 {
                    Vec3::ONE
                } else {
                    Vec3::splat(0.01)
                }
            })
            .collect();
        let map = Prefilter::new(64).apply(&texels);
        for (level, tolerance) in [(2usize, 0.12f32), (3, 0.08), (4, 0.06)] {
            let alpha = (level as f32 / 6.0).powi(2);
            for tilt in [0.0f32, 0.2, 0.5] {
                let n = (spot + Vec3::X.cross(spot) * tilt).normalize();
                let exact = brute_force(n, alpha, &grid, &texels);
                let got = sample(&map, level, n);
                let scale = exact.x.max(0.1);
                assert!(
                    (got.x - exact.x).abs() < tolerance.max(0.1) * scale + 0.01,
                    "{level} {tilt}: {} {}",
                    got.x,
                    exact.x
                );
            }
        }
    }

    fn brute_force(n: Vec3, alpha: f32, grid: &CubeGrid, texels: &[Vec3]) -> Vec3 {
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for ((l, w), t) in grid.directions.iter().zip(&grid.solid_angles).zip(texels) {
            let n_l = l.dot(n);
            if n_l > 0.0 {
                let cos_h = (*l + n).normalize().dot(n);
                let q = cos_h * cos_h * (alpha * alpha - 1.0) + 1.0;
                let k = w * n_l * alpha * alpha / (q * q);
                sum += *t * k;
                total += k;
            }
        }
        sum / total
    }
}
