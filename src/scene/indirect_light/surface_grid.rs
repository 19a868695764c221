//! A grid that holds irradiance by position and normal along surfaces.

use super::directions::AXES;
use glam::{UVec3, Vec3, Vec4};
use std::sync::Arc;

/// Number of cells along each axis, most of them empty.
pub const GRID_SIDE: u32 = 36;

/// Weight of a place from which a grid's value counts fully; on a surface that continues to all
/// sides it is about five times as large.
const ENOUGH: f32 = 0.1;

/// The cells near surfaces. Each has one value for each of the six directions of `AXES`, to which
/// a surface with normal n contributes by the squares of n's components: they add up to one. So
/// the two sides of a wall share nothing, however thin it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceGrid {
    /// Lower corner, world, metres.
    pub low: Vec3,
    /// Upper corner, world, metres.
    pub high: Vec3,
    /// The cells that have a value and the weight of each: index of a texel in a picture of
    /// 6 [`GRID_SIDE`] × [`GRID_SIDE`] × [`GRID_SIDE`] texels, the six directions side by side.
    pub cells: Vec<(u32, f32)>,
    /// For each of these texels the number of its cell plus one, 0 for none.
    numbers: Vec<u32>,
}

/// Irradiance on surfaces, linear RGB.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceIrradiance {
    /// The cells.
    pub grid: Arc<SurfaceGrid>,
    /// Irradiance times weight of each cell.
    pub values: Vec<Vec3>,
}

/// Shares of a point of a surface in the cells around it: number of the cell, weight.
pub(super) type Splat = Vec<(u32, f32)>;

impl SurfaceGrid {
    /// Makes a grid around `points` (position, normal), each of which stands for `area`, square
    /// metres; they lie in `side` of its cells along each axis. Returns it with the shares of each point.
    pub(super) fn around(points: &[(Vec3, Vec3)], area: f32, side: u32) -> (Self, Vec<Splat>) {
        let low = points.iter().fold(Vec3::INFINITY, |l, p| l.min(p.0));
        let high = points.iter().fold(Vec3::NEG_INFINITY, |h, p| h.max(p.0));
        if points.is_empty() || !(high - low).is_finite() {
            return (Self::default(), vec![Splat::new(); points.len()]);
        }
        let size = high - low;
        // A whole cell beyond the points; no side is less than a hundredth of the longest.
        let cell = size.max(Vec3::splat(0.01 * size.max_element())) / (side - 2) as f32;
        let mut grid = Self {
            low: low - cell,
            high: low + cell * (GRID_SIDE - 1) as f32,
            cells: Vec::new(),
            numbers: vec![0; (6 * GRID_SIDE * GRID_SIDE * GRID_SIDE) as usize],
        };
        let face = cell.element_product().powf(2.0 / 3.0);
        let splats = points.iter().map(|p| grid.splat(*p, area / face)).collect();
        (grid, splats)
    }

    fn splat(&mut self, (position, normal): (Vec3, Vec3), weight: f32) -> Splat {
        let mut splat = Splat::with_capacity(24);
        for (texel, share) in self.texels(position, normal) {
            let number = &mut self.numbers[texel as usize];
            if *number == 0 {
                self.cells.push((texel, 0.0));
                *number = self.cells.len() as u32;
            }
            self.cells[*number as usize - 1].1 += weight * share;
            splat.push((*number - 1, weight * share));
        }
        splat
    }

    /// The texels between which a point of a surface lies, with their shares.
    fn texels(&self, position: Vec3, normal: Vec3) -> impl Iterator<Item = (u32, f32)> + use<> {
        let at = (position - self.low) / (self.high - self.low);
        let at = at.clamp(Vec3::ZERO, Vec3::ONE) * GRID_SIDE as f32 - 0.5;
        let at = at.clamp(Vec3::ZERO, Vec3::splat((GRID_SIDE - 1) as f32));
        let first = at.as_uvec3().min(UVec3::splat(GRID_SIDE - 2));
        let part = at - first.as_vec3();
        let faces = (0..6).map(move |face| (face, normal.dot(AXES[face as usize]).max(0.0)));
        let faces = faces.filter(|(_, cosine)| *cosine > 0.0);
        faces.flat_map(move |(face, cosine)| {
            (0..8).map(move |corner| {
                let step = UVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
                let share = Vec3::ONE - (step.as_vec3() - part).abs();
                let cell = first + step;
                let row = (cell.z * GRID_SIDE + cell.y) * 6 + face;
                let weight = share.element_product() * cosine * cosine;
                (row * GRID_SIDE + cell.x, weight)
            })
        })
    }
}

