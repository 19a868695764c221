//! The light on the GPU: the uniforms of the frame, the lights with tables of their sums, indirect
//! light and virtual lights.

use super::bindings::{Slot, group, layout, sampler, view};
use super::caster_hull::CasterHull;
use super::gloss_maps::GlossMaps;
use super::gpu_data::{FrameUniform, LightUniform};
use super::indirect_light_maps::IndirectLightMaps;
use super::lamp_maps::LampMaps;
use super::lamp_screens::LampScreens;
use super::shaders::MAX_LIGHTS;
use super::surface_light::CacheTextures;
use super::texels::{half_texel, write_level};
use super::textures::format;
use crate::compiled::Device;
use glam::Vec3;
use half::f16;
use penumbra_scene::{IndirectLight, PlacedLamp};

/// Texels a side of the tables of irradiance by normal.
pub const BY_NORMAL: u32 = 33;

/// The bindings of the frame, in the order of [`FrameParts::group`].
const FRAME_SLOTS: [Slot; 15] = [
    Slot::Uniform,
    Slot::Uniform,
    Slot::Texture,
    Slot::Texture,
    Slot::Sampler,
    Slot::Texture,
    Slot::Volume,
    Slot::Uniform,
    Slot::DepthArray,
    Slot::Comparison,
    Slot::Layers,
    Slot::Integer,
    Slot::Texture,
    Slot::Texture,
    Slot::Volume,
];

/// The light of a frame on the GPU.
pub struct LightMaps {
    pub frame_layout: wgpu::BindGroupLayout,
    pub frame_group: wgpu::BindGroup,
    pub gloss: GlossMaps,
    indirect: IndirectLightMaps,
    pub lamps: LampMaps,
    screens: wgpu::TextureView,
    cache: CacheTextures,
    frame: wgpu::Buffer,
    lights: wgpu::Buffer,
    /// Irradiance by normal, of all lights and of compact sources.
    tables: [wgpu::Texture; 2],
    smooth: wgpu::Sampler,
    staging: Vec<LightUniform>,
    previous: Vec<LightUniform>,
    texels: Vec<[f16; 4]>,
}

