//! Parts that move: where they stand in this frame, as they are drawn and as they cast.

use super::cover::Corners;
use super::gpu_data::VirtualPartUniform;
use super::scene_buffers::{MeshBuffers, matrices};
use super::shadow_slots::CasterHull;
use glam::{DMat4, DVec3, Mat4, Vec3};
use penumbra_scene::{Motion, Part};
use std::mem::offset_of;

/// A moving part.
pub struct MovingPart {
    /// Of the scene's virtual parts.
    pub index: usize,
    pub motion: Motion,
    /// World from it, in the frame that was drawn last.
    pub world: DMat4,
    /// As it casts, in its own frame.
    pub caster: Option<MeshBuffers>,
    /// The outermost of the caster's points, its own frame.
    pub hull: Vec<Vec3>,
    /// The box around it, its own frame.
    pub corners: Option<Corners>,
}

/// Where casters stand: the first is the world itself, for all that stands still.
pub struct CasterPlaces {
    buffer: wgpu::Buffer,
    pub group: wgpu::BindGroup,
}

/// A caster's number in the shaders' instance, above that of its light or view.
pub const CASTER_SHIFT: u32 = 12;

impl CasterPlaces {
    pub const fn new(buffer: wgpu::Buffer, group: wgpu::BindGroup) -> Self {
        Self { buffer, group }
    }

    /// Contents for `moving` parts where they are.
    pub fn contents(moving: &[MovingPart]) -> Vec<[[f32; 4]; 4]> {
        let world = std::iter::once(DMat4::IDENTITY);
        let all = world.chain(moving.iter().map(|m| m.world));
        all.map(|m| m.as_mat4().to_cols_array_2d()).collect()
    }

    /// Puts the moving part of this number elsewhere.
    fn write(&self, queue: &wgpu::Queue, number: usize, world: Mat4) {
        let size = size_of::<Mat4>();
        let at = (size * (number + 1)) as u64;
        queue.write_buffer(&self.buffer, at, bytemuck::bytes_of(&world.to_cols_array()));
    }
}

impl MovingPart {
    /// Part `index`, whose caster is `caster`; its hull is chosen where it stands at first.
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
            corners: super::cover::corners(drawn, DMat4::IDENTITY),
        }
    }

    /// The box around it, world.
    pub fn placed_corners(&self) -> Option<Corners> {
        self.corners
            .map(|corners| corners.map(|c: DVec3| self.world.transform_point3(c)))
    }
}

/// Puts `part`, the moving one of this `number`, where it is now.
pub fn upload(
    queue: &wgpu::Queue,
    part: &MovingPart,
    number: usize,
    (uniforms, places): (&wgpu::Buffer, &CasterPlaces),
) {
    places.write(queue, number, part.world.as_mat4());
    let placed: [[[f32; 4]; 4]; 2] = matrices(part.world).into();
    // They are a part's first two fields.
    const { assert!(offset_of!(VirtualPartUniform, world_from_part) == 0) };
    const { assert!(offset_of!(VirtualPartUniform, normal_from_part) == size_of::<Mat4>()) };
    let at = (size_of::<VirtualPartUniform>() * part.index) as u64;
    queue.write_buffer(uniforms, at, bytemuck::cast_slice(&placed));
}
