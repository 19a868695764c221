//! Late reprojection: the finished picture as seen from the pose at which it is displayed.
//!
//! A picture is composed for the instant at which it was taken, so that real and virtual objects
//! are registered. By the time it is displayed, the camera has moved. The picture is therefore
//! warped to the pose predicted for that time, as a plane in front of the camera at the distance of
//! the virtual objects: correct for every rotation of the head, and for its translation at that
//! distance (van Waveren, "The asynchronous time warp for virtual reality on consumer hardware",
//! 2016). Areas that have come into view since then are missing: the edge is repeated there.

use super::bindings::{CachedGroup, PipelineSpec, Slot, view};
use super::lens::{direction_texture, reach};
use super::recorder::Recorder;
use super::shaders::{self, Variant};
use super::textures::{FrameTexture, format};
use crate::compiled::Device;
use glam::{DMat3, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use wgpu::TextureUsages as U;

/// The pose from which a finished picture is viewed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reprojection {
    /// Pose of the eye in the frame of the camera for which the picture was composed, metres.
    pub camera_from_eye: RigidTransform,
    /// Distance of the plane of the picture along the axis of the eye, metres.
    pub depth: f64,
}

impl Reprojection {
    /// The map of directions (x, y, 1) of the eye to directions of the camera, up to their length:
    /// `R + t (0, 0, 1) / depth`.
    #[must_use]
    pub fn camera_from_eye_directions(&self) -> DMat3 {
        let mut map = DMat3::from_quat(self.camera_from_eye.rotation);
        map.z_axis += self.camera_from_eye.translation / self.depth;
        map
    }
}

/// Warps finished pictures of one camera.
pub(super) struct ReprojectStage {
    camera: PinholeCamera,
    /// Squared tangent up to which the lens model holds.
    reach: f64,
    pipeline: wgpu::RenderPipeline,
    inputs: CachedGroup,
    directions: FrameTexture,
    uniform: wgpu::Buffer,
    output: FrameTexture,
}

impl ReprojectStage {
    /// The stage for finished pictures with the size and the distortion of `camera`.
    pub fn new(gpu: (&Device, &wgpu::Queue), camera: PinholeCamera) -> Self {
        let (device, _) = gpu;
        let shader = shaders::shader("reproject", Variant::PLAIN);
        let f = Slot::Unfilterable;
        let inputs = CachedGroup::from_slots(device, "reproject", &[f, f, Slot::Uniform]);
        let pipeline = PipelineSpec {
            label: "reproject",
            shader: &shader,
            groups: &[&inputs.layout],
            vertex: "cover",
            buffers: &[],
            fragment: Some("reprojected"),
            targets: &[format::OUTPUT],
            colours: wgpu::ColorWrites::ALL,
            depth: None,
            cull: None,
            samples: 1,
        }
        .build(device);
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("reprojection"),
            size: size_of::<Uniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let size = (camera.width, camera.height);
        let straight = camera.distortion == [0.0; 5];
        let usage = U::RENDER_ATTACHMENT | U::TEXTURE_BINDING | U::COPY_SRC;
        Self {
            directions: direction_texture(gpu, &camera),
            output: FrameTexture::new(device, "reprojected", size, format::OUTPUT, usage),
            reach: if straight { 1e30 } else { reach(&camera) },
            camera,
            pipeline,
            inputs,
            uniform,
        }
    }

    /// Whether the stage was made for pictures with the size, the intrinsics and the distortion of
    /// `camera`.
    pub fn suits(&self, camera: &PinholeCamera) -> bool {
        self.camera == *camera
    }

    /// Warps `picture`.
    pub fn record<'a>(
        &'a mut self,
        r: &mut Recorder<'_>,
        picture: &FrameTexture,
    ) -> &'a FrameTexture {
        let resources = [
            view(&picture.view),
            view(&self.directions.view),
            self.uniform.as_entire_binding(),
        ];
        let inputs = self.inputs.get(r.device, &resources);
        r.cover("reproject", &self.output.view, &self.pipeline, &[inputs]);
        &self.output
    }

    /// Uploads the pose of the next frame.
    pub fn upload(&self, queue: &wgpu::Queue, reprojection: &Reprojection) {
        let uniform = Uniform::new(reprojection, &self.camera, self.reach);
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }
}

/// Twin of WGSL `Reprojection`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    directions: [[f32; 4]; 3],
    intrinsics: [f32; 4],
    distortion: [f32; 4],
    more: [f32; 4],
}

impl Uniform {
    fn new(reprojection: &Reprojection, camera: &PinholeCamera, reach: f64) -> Self {
        let map = reprojection.camera_from_eye_directions();
        let column = |c: DVec3| c.extend(0.0).as_vec4().to_array();
        let [k1, k2, p1, p2, k3] = camera.distortion;
        let (f, c) = (camera.focal, camera.centre);
        let floats = |row: [f64; 4]| row.map(|v| v as f32);
        Self {
            directions: [map.x_axis, map.y_axis, map.z_axis].map(column),
            intrinsics: floats([f.x, f.y, c.x, c.y]),
            distortion: floats([k1, k2, k3, p1]),
            more: floats([p2, reach, 0.0, 0.0]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec2};

    #[test]
    fn point_on_the_plane_maps_to_the_pixel_of_the_camera() {
        let reprojection = Reprojection {
            camera_from_eye: RigidTransform::new(
                DQuat::from_rotation_y(0.05) * DQuat::from_rotation_x(-0.02),
                DVec3::new(0.03, -0.01, 0.02),
            ),
            depth: 0.8,
        };
        let map = reprojection.camera_from_eye_directions();
        for direction in [DVec2::ZERO, DVec2::new(0.3, -0.2), DVec2::new(-0.1, 0.4)] {
            let in_eye = direction.extend(1.0) * reprojection.depth;
            let in_camera = reprojection.camera_from_eye.transform_point(in_eye);
            let found = map * direction.extend(1.0);
            let apart = found / found.z - in_camera / in_camera.z;
            assert!(apart.length() < 1e-12);
        }
    }
}