impl LightMaps {
    /// Allocates buffers for `budget` lights.
    pub fn new(device: &Device, budget: u32) -> Self {
        let frame_layout = layout(device, "frame", &FRAME_SLOTS);
        let buffer = |size: usize, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("frame"),
                size: size as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let frame = buffer(size_of::<FrameUniform>(), wgpu::BufferUsages::UNIFORM);
        let lights = buffer(
            size_of::<LightUniform>() * MAX_LIGHTS as usize,
            wgpu::BufferUsages::UNIFORM,
        );
        let tables = ["all lights", "compact lights"].map(|label| table(device, label, BY_NORMAL));
        let smooth = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("table"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let indirect = IndirectLightMaps::new(device);
        let lamps = LampMaps::new(device);
        let screens = no_screens(device);
        let cache = CacheTextures::none(device);
        let parts = FrameParts {
            buffers: [&frame, &lights],
            tables: &tables,
            smooth: &smooth,
            indirect: &indirect,
            lamps: &lamps,
            screens: &screens,
            cache: &cache,
        };
        let frame_group = parts.group(device, &frame_layout);
        Self {
            frame_layout,
            frame_group,
            gloss: GlossMaps::new(device),
            indirect,
            lamps,
            screens,
            cache,
            frame,
            lights,
            tables,
            smooth,
            staging: Vec::with_capacity(budget as usize),
            previous: Vec::with_capacity(budget as usize),
            texels: Vec::new(),
        }
    }

    /// Uploads this frame's uniforms and lights.
    pub fn write_frame(
        &mut self,
        queue: &wgpu::Queue,
        frame: &FrameUniform,
        lights: impl Iterator<Item = LightUniform>,
    ) {
        queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        self.staging.clear();
        self.staging.extend(lights);
        if self.staging == self.previous {
            return;
        }
        if !self.staging.is_empty() {
            queue.write_buffer(&self.lights, 0, bytemuck::cast_slice(&self.staging));
        }
        self.write_tables(queue);
        std::mem::swap(&mut self.previous, &mut self.staging);
    }

    fn write_tables(&mut self, queue: &wgpu::Queue) {
        for (texture, least) in self.tables.iter().zip([0.0, 0.5]) {
            self.texels.clear();
            let counted = || self.staging.iter().filter(|l| l.irradiance[3] >= least);
            self.texels.extend((0..BY_NORMAL * BY_NORMAL).map(|i| {
                let n = normal_of_texel(i % BY_NORMAL, i / BY_NORMAL);
                half_texel(irradiance_on(n, counted()).to_array())
            }));
            write_level(queue, texture, 0, BY_NORMAL, 1, &self.texels);
        }
    }

    /// Uploads the virtual lights of this frame; see [`LampMaps::write`].
    pub fn write_lamps(
        &mut self,
        device: &Device,
        queue: &wgpu::Queue,
        lamps: (&[PlacedLamp], &LampScreens),
        casters: (&CasterHull, u64),
        size: u32,
    ) {
        if self.lamps.write(device, queue, lamps, casters, size) {
            self.regroup(device);
        }
    }

    /// Binds the pictures of the scene's area lamps.
    pub fn bind_screens(&mut self, device: &Device, screens: &LampScreens) {
        self.screens = screens.view.clone();
        self.lamps.forget_uniform();
        self.regroup(device);
    }

    /// Binds the surface cache.
    pub fn bind_cache(&mut self, device: &Device, cache: CacheTextures) {
        self.cache = cache;
        self.regroup(device);
    }

    /// The surface cache's textures, for another set of light maps.
    pub fn take_cache(&mut self, device: &Device) -> CacheTextures {
        std::mem::replace(&mut self.cache, CacheTextures::none(device))
    }

    fn regroup(&mut self, device: &Device) {
        let parts = FrameParts {
            buffers: [&self.frame, &self.lights],
            tables: &self.tables,
            smooth: &self.smooth,
            indirect: &self.indirect,
            lamps: &self.lamps,
            screens: &self.screens,
            cache: &self.cache,
        };
        self.frame_group = parts.group(device, &self.frame_layout);
    }

    /// Uploads the light that virtual objects reflect onto the real scene.
    pub fn write_indirect(&mut self, queue: &wgpu::Queue, light: &IndirectLight) {
        self.indirect.write(queue, light, &mut self.texels);
    }
}

/// The resources that every pass binds.
struct FrameParts<'a> {
    buffers: [&'a wgpu::Buffer; 2],
    tables: &'a [wgpu::Texture; 2],
    smooth: &'a wgpu::Sampler,
    indirect: &'a IndirectLightMaps,
    lamps: &'a LampMaps,
    screens: &'a wgpu::TextureView,
    cache: &'a CacheTextures,
}

/// Creates a placeholder for the pictures of area lamps before there is a scene.
fn no_screens(device: &Device) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("no lamp screens"),
        size: wgpu::Extent3d {
            width: 1,
            height: 1,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: format::LIGHT,
        usage: wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

impl FrameParts<'_> {
    fn group(&self, device: &Device, layout: &wgpu::BindGroupLayout) -> wgpu::BindGroup {
        let views = self
            .tables
            .each_ref()
            .map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        let [table, first, second] = self.cache.bindings();
        let resources = [
            self.buffers[0].as_entire_binding(),
            self.buffers[1].as_entire_binding(),
            view(&views[0]),
            view(&views[1]),
            sampler(self.smooth),
            view(&self.indirect.ground_view),
            view(&self.indirect.volume_view),
            self.lamps.uniform.as_entire_binding(),
            view(&self.lamps.array),
            sampler(&self.lamps.compare),
            view(self.screens),
            table,
            first,
            second,
            view(&self.indirect.on_surfaces_view),
        ];
        group(device, "frame", layout, &resources)
    }
}

/// Unshadowed irradiance of all distant `lights` on a surface with normal `n`.
fn irradiance_on<'a>(n: Vec3, lights: impl Iterator<Item = &'a LightUniform>) -> Vec3 {
    let far = lights.filter(|l| l.place[3] == 0.0);
    far.map(|l| Vec3::from_slice(&l.irradiance) * Vec3::from_slice(&l.direction).dot(n).max(0.0))
        .sum()
}

