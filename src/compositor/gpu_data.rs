//! The data that shaders read, byte for byte. Twins of the structs in `shaders/lib/frame.wgsl`,
//! `shaders/lib/lamps.wgsl`, `shaders/lib/compact_source_specular.wgsl`,
//! `shaders/phantom_geometry.wgsl` and `shaders/virtual_geometry.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};
use penumbra_lighting::light::{CompactSourceSpecular, MAX_COMPACT_SOURCES, MAX_LEVELS};
use penumbra_lighting::place::MAX_NEAR_LIGHTS;
use penumbra_scene::lamps::MAX_LAMPS;

/// Twin of WGSL `Frame`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct FrameUniform {
    pub right: [f32; 4],
    pub down: [f32; 4],
    pub forward: [f32; 4],
    pub eye: [f32; 4],
    pub intrinsics: [f32; 4],
    pub size: [f32; 4],
    pub clip_from_world: [[f32; 4]; 4],
    pub harmonics: [[f32; 4]; 9],
    pub counts: [u32; 4],
    pub params: [f32; 4],
    pub ground: [f32; 4],
    pub tiling: [u32; 4],
    pub indirect_low: [f32; 4],
    pub indirect_high: [f32; 4],
    pub indirect_objects: [f32; 4],
    /// Lower and upper corner.
    pub on_virtual: [[f32; 4]; 2],
    pub on_real: [[f32; 4]; 2],
    pub planes_low: [f32; 4],
    pub planes_high: [f32; 4],
    pub brightest: [f32; 4],
    pub rotation_per_row: [f32; 4],
    pub translation_per_row: [f32; 4],
    pub distortion: [f32; 4],
    pub rows: [f32; 4],
    pub vignetting: [f32; 4],
    pub vignetting_intrinsics: [f32; 4],
    pub near_lights: [NearLightUniform; MAX_NEAR_LIGHTS],
}

/// Twin of WGSL `Light`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LightUniform {
    pub right: [f32; 4],
    pub up: [f32; 4],
    pub direction: [f32; 4],
    pub irradiance: [f32; 4],
    pub place: [f32; 4],
    pub virtual_fit: [f32; 4],
    pub phantom_fit: [f32; 4],
    pub depths: [f32; 4],
    pub more: [f32; 4],
}

/// Twin of WGSL `NearLight`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct NearLightUniform {
    pub place: [f32; 4],
    pub irradiance: [f32; 4],
}

/// Twin of WGSL `Lamp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LampUniform {
    pub position: [f32; 4],
    pub direction: [f32; 4],
    pub intensity: [f32; 4],
    pub right: [f32; 4],
    pub up: [f32; 4],
    pub forward: [f32; 4],
    pub half_right: [f32; 4],
    pub half_up: [f32; 4],
}

/// Twin of WGSL `Lamps`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LampsUniform {
    pub count: [u32; 4],
    pub each: [LampUniform; MAX_LAMPS],
}

/// Twin of WGSL `CompactSource`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct CompactSourceUniform {
    pub direction: [f32; 4],
    pub flux: [f32; 4],
    pub place: [f32; 4],
    pub weights: [f32; MAX_LEVELS],
}

/// Twin of WGSL `CompactSources`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct CompactSourcesUniform {
    pub count: [u32; 4],
    pub each: [CompactSourceUniform; MAX_COMPACT_SOURCES],
}

impl CompactSourcesUniform {
    /// The uniform of the first [`MAX_COMPACT_SOURCES`] sources.
    pub fn new(sources: &[CompactSourceSpecular]) -> Self {
        let mut all = Self::default();
        for (to, from) in all.each.iter_mut().zip(sources) {
            *to = CompactSourceUniform {
                direction: from.direction.extend(from.radius).to_array(),
                flux: from.flux.extend(0.0).to_array(),
                place: (from.place.towards(from.direction, Vec3::ZERO))
                    .extend(from.place.inverse_distance)
                    .to_array(),
                weights: from.weights,
            };
            all.count[0] += 1;
        }
        all
    }
}

/// Twin of WGSL `VirtualPart`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct VirtualPartUniform {
    pub world_from_part: [[f32; 4]; 4],
    pub normal_from_part: [[f32; 4]; 4],
    pub base_colour: [f32; 4],
    pub surface: [f32; 4],
    pub emissive: [f32; 4],
    pub phong: [f32; 4],
    /// Offsets of uniforms are multiples of 256 bytes.
    pub unused: [[f32; 4]; 4],
}

impl VirtualPartUniform {
    /// The dynamic offset of part `number` in a buffer of parts.
    pub const fn offset(number: u32) -> u32 {
        const { assert!(size_of::<Self>() == 256) };
        number * size_of::<Self>() as u32
    }
}

/// Placement of a caster.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CasterPlaceUniform {
    pub world_from_caster: [[f32; 4]; 4],
    /// Offsets of uniforms are multiples of 256 bytes.
    pub unused: [[f32; 4]; 12],
}

impl CasterPlaceUniform {
    pub fn new(world: Mat4) -> Self {
        Self {
            world_from_caster: world.to_cols_array_2d(),
            unused: [[0.0; 4]; 12],
        }
    }

    /// The dynamic offset of caster `number` in a buffer of placements.
    pub const fn offset(number: u32) -> u32 {
        const { assert!(size_of::<Self>() == 256) };
        number * size_of::<Self>() as u32
    }
}

/// Twin of WGSL `PhantomPart`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PhantomPartUniform {
    pub world_from_part: [[f32; 4]; 4],
    pub normal_from_part: [[f32; 4]; 4],
    pub kind: [f32; 4],
}
