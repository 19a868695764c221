//! Area lamps as visible objects: rectangles that show their pictures while they shine. They cast
//! no shadows, because a lamp would block its own light.

use super::bindings::group_of;
use super::cover::Corners;
use super::gpu_data::VirtualPartUniform;
use super::mesh_buffers::{index_buffer, vertex_buffer};
use crate::compiled::Device;
use glam::{Mat4, Vec3, Vec4};
use penumbra_scene::VirtualLight;
use penumbra_scene::photometric::{luminance, mean_colour};
use penumbra_scene::{Material, PlacedArea, PlacedLamp, primitives};

/// Distance of the dark back of a lamp behind its front, metres.
const THICKNESS_METRES: f32 = 1e-3;
/// Reflectance of the back.
const BACK_ALBEDO: f32 = 0.05;

/// A visible lamp of the scene.
struct Emitter {
    /// Index among the scene's lamps.
    lamp: usize,
    material: wgpu::BindGroup,
    /// Mean luminance of its picture; white is 1.
    mean: f32,
}

/// The visible area lamps of a scene.
pub struct Emitters {
    each: Vec<Emitter>,
    plain: wgpu::BindGroup,
    /// The front, then the back with a mirrored picture.
    vertices: [wgpu::Buffer; 2],
    pub indices: wgpu::Buffer,
    buffer: wgpu::Buffer,
    pub uniforms: wgpu::BindGroup,
    shown: Vec<PlacedLamp>,
    draws: Vec<(usize, usize)>,
    staging: Vec<VirtualPartUniform>,
}

impl Emitters {
    /// Uploads the visible ones of `lamps`; `bind` makes the bindings of a material.
    pub fn new(
        device: &Device,
        part: &wgpu::BindGroupLayout,
        lamps: &[VirtualLight],
        bind: impl Fn(&Material) -> wgpu::BindGroup,
    ) -> Self {
        let each = lamps.iter().enumerate().filter_map(|(lamp, light)| {
            let screen = light.screen.as_ref().filter(|screen| screen.visible)?;
            let texture = screen.texture.as_deref();
            Some(Emitter {
                lamp,
                mean: texture.map_or(1.0, |t| luminance(mean_colour(t)).max(1e-6)),
                material: bind(&Material {
                    emissive_texture: screen.texture.clone(),
                    ..Material::default()
                }),
            })
        });
        let each: Vec<_> = each.collect();
        let front = primitives::plane(2.0, 2.0);
        let mut back = front.clone();
        for vertex in &mut back.vertices {
            vertex.uv.x = 1.0 - vertex.uv.x;
        }
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("emitters"),
            size: (2 * each.len().max(1) * size_of::<VirtualPartUniform>()) as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let vertices = |mesh: &penumbra_scene::Mesh| {
            vertex_buffer(device, bytemuck::cast_slice(&mesh.vertices))
        };
        Self {
            plain: bind(&Material::default()),
            vertices: [vertices(&front), vertices(&back)],
            indices: index_buffer(device, &front.indices),
            uniforms: group_of::<VirtualPartUniform>(device, "emitters", part, &buffer),
            shown: Vec::with_capacity(each.len()),
            draws: Vec::with_capacity(2 * each.len()),
            staging: Vec::with_capacity(2 * each.len()),
            buffer,
            each,
        }
    }

    /// Places the visible ones of `lamps` in this frame.
    pub fn place(&mut self, queue: &wgpu::Queue, lamps: &[PlacedLamp]) {
        if self.each.is_empty() {
            return;
        }
        self.shown.clear();
        self.draws.clear();
        self.staging.clear();
        for lamp in lamps {
            let Some(area) = lamp.area else { continue };
            let of_lamp = |e: &Emitter| e.lamp == area.screen;
            let Some(i) = self.each.iter().position(of_lamp) else {
                continue;
            };
            let light = lamp.intensity / (area.size() * self.each[i].mean).max(1e-12);
            let back = if area.two_sided { light } else { Vec3::ZERO };
            self.staging.push(uniform(lamp, &area, 1.0, light));
            self.staging.push(uniform(lamp, &area, -1.0, back));
            self.draws.extend([(i, 0), (i, 1)]);
            self.shown.push(*lamp);
        }
        if !self.staging.is_empty() {
            queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&self.staging));
        }
    }

    /// Boxes around the lamps in this frame.
    pub fn boxes(&self) -> impl Iterator<Item = Corners> {
        self.shown.iter().filter_map(|lamp| {
            let corners = lamp.area?.corners(lamp.position);
            Some(std::array::from_fn(|i| corners[i % 4].as_dvec3()))
        })
    }

    /// Vertices and material of each rectangle, in the order of their uniforms.
    pub fn draws(&self) -> impl Iterator<Item = (&wgpu::Buffer, &wgpu::BindGroup)> {
        self.draws.iter().zip(&self.staging).map(|((i, side), of)| {
            let dark = of.emissive == [0.0; 4];
            let material = if dark {
                &self.plain
            } else {
                &self.each[*i].material
            };
            (&self.vertices[*side], material)
        })
    }
}

/// The uniform of a side of the rectangle: 1 = the front, -1 = the back.
fn uniform(lamp: &PlacedLamp, area: &PlacedArea, side: f32, light: Vec3) -> VirtualPartUniform {
    let normal = lamp.direction * side;
    let middle = lamp.position + (side - 1.0) * 0.5 * THICKNESS_METRES * lamp.direction;
    let world = Mat4::from_cols(
        (area.half_right * side).extend(0.0),
        area.half_up.extend(0.0),
        normal.extend(0.0),
        middle.extend(1.0),
    );
    let albedo = if light == Vec3::ZERO {
        BACK_ALBEDO
    } else {
        0.0
    };
    VirtualPartUniform {
        world_from_part: world.to_cols_array_2d(),
        normal_from_part: world.inverse().transpose().to_cols_array_2d(),
        base_colour: Vec4::new(albedo, albedo, albedo, 1.0).to_array(),
        surface: [0.0, 1.0, 0.0, 0.0],
        emissive: light.extend(0.0).to_array(),
        phong: [-1.0; 4],
        ..VirtualPartUniform::default()
    }
}
