//! The region around the virtual objects.

use crate::mesh::{Part, Vertex};
use glam::{DVec3, Vec3};

/// The box around the virtual objects within which their indirect light counts; world, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Region {
    pub low: Vec3,
    pub high: Vec3,
    /// Height of the ground.
    pub floor: f32,
}

impl Region {
    /// Extends the objects' bounding box to every side by the larger of their width and 1.5 times
    /// their height. `None` without objects.
    pub fn around(parts: &[Part], ground: Option<f64>) -> Option<Self> {
        let corners = parts.iter().flat_map(|part| {
            let in_world =
                |v: &Vertex| part.world_from_part.transform_point3(v.position.as_dvec3());
            part.mesh.vertices.iter().map(in_world)
        });
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = corners.fold(empty, |(l, h), p| (l.min(p), h.max(p)));
        let (low, high) = (low.as_vec3(), high.as_vec3());
        let floor = ground.map_or(low.z, |g| g as f32);
        let size = high - low;
        let reach = size.truncate().max_element().max(1.5 * (high.z - floor));
        let usable = reach.is_finite() && reach > 0.0;
        usable.then(|| Self {
            low: Vec3::new(low.x - reach, low.y - reach, floor),
            high: Vec3::new(high.x + reach, high.y + reach, high.z + 0.3 * reach),
            floor,
        })
    }

    /// Distance of a ray's origin from its surface, metres.
    pub fn offset(&self) -> f32 {
        1e-4 * (self.high - self.low).max_element()
    }

    /// Weight of a point: 1 inside, falling to 0 at the walls, so that no edge is visible.
    pub fn window(&self, p: Vec3) -> f32 {
        let size = self.high - self.low;
        let to_wall = (p - self.low).min(self.high - p) / size;
        let walls = [to_wall.x, to_wall.y, (self.high.z - p.z) / size.z];
        walls
            .map(|w| (w / 0.15).clamp(0.0, 1.0))
            .into_iter()
            .product()
    }
}
