//! Meshes, materials, and the scene that holds them.

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
    /// Unit tangent and handedness as in glTF; zero without a normal map.
    pub tangent: Vec4,
}

/// Indexed triangles, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners.
    pub vertices: Vec<Vertex>,
    /// Three per triangle, each less than `vertices.len()`.
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

/// Phong's model instead of metallic-roughness: diffuse reflection by the base colour, and the
/// energy-normalised lobe of Lafortune and Willems (1994) about the mirror direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    /// Linear RGB: share of the light that the lobe reflects at normal incidence. Its sum with the
    /// base colour is at most 1.
    pub specular: Vec3,
    /// Exponent of the cosine, 0..=10 000.
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
    /// Specular factor of dielectrics, 0..=1 (1 = F0 of 4 %); KHR_materials_specular's
    /// `specularFactor` times the luminance of `specularColorFactor`.
    pub specular: f32,
    /// Linear RGB radiance, scene camera units.
    pub emissive: Vec3,
    /// Whether both sides are rendered.
    pub double_sided: bool,
    /// Minimum alpha of visible texels; 0 = opaque.
    pub alpha_cutoff: f32,
    /// Replaces metallic, roughness and specular.
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
    /// Whether a texture varies any of its properties.
    #[must_use]
    pub fn is_textured(&self) -> bool {
        self.textures().next().is_some()
    }

    /// Its textures.
    pub fn textures(&self) -> impl Iterator<Item = &Arc<SceneTexture>> {
        let textures = [
            &self.base_colour_texture,
            &self.metallic_roughness_texture,
            &self.normal_texture,
            &self.occlusion_texture,
            &self.emissive_texture,
        ];
        textures.into_iter().flatten()
    }
}

impl Material {
    /// Mean linear base colour over the texture.
    #[must_use]
    pub fn mean_base_colour(&self) -> Vec3 {
        let texture = self.base_colour_texture.as_deref();
        self.base_colour.truncate() * texture.map_or(Vec3::ONE, mean_colour)
    }
}

/// Mean linear colour of an sRGB texture, from at most 64² of its texels.
fn mean_colour(texture: &SceneTexture) -> Vec3 {
    let texels = texture.rgba.len() / 4;
    let step = (texels / 4096).max(1);
    let linear = |c: u8| penumbra_camera::linear_from_srgb(f32::from(c) / 255.0);
    let colours = texture.rgba.chunks_exact(4).step_by(step);
    let (sum, count) = colours.fold((Vec3::ZERO, 0.0f32), |(sum, n), c| {
        (
            sum + Vec3::new(linear(c[0]), linear(c[1]), linear(c[2])),
            n + 1.0,
        )
    });
    sum / count.max(1.0)
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

/// One mesh with one material in the world.
#[derive(Clone, Debug)]
pub struct Part {
    /// For messages and the dashboard.
    pub name: String,
    /// Geometry, shared between copies.
    pub mesh: Arc<Mesh>,
    /// Surface (ignored for phantoms).
    pub material: Arc<Material>,
    /// Pose; may scale, and may mirror, which reverses the triangles' winding.
    pub world_from_part: DMat4,
    /// Phantoms only: whether the surface is a mirror, on which shadows are invisible.
    pub mirror: bool,
    /// Phantoms only: linear diffuse reflectance per channel, if known.
    pub albedo: Option<Vec3>,
}
