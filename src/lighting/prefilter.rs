//! The radiance map, prefiltered for the lobes of glossy materials.
//!
//! Level 0 is the map itself; level k ≥ 1 is Σ L(l) k_w(l) over the round lobe of width w_k about
//! each texel's direction ([`super::lobes`]). The sum runs over a cut through the pyramid of halved
//! maps, fine where the lobe changes across a texel and coarse where it does not. The cut and its
//! weights depend on the geometry alone and are tabulated, so a frame costs one sparse matrix
//! product and equal input gives identical bytes.

use super::compact_source_specular::Excess;
use super::cube::{CubeGrid, sample_seamless, texel_solid_angle};
use super::light::CubeMap;
use super::lobes::{Family, widths};
use glam::{Vec3, Vec4};
use std::f32::consts::PI;

/// Maximum change of the lobe across a pyramid texel that is not subdivided, relative to the lobe's
/// integral.
const TOLERANCE: f32 = 0.05;
/// Texels with less than this share of the integral are omitted.
const NEGLIGIBLE: f32 = 1e-4;
/// Texels along a side of the smallest level.
const SMALLEST: u32 = 4;

/// Number of levels of a map of `size` texels along a side: down to 4 texels, which hold the widest
/// lobes.
#[must_use]
pub const fn level_count(size: u32) -> usize {
    (size / SMALLEST).ilog2() as usize + 1
}

/// The tables for one size of cube.
#[derive(Clone, Debug)]
pub struct Prefilter {
    size: u32,
    ggx: Vec<Level>,
    phong: Vec<Level>,
    /// Index of the first texel of each level of the unfiltered pyramid.
    starts: Vec<usize>,
    /// Per level except the last: the share of each texel of a face in its parent.
    shares: Vec<Vec<f32>>,
}

/// Lobes of one level.
#[derive(Clone, Debug)]
struct Level {
    /// Indices into `entries`, one more than texels.
    starts: Vec<u32>,
    /// Index into the concatenated pyramid, and weight.
    entries: Vec<(u32, f32)>,
}

impl Prefilter {
    /// Builds the tables for GGX alone. `size` is a power of two, at least 8.
    #[must_use]
    pub fn new(size: u32) -> Self {
        let mut starts = vec![0];
        for level in 0..=size.ilog2() {
            let side = (size >> level) as usize;
            starts.push(starts[level as usize] + 6 * side * side);
        }
        let mut new = Self {
            size,
            ggx: Vec::new(),
            phong: Vec::new(),
            shares: (0..size.ilog2()).map(|k| shares(size >> k)).collect(),
            starts,
        };
        new.ggx = new.tables(Family::Ggx);
        new
    }

    /// Adds the tables for Phong if `requested`; they are built at the first request.
    #[must_use]
    pub fn with_phong(mut self, requested: bool) -> Self {
        self.set_phong(requested);
        self
    }

    /// See [`Self::with_phong`].
    pub fn set_phong(&mut self, requested: bool) {
        if !requested {
            self.phong.clear();
        } else if self.phong.is_empty() {
            self.phong = self.tables(Family::Phong);
        }
    }

    fn tables(&self, family: Family) -> Vec<Level> {
        let cut = Cut::new(self.size, &self.starts);
        let widths = widths(self.size, level_count(self.size));
        let each = widths.into_iter().zip(1..);
        each.map(|(w, level)| Level::new(self.size >> level, family, w, &cut))
            .collect()
    }

    /// Filters the map of `texels`, `6 * size²` of them.
    #[must_use]
    pub fn apply(&self, texels: &[Vec3]) -> CubeMap {
        self.apply_without(texels, &[])
    }

    /// The same; the levels leave out the share of each source given by its weights.
    #[must_use]
    pub fn apply_without(&self, texels: &[Vec3], sources: &[Excess]) -> CubeMap {
        let mut pyramid = self.pyramid(texels);
        for source in sources {
            self.subtract(&mut pyramid, &source.parts, source.source.weights[0]);
        }
        let map_itself = &pyramid[..texels.len()];
        let mut map = CubeMap {
            size: self.size,
            levels: vec![map_itself.iter().map(|t| t.truncate().to_array()).collect()],
            compact_sources: sources.iter().map(|s| s.source).collect(),
            ..CubeMap::default()
        };
        for (k, ggx) in self.ggx.iter().enumerate() {
            for source in sources {
                let more = source.source.weights[k + 1] - source.source.weights[k];
                self.subtract(&mut pyramid, &source.parts, more);
            }
            map.levels.push(ggx.apply(&pyramid));
            map.phong
                .extend(self.phong.get(k).map(|l| l.apply(&pyramid)));
        }
        map
    }

