//! Reflectance of a virtual part for indirect light.

use crate::mesh::Material;
use glam::Vec3;
use penumbra_lighting::lobes;
use penumbra_lighting::lobes::Family;

/// F0 of dielectrics with a refractive index of 1.5.
const DIELECTRIC: f32 = 0.04;
/// Minimum width of a specular lobe: a few rays do not resolve narrower ones.
const MIN_GLOSS: f32 = 0.05;

/// F0 above which surfaces mirror visibly onto others: metals, and no dielectric of the usual
/// refractive indices.
const GLOSSY: f32 = 0.1;

/// A part's material, averaged over its textures.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    pub diffuse: Vec3,
    pub f0: Vec3,
    /// Width of the specular lobe.
    pub gloss: f32,
    pub emissive: Vec3,
}

impl Surface {
    /// Whether it mirrors enough that a reflected ray makes a difference on other surfaces.
    pub fn is_glossy(&self) -> bool {
        self.f0.max_element() > GLOSSY
    }

    pub fn from_material(material: &Material) -> Self {
        let base = material.mean_base_colour();
        let metallic = material.metallic.clamp(0.0, 1.0);
        let dielectric = DIELECTRIC * material.specular;
        if let Some(phong) = &material.phong {
            let parameter = lobes::phong_parameter(phong.exponent);
            return Self {
                diffuse: base,
                f0: phong.specular,
                gloss: lobes::own_width(Family::Phong, parameter).max(MIN_GLOSS),
                emissive: material.emissive,
            };
        }
        Self {
            diffuse: base * (1.0 - metallic) * (1.0 - dielectric),
            f0: Vec3::splat(dielectric).lerp(base, metallic),
            gloss: lobes::own_width(Family::Ggx, material.roughness).max(MIN_GLOSS),
            emissive: material.emissive,
        }
    }
}
