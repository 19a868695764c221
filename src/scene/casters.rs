//! Simplified virtual parts for shadow maps.

use crate::mesh::Part;
use crate::scene::Scene;
use glam::DVec3;
use std::collections::HashMap;
use std::sync::Arc;

/// Maximum error of the casters' outline as a share of their extent: half a texel of a 512-texel
/// shadow map that just holds them. Shading lifts its points at least that far off their surface,
/// so that the parts show no self-shadowing.
const OUTLINE_SHARE: f64 = 1.0 / 1024.0;

/// Returns the virtual parts of `scene` with meshes as fine as a shadow map resolves.
#[must_use]
pub fn casters(scene: &Scene) -> Vec<Part> {
    let Some(extent) = extent(&scene.virtual_parts) else {
        return Vec::new();
    };
    casters_within(scene, (extent * OUTLINE_SHARE) as f32)
}

/// Returns the virtual parts of `scene` with meshes simplified to within `max_error_m` metres in
/// the world. Copies of one mesh with one linear transform stay shared.
#[must_use]
pub fn casters_within(scene: &Scene, max_error_m: f32) -> Vec<Part> {
    let mut known: HashMap<(usize, [u64; 9], u32), Arc<crate::mesh::Mesh>> = HashMap::new();
    let simplified = |part: &Part| {
        let linear = glam::DMat3::from_mat4(part.world_from_part);
        let key = (
            Arc::as_ptr(&part.mesh) as usize,
            linear.to_cols_array().map(f64::to_bits),
            part.material.alpha_cutoff.to_bits(),
        );
        let mesh = known.entry(key).or_insert_with(|| part.caster(max_error_m));
        Part {
            mesh: mesh.clone(),
            ..part.clone()
        }
    };
    scene.virtual_parts.iter().map(simplified).collect()
}

/// The longest edge of the parts' bounding box, metres.
fn extent(parts: &[Part]) -> Option<f64> {
    let corners = parts.iter().flat_map(|part| {
        let place =
            |v: &crate::mesh::Vertex| part.world_from_part.transform_point3(v.position.as_dvec3());
        part.mesh.vertices.iter().map(place)
    });
    let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
        (low.min(p), high.max(p))
    });
    let max_edge = (high - low).max_element();
    max_edge.is_finite().then_some(max_edge)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Material;
    use crate::primitives;
    use glam::DMat4;

    fn scene(scale: f64) -> Scene {
        let mesh = Arc::new(primitives::torus(0.08, 0.02, 225, 130));
        let part = |x: f64| Part {
            name: "ring".into(),
            mesh: mesh.clone(),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::from_translation(DVec3::X * x)
                * DMat4::from_scale(DVec3::splat(scale)),
            mirror: false,
            albedo: None,
        };
        Scene {
            virtual_parts: vec![part(0.0), part(0.0)],
            ..Scene::default()
        }
    }

    #[test]
    fn casters_keep_their_position_and_lose_most_triangles_at_any_size() {
        for scale in [1.0, 30.0] {
            let scene = scene(scale);
            let casters = casters(&scene);
            assert_eq!(casters.len(), 2);
            assert!(Arc::ptr_eq(&casters[0].mesh, &casters[1].mesh));
            let left = casters[0].mesh.indices.len() / 3;
            assert!(left < 58_500 / 4, "{left}");
            let (a, b) = (
                extent(&scene.virtual_parts).unwrap(),
                extent(&casters).unwrap(),
            );
            assert!((a - b).abs() < a * 2.0 * OUTLINE_SHARE, "{a} {b}");
        }
    }

    #[test]
    fn scene_without_virtual_parts_has_no_casters() {
        assert!(casters(&Scene::default()).is_empty());
    }
}