    /// Subtracts the share of a source's texels from all levels of a pyramid.
    fn subtract(&self, pyramid: &mut [Vec4], parts: &[(u32, Vec3)], share: f32) {
        if share == 0.0 {
            return;
        }
        for (i, radiance) in parts {
            let (mut i, mut less) = (*i as usize, radiance.extend(0.0) * share);
            pyramid[i] -= less;
            for (level, shares) in self.shares.iter().enumerate() {
                let n = (self.size >> level) as usize;
                let (face, inside) = (i / (n * n), i % (n * n));
                less *= shares[inside];
                i = face * n * n / 4 + inside / n / 2 * (n / 2) + inside % n / 2;
                pyramid[self.starts[level + 1] + i] -= less;
            }
        }
    }

    /// Returns the map and its halves, each texel the mean of four by their solid angles.
    fn pyramid(&self, texels: &[Vec3]) -> Vec<Vec4> {
        let mut pyramid = Vec::with_capacity(self.starts.last().map_or(0, |end| *end));
        pyramid.extend(texels.iter().map(|t| t.extend(0.0)));
        for (level, shares) in self.shares.iter().enumerate() {
            let (n, half) = (
                (self.size >> level) as usize,
                (self.size >> level) as usize / 2,
            );
            for i in 0..6 * half * half {
                let (face, y, x) = (i / (half * half), i / half % half, i % half);
                let inside = 2 * y * n + 2 * x;
                let first = self.starts[level] + face * n * n;
                let part = |o: usize| pyramid[first + inside + o] * shares[inside + o];
                let mean = (part(0) + part(1)) + (part(n) + part(n + 1));
                pyramid.push(mean);
            }
        }
        pyramid
    }
}

/// Returns the share of each texel of a face of `side²` in its parent texel.
fn shares(side: u32) -> Vec<f32> {
    let size = |x: u32, y: u32| texel_solid_angle(side, x, y);
    let share = |i: u32| {
        let (x, y) = (i % side, i / side);
        let (left, top) = (x & !1, y & !1);
        let all: f64 = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(dx, dy)| size(left + dx, top + dy))
            .iter()
            .sum();
        (size(x, y) / all) as f32
    };
    (0..side * side).map(share).collect()
}

impl Level {
    fn new(side: u32, family: Family, width: f32, cut: &Cut<'_>) -> Self {
        let lobe = Lobe::new(family, width);
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for &axis in &CubeGrid::new(side).directions {
            let first = entries.len();
            cut.gather(axis, &lobe, &mut entries);
            let total: f32 = entries[first..].iter().map(|e| e.1).sum();
            for entry in &mut entries[first..] {
                entry.1 /= total;
            }
            entries[first..].sort_unstable_by_key(|e| e.0);
            starts.push(entries.len() as u32);
        }
        Self { starts, entries }
    }

    fn apply(&self, pyramid: &[Vec4]) -> Vec<[f32; 3]> {
        self.starts
            .windows(2)
            .map(|range| {
                let entries = &self.entries[range[0] as usize..range[1] as usize];
                let mut sum = Vec4::ZERO;
                for &(i, w) in entries {
                    sum += pyramid[i as usize] * w;
                }
                sum.truncate().to_array()
            })
            .collect()
    }
}

/// A round lobe as a function of the squared chord to its axis, |l − axis|²: tabulated 16 times per
/// doubling by the bits of the number, which approximate its logarithm.
struct Lobe {
    values: Vec<f32>,
    first: u32,
}

impl Lobe {
    /// Bits of a float between two entries.
    const SPACING: u32 = 1 << 19;

    fn new(family: Family, width: f32) -> Self {
        let first = (0.02 * width).powi(2).to_bits();
        let count = (4.0_f32.to_bits() - first) / Self::SPACING + 2;
        let norm = 1.0 / family.moments(width).0;
        let values = (0..=count).map(|i| {
            let chord2 = f32::from_bits(first + i * Self::SPACING);
            (norm * family.by_versine(width, 0.5 * f64::from(chord2))) as f32
        });
        Self {
            values: values.collect(),
            first,
        }
    }

    /// Value per steradian.
    fn at(&self, chord2: f32) -> f32 {
        let past = chord2.to_bits().saturating_sub(self.first);
        let i = ((past / Self::SPACING) as usize).min(self.values.len() - 2);
        let t = (past % Self::SPACING) as f32 / Self::SPACING as f32;
        self.values[i] + t * (self.values[i + 1] - self.values[i])
    }
}

/// Finds cuts through the pyramid.
struct Cut<'a> {
    starts: &'a [usize],
    /// From twice the map's size down to one texel per face.
    grids: Vec<CubeGrid>,
}

impl<'a> Cut<'a> {
    fn new(size: u32, starts: &'a [usize]) -> Self {
        let grids = (0..=size.ilog2() + 1).map(|k| CubeGrid::new((2 * size) >> k));
        Self {
            starts,
            grids: grids.collect(),
        }
    }

