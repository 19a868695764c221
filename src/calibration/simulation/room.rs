//! The simulated room: a box with textured walls, which contains the panels.

use super::panel::Panel;
use glam::DVec3;
use penumbra_numerics::{Random, smoothstep};

/// Side of the texture tile, points.
const TILE: usize = 256;
/// Side of the texture tile, metres.
const TILE_METRES: f64 = 1.3;
/// Lower corner of the room, metres; the floor lies just below the table top at z = 0.
const LOW: DVec3 = DVec3::new(-2.5, -2.5, -0.0008);
/// Upper corner of the room, metres.
const HIGH: DVec3 = DVec3::new(2.5, 2.5, 2.6);

/// Walls and panels.
#[derive(Clone, Debug)]
pub struct Room {
    /// The printed panels.
    pub panels: Vec<Panel>,
    texture: Vec<f32>,
}

impl Room {
    /// Creates a room whose wall texture depends on `seed` only.
    #[must_use]
    pub fn new(panels: Vec<Panel>, seed: u64) -> Self {
        Self {
            panels,
            texture: texture(seed),
        }
    }

    /// Returns distance (in lengths of `ray`) and linear reflectance of the wall that a ray from
    /// `origin` hits.
    pub(super) fn wall_hit(&self, origin: DVec3, ray: DVec3) -> (f64, f32) {
        let mut nearest = (f64::INFINITY, 2);
        for axis in 0..3 {
            let wall = if ray[axis] > 0.0 { HIGH } else { LOW };
            let t = (wall[axis] - origin[axis]) / ray[axis];
            if t > 0.0 && t < nearest.0 {
                nearest = (t, axis);
            }
        }
        let (t, axis) = nearest;
        let hit = origin + ray * t.min(100.0);
        let (u, v) = (hit[(axis + 1) % 3], hit[(axis + 2) % 3]);
        (t, self.sample(u, v))
    }

    /// Samples the texture at a point of a wall (metres), bilinearly.
    fn sample(&self, u: f64, v: f64) -> f32 {
        let scale = TILE as f64 / TILE_METRES;
        let (u, v) = (
            (u * scale).rem_euclid(TILE as f64),
            (v * scale).rem_euclid(TILE as f64),
        );
        let (x, y) = (u as usize % TILE, v as usize % TILE);
        let (a, b) = (u.fract() as f32, v.fract() as f32);
        let at = |x: usize, y: usize| self.texture[(y % TILE) * TILE + x % TILE];
        let top = at(x, y) * (1.0 - a) + at(x + 1, y) * a;
        let bottom = at(x, y + 1) * (1.0 - a) + at(x + 1, y + 1) * a;
        top * (1.0 - b) + bottom * b
    }
}

/// Returns value noise of several scales that repeats beyond the tile.
fn texture(seed: u64) -> Vec<f32> {
    let mut random = Random::new(seed ^ 0x7e87);
    let mut out = vec![0.22_f32; TILE * TILE];
    for (cells, strength) in [(8, 0.1), (24, 0.07), (64, 0.06), (128, 0.05)] {
        let values: Vec<f64> = (0..cells * cells)
            .map(|_| random.between(-1.0, 1.0))
            .collect();
        for (i, slot) in out.iter_mut().enumerate() {
            let scale = cells as f64 / TILE as f64;
            let (u, v) = ((i % TILE) as f64 * scale, (i / TILE) as f64 * scale);
            let (a, b) = (
                smoothstep(0.0, 1.0, u.fract()),
                smoothstep(0.0, 1.0, v.fract()),
            );
            let (x, y) = (u as usize, v as usize);
            let at = |x: usize, y: usize| values[(y % cells) * cells + x % cells];
            let top = at(x, y) * (1.0 - a) + at(x + 1, y) * a;
            let bottom = at(x, y + 1) * (1.0 - a) + at(x + 1, y + 1) * a;
            *slot += (strength * (top * (1.0 - b) + bottom * b)) as f32;
        }
    }
    for slot in &mut out {
        *slot = slot.clamp(0.02, 0.7);
    }
    out
}