fn table(device: &Device, label: &str, side: u32) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Unit normal of a texel of the octahedral tables; twin of `normal_from_octahedron`. The
/// side is odd, so that +Z and the horizon's axes fall on texels.
fn normal_of_texel(x: u32, y: u32) -> Vec3 {
    let at = |k: u32| 2.0 * k as f32 / (BY_NORMAL - 1) as f32 - 1.0;
    let (px, py) = (at(x), at(y));
    let mut n = Vec3::new(px, py, 1.0 - px.abs() - py.abs());
    let t = (-n.z).max(0.0);
    n.x -= t.copysign(n.x);
    n.y -= t.copysign(n.y);
    n.normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twin of WGSL `octahedron_from_normal`.
    fn octahedron(n: Vec3) -> [f32; 2] {
        let sum = n.abs().element_sum();
        let (x, y) = (n.x / sum, n.y / sum);
        let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
        if n.z >= 0.0 {
            [x, y]
        } else {
            [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)]
        }
    }

    /// The table as the shaders read it: bilinear interpolation between texels.
    fn from_table(n: Vec3, lights: &[LightUniform]) -> Vec3 {
        let last = (BY_NORMAL - 1) as f32;
        let [x, y] = octahedron(n).map(|p| (0.5 * p + 0.5) * last);
        let texel = |dx: u32, dy: u32| {
            let at = |v: f32, d: u32| (v as u32 + d).min(BY_NORMAL - 1);
            irradiance_on(normal_of_texel(at(x, dx), at(y, dy)), lights.iter())
        };
        let rows = [0, 1].map(|dy| texel(0, dy).lerp(texel(1, dy), x.fract()));
        rows[0].lerp(rows[1], y.fract())
    }

    fn spread(count: u32) -> impl Iterator<Item = Vec3> {
        (0..count).map(move |i| {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
            let (sin, cos) = (2.4 * i as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * cos, r * sin, z)
        })
    }

    #[test]
    fn irradiance_tables_match_direct_sums() {
        let lights: Vec<_> = spread(48)
            .map(|d| LightUniform {
                direction: d.extend(0.1).to_array(),
                irradiance: [1.0 + d.x, 1.0, 1.0 - d.y, 0.0],
                ..LightUniform::default()
            })
            .collect();
        for n in spread(500) {
            let direct = irradiance_on(n, lights.iter());
            let error = (from_table(n, &lights) - direct) / direct;
            assert!(error.abs().max_element() < 0.015, "{n}: {error}");
        }
        // The error for a single light is largest at grazing incidence.
        for n in spread(500) {
            let direct = irradiance_on(n, lights[7..8].iter()).x;
            let error = from_table(n, &lights[7..8]).x - direct;
            assert!(error.abs() < 0.04 * lights[7].irradiance[0], "{n}: {error}");
        }
    }

    #[test]
    fn table_is_exact_at_the_axes() {
        let light = LightUniform {
            direction: [0.6, 0.0, 0.8, 0.0],
            irradiance: [1.0, 2.0, 3.0, 1.0],
            ..LightUniform::default()
        };
        for n in [
            Vec3::Z,
            Vec3::X,
            Vec3::Y,
            Vec3::NEG_X,
            Vec3::NEG_Y,
            Vec3::NEG_Z,
        ] {
            let error = from_table(n, &[light]) - irradiance_on(n, [light].iter());
            assert!(error.abs().max_element() < 1e-6, "{n}: {error}");
        }
    }
}