impl SurfaceIrradiance {
    /// Sets the irradiance of all points. A mean over the points around each cell would blur light over two
    /// cells and all normals: what it lacks at the points is added (Van Cittert 1931), once, since more would add the
    /// noise of the points.
    pub(super) fn set(&mut self, splats: &[Splat], irradiance: impl Iterator<Item = Vec3>) {
        self.values.clear();
        self.values.resize(self.grid.cells.len(), Vec3::ZERO);
        let irradiance: Vec<Vec3> = irradiance.collect();
        self.add(splats, &irradiance);
        let points = splats.iter().zip(&irradiance);
        let missing: Vec<Vec3> = points.map(|(splat, e)| *e - self.at(splat)).collect();
        self.add(splats, &missing);
    }

    /// Adds to the irradiance of all points.
    fn add(&mut self, splats: &[Splat], irradiance: &[Vec3]) {
        for (splat, irradiance) in splats.iter().zip(irradiance) {
            for (cell, weight) in splat {
                self.values[*cell as usize] += *irradiance * *weight;
            }
        }
    }

    /// Irradiance at a point.
    fn at(&self, splat: &Splat) -> Vec3 {
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
        for (cell, share) in splat {
            sum += self.values[*cell as usize] * *share;
            weight += self.grid.cells[*cell as usize].1 * share;
        }
        sum / weight.max(f32::MIN_POSITIVE)
    }

    /// Irradiance at `position` on a surface with normal `normal`, and in w the share, 0 to 1, to
    /// which it is known there. Twin of `indirect_light_on_virtual`.
    #[must_use]
    pub fn on(&self, position: Vec3, normal: Vec3) -> Vec4 {
        let grid = &self.grid;
        let is_outside = position.cmplt(grid.low).any() || position.cmpgt(grid.high).any();
        if self.values.is_empty() || is_outside {
            return Vec4::ZERO;
        }
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
        for (texel, share) in grid.texels(position, normal) {
            if let Some(cell) = (grid.numbers[texel as usize] as usize).checked_sub(1) {
                sum += self.values[cell] * share;
                weight += grid.cells[cell].1 * share;
            }
        }
        (sum / weight.max(1e-6)).extend((weight / ENOUGH).min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;
    use std::f32::consts::PI;

    #[test]
    fn each_side_of_a_thin_wall_keeps_its_own_irradiance() {
        let wall = (0..400).map(|i| Vec3::new((i % 20) as f32, (i / 20) as f32, 0.0) * 0.05);
        let points: Vec<(Vec3, Vec3)> = wall
            .flat_map(|p| [(p, Vec3::Z), (p - 0.001 * Vec3::Z, Vec3::NEG_Z)])
            .collect();
        let (grid, splats) = SurfaceGrid::around(&points, 0.0025, 24);
        let mut light = SurfaceIrradiance {
            grid: Arc::new(grid),
            values: Vec::new(),
        };
        let of = |(_, n): &(Vec3, Vec3)| Vec3::splat(if n.z > 0.0 { 3.0 } else { 0.5 });
        light.set(&splats, points.iter().map(of));
        let middle = Vec3::new(0.48, 0.51, 0.0);
        let (above, below) = (
            light.on(middle, Vec3::Z),
            light.on(middle - 0.001 * Vec3::Z, Vec3::NEG_Z),
        );
        assert!((above - Vec4::new(3.0, 3.0, 3.0, 1.0)).length() < 1e-4);
        assert!((below - Vec4::new(0.5, 0.5, 0.5, 1.0)).length() < 1e-4);
        assert_eq!(light.on(middle, Vec3::X), Vec4::ZERO);
    }

    #[test]
    fn light_from_one_side_turns_dark_with_the_normal() {
        // Points of a sphere; the light comes from beside the axes.
        let points: Vec<(Vec3, Vec3)> = (0..4000)
            .map(|i| {
                let z = 1.0 - (i as f32 + 0.5) / 2000.0;
                let around = Vec2::from_angle(2.399_963 * i as f32) * (1.0 - z * z).sqrt();
                (around.extend(z), around.extend(z))
            })
            .collect();
        let (grid, splats) = SurfaceGrid::around(&points, 4.0 * PI / 4000.0, 24);
        let mut light = SurfaceIrradiance {
            grid: Arc::new(grid),
            values: Vec::new(),
        };
        let from = Vec3::new(2.0, -3.0, 1.0).normalize();
        let of = |n: Vec3| n.dot(from).max(0.0);
        light.set(&splats, points.iter().map(|(_, n)| Vec3::splat(of(*n))));
        let errors = points
            .iter()
            .step_by(7)
            .map(|(p, n)| (light.on(*p, *n).x - of(*n)).abs());
        let worst = errors.fold(0.0, f32::max);
        // By means alone 0.023.
        assert!(worst < 0.018, "{worst}");
    }
}
