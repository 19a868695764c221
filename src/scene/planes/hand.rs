//! Parts that planes placed by hand cover.

use super::{Layer, ShadowingPlane};
use crate::mesh::Part;
use crate::scene::Scene;
use glam::{DVec2, DVec3};

/// Sets [`ShadowingPlane::parts`] of the scene's own planes and sorts those of the real layer first.
pub(crate) fn covered_parts(scene: &mut Scene) {
    let mut planes = std::mem::take(&mut scene.planes);
    for plane in &mut planes {
        let parts = match plane.layer {
            Layer::Real => &scene.phantom_parts,
            Layer::Virtual => &scene.virtual_parts,
        };
        let numbered = (0..).zip(parts);
        plane.parts = numbered
            .filter(|(_, p)| reaches(plane, p))
            .map(|(i, _)| i)
            .collect();
    }
    planes.sort_by_key(|p| p.layer != Layer::Real);
    scene.planes = planes;
}

/// Whether the bounding box of `part`, along the plane's axes, intersects the slab behind the plane.
fn reaches(plane: &ShadowingPlane, part: &Part) -> bool {
    let normal = plane.normal();
    let in_plane = |v: &crate::mesh::Vertex| {
        let from = part.world_from_part.transform_point3(v.position.as_dvec3()) - plane.centre;
        DVec3::new(from.dot(plane.right), from.dot(plane.up), -from.dot(normal))
    };
    let (low, high) = super::surface::bounds(part.mesh.vertices.iter().map(in_plane));
    let low_corner = (-plane.half_size).extend(0.0);
    let high_corner = DVec2::extend(plane.half_size, plane.depth);
    low.cmple(high_corner).all() && high.cmpge(low_corner).all()
}
