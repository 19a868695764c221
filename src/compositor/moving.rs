//! Moving parts: their placement in this frame, as drawn parts and as shadow casters.

use super::caster_hull::CasterHull;
use super::cover::{Corners, corners};
use super::gpu_data::{CasterPlaceUniform, VirtualPartUniform};
use super::mesh_buffers::{MeshBuffers, matrices};
use glam::{DMat4, DVec3, Mat4, Vec3};
use penumbra_scene::{Motion, Part};
use std::mem::offset_of;

/// A moving part.
pub struct MovingPart {
    /// Index among the scene's virtual parts.
    pub index: usize,
    pub motion: Motion,
    /// Placement in the frame that was drawn last.
    pub world: DMat4,
    /// The caster, in its own frame.
    pub caster: Option<MeshBuffers>,
    /// The outermost points of the caster, in its own frame.
    pub hull: Vec<Vec3>,
    /// The box around the part, in its own frame.
    pub corners: Option<Corners>,
}

/// Placements of casters. The first is the world itself, for all static casters.
pub struct CasterPlaces {
    buffer: wgpu::Buffer,
    pub group: wgpu::BindGroup,
}

impl CasterPlaces {
    pub const fn new(buffer: wgpu::Buffer, group: wgpu::BindGroup) -> Self {
        Self { buffer, group }
    }

    /// The contents of the buffer for `moving` parts.
    pub fn contents(moving: &[MovingPart]) -> Vec<CasterPlaceUniform> {
        let world = std::iter::once(DMat4::IDENTITY);
        let all = world.chain(moving.iter().map(|m| m.world));
        all.map(|m| CasterPlaceUniform::new(m.as_mat4())).collect()
    }

    /// Uploads the placement of moving part `number`.
    fn write(&self, queue: &wgpu::Queue, number: usize, world: Mat4) {
        let at = CasterPlaceUniform::offset(number as u32 + 1);
        let placed = CasterPlaceUniform::new(world);
        queue.write_buffer(&self.buffer, u64::from(at), bytemuck::bytes_of(&placed));
    }
}

impl MovingPart {
    /// Creates part `index` with `caster`; the points of the hull are chosen at its initial
    /// placement.
    pub fn new(
        index: usize,
        motion: Motion,
        part: &Part,
        caster: &Part,
        buffers: Option<MeshBuffers>,
    ) -> Self {
        let own = |p: &Part| -> Vec<Vec3> { p.mesh.vertices.iter().map(|v| v.position).collect() };
        let points = own(caster);
        let place = |p: &Vec3| {
            let at = caster.world_from_part.transform_point3(p.as_dvec3());
            at.as_vec3().to_array()
        };
        let placed: Vec<[f32; 3]> = points.iter().map(place).collect();
        let outermost = CasterHull::outermost(&placed);
        let drawn = own(part).into_iter().map(|p| p.as_dvec3());
        Self {
            index,
            motion,
            world: part.world_from_part,
            caster: buffers,
            hull: outermost
                .into_iter()
                .filter_map(|i| points.get(i).copied())
                .collect(),
            corners: corners(drawn, DMat4::IDENTITY),
        }
    }

    /// The box around the part, world.
    pub fn placed_corners(&self) -> Option<Corners> {
        self.corners
            .map(|corners| corners.map(|c: DVec3| self.world.transform_point3(c)))
    }
}

/// Uploads the current placement of moving part `number`.
pub fn upload(
    queue: &wgpu::Queue,
    part: &MovingPart,
    number: usize,
    (uniforms, places): (&wgpu::Buffer, &CasterPlaces),
) {
    places.write(queue, number, part.world.as_mat4());
    let placed: [[[f32; 4]; 4]; 2] = matrices(part.world).into();
    // The matrices are the first two fields of a part.
    const { assert!(offset_of!(VirtualPartUniform, world_from_part) == 0) };
    const { assert!(offset_of!(VirtualPartUniform, normal_from_part) == size_of::<Mat4>()) };
    let at = (size_of::<VirtualPartUniform>() * part.index) as u64;
    queue.write_buffer(uniforms, at, bytemuck::cast_slice(&placed));
}
