//! Directions for which visibility is stored, and the light of the dome from each.

use glam::Vec3;
use penumbra_lighting::{DomeLight, LightKind, Lighting};
use std::f32::consts::PI;

/// Number of directions for which visibility is stored, one bit each.
const DIRECTIONS: usize = 128;

/// Evenly distributed directions and the irradiance from each.
pub(super) struct Directions {
    pub all: Vec<Vec3>,
    /// Irradiance, on a surface that faces the direction, of the cells of the dome nearest to it.
    pub cells: Vec<Vec3>,
    /// Compact sources, by slot.
    pub compact: Vec<DomeLight>,
}

impl Directions {
    pub fn new() -> Self {
        let all = fibonacci_sphere(DIRECTIONS);
        Self {
            cells: vec![Vec3::ZERO; all.len()],
            compact: Vec::new(),
            all,
        }
    }

    /// Solid angle of each direction, steradians.
    pub fn solid_angle() -> f32 {
        4.0 * PI / DIRECTIONS as f32
    }

    fn nearest(&self, d: Vec3) -> usize {
        let dots = self.all.iter().map(|a| a.dot(d)).enumerate();
        dots.max_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0, |(i, _)| i)
    }

    /// Assigns the cells of the dome of `lighting` to the nearest directions.
    pub fn set_light(&mut self, lighting: &Lighting) {
        self.cells.fill(Vec3::ZERO);
        self.compact.clear();
        for light in &lighting.lights {
            match light.kind {
                LightKind::Cell => {
                    let i = self.nearest(light.direction);
                    self.cells[i] += light.irradiance;
                }
                LightKind::Compact => self.compact.push(*light),
            }
        }
    }

    /// Irradiance of cells on a surface with normal `n` from the directions whose bit in `visible` is
    /// set.
    pub fn irradiance_of_cells(&self, n: Vec3, visible: u128) -> Vec3 {
        let each = self.all.iter().zip(&self.cells).enumerate();
        each.filter(|(i, _)| visible >> i & 1 == 1)
            .map(|(_, (d, light))| *light * n.dot(*d).max(0.0))
            .sum()
    }
}

/// The six directions of an ambient cube.
pub const AXES: [Vec3; 6] = [
    Vec3::X,
    Vec3::NEG_X,
    Vec3::Y,
    Vec3::NEG_Y,
    Vec3::Z,
    Vec3::NEG_Z,
];

/// Returns `count` directions evenly distributed over the sphere (a Fibonacci spiral).
fn fibonacci_sphere(count: usize) -> Vec<Vec3> {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    let each = (0..count).map(|i| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * cos, r * sin, z)
    });
    each.collect()
}

/// Index of the direction in [`AXES`] nearest to a normal.
#[must_use]
pub fn side_of(n: Vec3) -> u32 {
    let axis = n.abs().max_position() as u32;
    2 * axis + u32::from(n[axis as usize] < 0.0)
}