    fn gather(&self, axis: Vec3, lobe: &Lobe, entries: &mut Vec<(u32, f32)>) {
        let top = self.grids.len() - 2;
        for face in 0..6 {
            self.descend(top, face, axis, lobe, entries);
        }
    }

    /// `index` is a texel of pyramid level `level`.
    fn descend(
        &self,
        level: usize,
        index: usize,
        axis: Vec3,
        lobe: &Lobe,
        entries: &mut Vec<(u32, f32)>,
    ) {
        let grid = &self.grids[level + 1];
        let (d, solid_angle) = (grid.directions[index], grid.solid_angles[index]);
        // Half a square's diagonal, and more for texels that are not quite square.
        let reach = 1.15 * (0.5 * solid_angle).sqrt();
        let chord = d.distance(axis);
        let highest = lobe.at((chord - reach).max(0.0).powi(2));
        if highest * solid_angle < NEGLIGIBLE {
            return;
        }
        let change = highest - lobe.at((chord + reach).min(2.0).powi(2));
        if level > 0 && change * solid_angle > TOLERANCE {
            for child in children(grid.size, index) {
                self.descend(level - 1, child, axis, lobe, entries);
            }
            return;
        }
        let finer = &self.grids[level];
        let parts = children(grid.size, index)
            .map(|c| lobe.at(finer.directions[c].distance_squared(axis)) * finer.solid_angles[c]);
        let weight: f32 = parts.iter().sum();
        if weight > 0.0 {
            entries.push(((self.starts[level] + index) as u32, weight));
        }
    }
}

/// The four texels, of a grid twice as fine, that a texel covers.
fn children(side: u32, index: usize) -> [usize; 4] {
    let n = side as usize;
    let (face, y, x) = (index / (n * n), index / n % n, index % n);
    let first = (face * 2 * n + 2 * y) * 2 * n + 2 * x;
    [first, first + 1, first + 2 * n, first + 2 * n + 1]
}

/// Returns the radiance that a lobe of `family` gathers about `direction`; `level` with its
/// fraction is that of [`super::lobes::Levels`]. Twin of the shaders' look-up.
#[must_use]
pub fn gathered(map: &CubeMap, family: Family, level: f32, direction: Vec3) -> Vec3 {
    let texels = |k: usize| match family {
        Family::Phong if k > 0 => map.phong.get(k - 1),
        _ => map.levels.get(k),
    };
    let at = |k: usize| {
        let side = (map.size >> k).max(1);
        texels(k).map_or(Vec3::ZERO, |t| sample_seamless(t, side, direction))
    };
    let (low, t) = (level.max(0.0) as usize, level.max(0.0).fract());
    if t == 0.0 {
        return at(low);
    }
    at(low).lerp(at(low + 1), t)
}

/// Returns the mean of a level over the sphere, for tests and status.
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

    #[test]
    fn constant_is_preserved_at_every_width() {
        let texels = vec![Vec3::new(0.2, 1.0, 3.0); 6 * 32 * 32];
        let map = Prefilter::new(32).with_phong(true).apply(&texels);
        assert_eq!((map.levels.len(), map.phong.len()), (4, 3));
        for (m, level) in map.levels.iter().enumerate() {
            assert_eq!(level.len(), 6 * (32usize >> m).pow(2));
        }
        for t in map.levels.iter().chain(&map.phong).flatten() {
            let off = (Vec3::from(*t) - Vec3::new(0.2, 1.0, 3.0)).abs();
            assert!(off.max_element() < 1e-5, "{t:?}");
        }
    }

    #[test]
    fn gathered_radiance_is_continuous_at_face_edges() {
        let grid = CubeGrid::new(32);
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|d| Vec3::splat(1.0 + 0.5 * d.x + 0.3 * d.y * d.z))
            .collect();
        let map = Prefilter::new(32).with_phong(true).apply(&texels);
        let edge = Vec3::new(1.0, 1.0, 0.3);
        for (family, level) in [(Family::Ggx, 1.0), (Family::Ggx, 3.0), (Family::Phong, 2.5)] {
            let at = |x: f32| gathered(&map, family, level, edge + Vec3::X * x).x;
            assert!((at(1e-4) - at(-1e-4)).abs() < 1e-3, "{family:?} {level}");
        }
    }

    #[test]
    fn phong_tables_exist_only_if_requested() {
        let texels = vec![Vec3::ONE; 6 * 16 * 16];
        let mut prefilter = Prefilter::new(16);
        assert!(prefilter.apply(&texels).phong.is_empty());
        prefilter.set_phong(true);
        assert_eq!(prefilter.apply(&texels).phong.len(), 2);
        prefilter.set_phong(false);
        assert!(prefilter.apply(&texels).phong.is_empty());
    }
}
