//! The ground.

use super::primitives;
use crate::mesh::{Material, Part};
use crate::scene::Scene;
use glam::{DMat4, DQuat, DVec3, Vec3};
use std::sync::Arc;

/// A large plane `normal · p = offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// Unit normal, world.
    pub normal: DVec3,
    /// Metres along the normal.
    pub offset: f64,
    /// Side of the square phantom, metres.
    pub size: f64,
    /// Linear diffuse reflectance, if known.
    pub albedo: Option<Vec3>,
}

impl Scene {
    /// Adds the ground as a square phantom; level ground also sets [`Scene::ground_height`].
    pub fn add_ground(&mut self, ground: &GroundPlane) {
        let rotation = DQuat::from_rotation_arc(DVec3::Z, ground.normal);
        if ground.normal.z > 0.999_999 {
            self.ground_height = Some(ground.offset / ground.normal.z);
        }
        self.phantom_parts.push(Part {
            name: "ground".into(),
            mesh: Arc::new(primitives::plane(ground.size as f32, ground.size as f32)),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::from_rotation_translation(
                rotation,
                ground.normal * ground.offset,
            ),
            mirror: false,
            albedo: ground.albedo,
        });
    }
}
