//! Meshes, materials, and the scene that holds them.

use super::motion::Motions;
use super::planes::ShadowingPlane;
use crate::virtual_light::VirtualLight;
use glam::{DMat4, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// One corner of a triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// Metres, object frame (Penumbra's: right-handed, +Z up).
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Texture coordinates, (0, 0) top left as in glTF.
    pub uv: Vec2,
    /// Unit tangent and handedness as in glTF; zero where there is no normal map.
    pub tangent: Vec4,
}

/// Indexed triangles, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners.
    pub vertices: Vec<Vertex>,
    /// Three per triangle, each below `vertices.len()`.
    pub indices: Vec<u32>,
}

/// An 8-bit RGBA texture with repeat wrapping.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneTexture {
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `4 * width * height` bytes.
    pub rgba: Vec<u8>,
}

/// Phong's model in place of metallic-roughness: diffuse reflection by the base colour, and
/// the energy-normalised lobe of Lafortune & Willems (1994) about the mirror direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    /// Linear RGB: share of the light that the lobe mirrors at normal incidence. With the
    /// base colour at most 1.
    pub specular: Vec3,
    /// Of the cosine, 0..=10 000.
    pub exponent: f32,
}

/// glTF 2.0 metallic-roughness material, or Phong's. Textures multiply the factors.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Linear RGBA.
    pub base_colour: Vec4,
    /// 0..=1.
    pub metallic: f32,
    /// Perceptual, 0..=1; α = roughness².
    pub roughness: f32,
    /// KHR_materials_specular's factor (1 = F0 of 4 %).
    pub specular: f32,
    /// Linear RGB, scene camera units.
    pub emissive: Vec3,
    /// Draw both sides.
    pub double_sided: bool,
    /// Alpha below this is cut away; 0 = opaque.
    pub alpha_cutoff: f32,
    /// Instead of metallic, roughness and specular.
    pub phong: Option<Phong>,
    /// sRGB.
    pub base_colour_texture: Option<Arc<SceneTexture>>,
    /// Linear; G = roughness, B = metallic.
    pub metallic_roughness_texture: Option<Arc<SceneTexture>>,
    /// Linear; tangent space.
    pub normal_texture: Option<Arc<SceneTexture>>,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Linear; R.
    pub occlusion_texture: Option<Arc<SceneTexture>>,
    /// sRGB.
    pub emissive_texture: Option<Arc<SceneTexture>>,
}

impl Material {
    /// Whether any of its properties differ from place to place.
    #[must_use]
    pub fn is_textured(&self) -> bool {
        [
            &self.base_colour_texture,
            &self.metallic_roughness_texture,
            &self.normal_texture,
            &self.occlusion_texture,
            &self.emissive_texture,
        ]
        .iter()
        .any(|texture| texture.is_some())
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            base_colour: Vec4::ONE,
            metallic: 0.0,
            roughness: 1.0,
            specular: 1.0,
            emissive: Vec3::ZERO,
            double_sided: false,
            alpha_cutoff: 0.0,
            phong: None,
            base_colour_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            occlusion_texture: None,
            emissive_texture: None,
        }
    }
}

/// One mesh with one material, placed.
#[derive(Clone, Debug)]
pub struct Part {
    /// For messages and the dashboard.
    pub name: String,
    /// Geometry, shared between copies.
    pub mesh: Arc<Mesh>,
    /// Surface (ignored for phantoms).
    pub material: Arc<Material>,
    /// Placement: may scale, and may mirror, which turns the triangles' winding round.
    pub world_from_part: DMat4,
    /// Phantoms only: the surface mirrors (a chrome ball), so shadows do not show on it.
    pub mirror: bool,
    /// Phantoms only: linear diffuse reflectance per channel, where its owner knows it.
    pub albedo: Option<Vec3>,
}

/// Everything that is drawn or casts.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// What is composited in.
    pub virtual_parts: Vec<Part>,
    /// Proxies of real things: write depth, receive shadows, show no colour of their own.
    pub phantom_parts: Vec<Part>,
    /// World height of the ground phantom, if there is one (plane z = height).
    pub ground_height: Option<f64>,
    /// Lamps that exist in the picture only.
    pub lamps: Vec<VirtualLight>,
    /// Shadowing planes that are placed by hand.
    pub planes: Vec<ShadowingPlane>,
    /// What of it moves; its parts stand here where they are at the beginning.
    pub motions: Motions,
    /// What is to be told about it, where all of it can be shown nevertheless.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Whether a virtual part has Phong's lobe, for which the environment must be filtered.
    #[must_use]
    pub fn has_phong(&self) -> bool {
        let mut materials = self.virtual_parts.iter().map(|p| &p.material);
        materials.any(|m| m.phong.is_some())
    }
}
