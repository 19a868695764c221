//! The finished picture as it looks from where the eye is when it is seen.
//!
//! A picture is composed for the instant it was taken at, so that real and virtual agree.
//! Until it is seen the camera has moved on. So the whole of it is turned to the pose that is
//! expected by then, as if it hung on a wall before the camera, as far away as the virtual
//! objects: right for every turn of the head, and for its way at that distance (late
//! reprojection, as in van Waveren's "The asynchronous time warp for virtual reality on
//! consumer hardware", 2016). What came into view meanwhile was in no picture: there the
//! edge goes on.

use super::Compositor;
use super::bindings::{PipelineSpec, Slot, group, layout, view};
use super::lens::{direction_places, reach};
use super::passes::cover;
use super::shaders::{self, Variant};
use super::targets::{Target, format};
use super::timing::Timer;
use super::{LensOutput, frame::FrameInput};
use glam::{DMat3, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use wgpu::TextureUsages as U;

/// From where a finished picture is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reprojection {
    /// Pose of the eye in the camera that the picture was composed for, metres.
    pub camera_from_eye: RigidTransform,
    /// Distance of the wall that the picture hangs on, along the eye's axis, metres.
    pub depth: f64,
}

impl Reprojection {
    /// Takes a direction (x, y, 1) of the eye to one of the camera, up to its length:
    /// `R + t (0, 0, 1) / depth`.
    #[must_use]
    pub fn camera_from_eye_directions(&self) -> DMat3 {
        let mut turn = DMat3::from_quat(self.camera_from_eye.rotation);
        turn.z_axis += self.camera_from_eye.translation / self.depth;
        turn
    }
}

/// What turns pictures of one camera.
pub(super) struct ReprojectStage {
    camera: PinholeCamera,
    /// Squared tangent up to which its lens' model holds.
    reach: f64,
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    directions: Target,
    uniform: wgpu::Buffer,
    pub output: Target,
}

impl ReprojectStage {
    /// For finished pictures that are `camera`'s.
    fn new(gpu: (&wgpu::Device, &wgpu::Queue), camera: PinholeCamera) -> Self {
        let (device, _) = gpu;
        let module = shaders::module(device, "reproject", Variant::PLAIN);
        let f = Slot::Unfilterable;
        let layout = layout(device, "reproject", &[f, f, Slot::Uniform]);
        let pipeline = PipelineSpec {
            label: "reproject",
            module: &module,
            groups: &[&layout],
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
            directions: direction_places(gpu, &camera),
            output: Target::new(device, "reprojected", size, format::OUTPUT, usage),
            reach: if straight { 1e30 } else { reach(&camera) },
            camera,
            pipeline,
            layout,
            uniform,
        }
    }

    /// Binds the picture that is turned.
    pub fn bind(&self, device: &wgpu::Device, picture: &wgpu::TextureView) -> wgpu::BindGroup {
        let bound = [
            view(picture),
            view(&self.directions.view),
            self.uniform.as_entire_binding(),
        ];
        group(device, "reproject", &self.layout, &bound)
    }

    /// Records the pass.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        inputs: &wgpu::BindGroup,
    ) {
        let span = timer.span("reproject", true, true);
        let to = &self.output.view;
        cover(encoder, "reproject", to, span, &self.pipeline, &[inputs]);
    }

    fn upload(&self, queue: &wgpu::Queue, reprojection: &Reprojection) {
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
    bending: [f32; 4],
    more: [f32; 4],
}

impl Uniform {
    fn new(reprojection: &Reprojection, camera: &PinholeCamera, reach: f64) -> Self {
        let turn = reprojection.camera_from_eye_directions();
        let column = |c: DVec3| c.extend(0.0).as_vec4().to_array();
        let [k1, k2, p1, p2, k3] = camera.distortion;
        let (f, c) = (camera.focal, camera.centre);
        let floats = |row: [f64; 4]| row.map(|v| v as f32);
        Self {
            directions: [turn.x_axis, turn.y_axis, turn.z_axis].map(column),
            intrinsics: floats([f.x, f.y, c.x, c.y]),
            bending: floats([k1, k2, k3, p1]),
            more: floats([p2, reach, 0.0, 0.0]),
        }
    }
}

impl Compositor {
    /// Turns the pictures to come to where they are seen from; `None` shows them as they were
    /// taken.
    pub const fn set_reprojection(&mut self, reprojection: Option<Reprojection>) {
        self.reprojection = reprojection;
    }

    /// Makes the stage when it is first wanted, and anew for another camera.
    pub(super) fn fit_reprojection(&mut self, input: &FrameInput<'_>) {
        let Some(reprojection) = &self.reprojection else {
            return;
        };
        let camera = input.camera;
        let distortion = match self.lens_output {
            LensOutput::Camera => camera.distortion,
            LensOutput::Undistorted => [0.0; 5],
        };
        let suits = self.reproject.as_ref().is_some_and(|stage| {
            let made = &stage.camera;
            made.distortion == distortion
                && (made.width, made.height) == (camera.width, camera.height)
                && (made.focal, made.centre) == (camera.focal, camera.centre)
        });
        if !suits {
            let shown = PinholeCamera {
                distortion,
                ..camera.clone()
            };
            let gpu = (&self.gpu.device, &self.gpu.queue);
            self.reproject = Some(ReprojectStage::new(gpu, shown).into());
            self.sized = None;
        }
        if let Some(stage) = &self.reproject {
            stage.upload(&self.gpu.queue, reprojection);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec2};

    #[test]
    fn a_point_on_the_wall_is_found_where_the_camera_saw_it() {
        let reprojection = Reprojection {
            camera_from_eye: RigidTransform::new(
                DQuat::from_rotation_y(0.05) * DQuat::from_rotation_x(-0.02),
                DVec3::new(0.03, -0.01, 0.02),
            ),
            depth: 0.8,
        };
        let turn = reprojection.camera_from_eye_directions();
        for direction in [DVec2::ZERO, DVec2::new(0.3, -0.2), DVec2::new(-0.1, 0.4)] {
            let in_eye = direction.extend(1.0) * reprojection.depth;
            let in_camera = reprojection.camera_from_eye.transform_point(in_eye);
            let found = turn * direction.extend(1.0);
            let apart = found / found.z - in_camera / in_camera.z;
            assert!(apart.length() < 1e-12);
        }
    }
}
