//! What every pass knows of a frame.

use super::Compositor;
use super::frame::{FrameInput, LampResponse, NEAR, ShadowMode, clip_from_camera};
use super::gpu_data::FrameUniform;
use super::targets::TILE;
use glam::{DVec4, Vec3};
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::RigidTransform;

impl Compositor {
    /// Motion from one row of the camera's own picture to the next, `turning` and `moving` of the
    /// shaders' frame. `camera` is that of the straight picture where the lens bends.
    fn rolling_uniform(&self, camera: &PinholeCamera) -> [[f32; 4]; 2] {
        let Some(rolling) = self.rolling else {
            return [[0.0; 4]; 2];
        };
        let middle = RollingShutter::middle_row(self.own_camera(camera));
        [
            rolling.rotation_per_row.extend(middle),
            rolling.translation_per_row.extend(0.0),
        ]
        .map(|row| row.as_vec4().to_array())
    }

    /// How the camera's own picture is bent, and which row shows what: `bending` and `rows`.
    fn bending_uniform(&self, camera: &PinholeCamera) -> [[f32; 4]; 2] {
        let lens = self.lens.as_ref();
        let own = self.own_camera(camera);
        let reach = lens.map_or(f64::from(f32::MAX), |lens| lens.reach);
        let [k1, k2, p1, p2, k3] = own.distortion;
        [
            DVec4::new(k1, k2, k3, p1),
            DVec4::new(p2, own.focal.y, own.centre.y, reach),
        ]
        .map(|row| row.as_vec4().to_array())
    }

    /// How it fades towards its edge: `fading` and `fading_from`.
    fn fading_uniform(&self, camera: &PinholeCamera) -> [[f32; 4]; 2] {
        let own = self.own_camera(camera);
        let (centre, radius, [k1, k2, k3]) = match &self.fading {
            Some(fading) => (fading.centre, fading.radius, fading.coefficients),
            None => (own.centre, 1.0, [0.0; 3]),
        };
        let from = own.centre - centre;
        [
            DVec4::new(k1, k2, k3, 1.0 / (radius * radius)),
            DVec4::new(own.focal.x, own.focal.y, from.x, from.y),
        ]
        .map(|row| row.as_vec4().to_array())
    }

    /// The camera itself, where `camera` is that of the straight picture.
    pub(super) fn own_camera<'a>(&'a self, camera: &'a PinholeCamera) -> &'a PinholeCamera {
        self.lens.as_ref().map_or(camera, |lens| &lens.camera)
    }

    pub(super) fn frame_uniform(
        &self,
        input: &FrameInput<'_>,
        lights: usize,
        augmented: bool,
    ) -> FrameUniform {
        let camera = input.camera;
        // Without a pose or light the camera looks away from everything.
        let nowhere = RigidTransform::new(glam::DQuat::IDENTITY, glam::DVec3::splat(1e6));
        let visible = augmented && input.lighting.is_some();
        let pose = input
            .world_from_camera
            .filter(|_| visible)
            .unwrap_or(nowhere);
        let axis = |v: glam::DVec3| (pose.rotation * v).as_vec3().extend(0.0).to_array();
        let size = (input.picture.width as f32, input.picture.height as f32);
        let ground = input.lighting.map_or(Vec3::ZERO, |l| l.ground_radiance);
        let (height, has_ground) = match self.scene.ground_height {
            Some(height) => (height as f32, 1.0),
            None => (0.0, 0.0),
        };
        let mips = self
            .sized
            .as_ref()
            .map_or(1, |s| s.targets.surroundings_levels.len());
        let [f, c] = [camera.focal, camera.centre];
        let near = input.near.filter(|near| near.generation != 0 && visible);
        let near_low = near.map_or([0.0; 4], |n| n.low.extend(1.0).to_array());
        let near_high = near.map_or([1.0; 4], |n| n.high.extend(0.0).to_array());
        let [turning, moving] = self.rolling_uniform(camera);
        let [bending, rows] = self.bending_uniform(camera);
        let [fading, fading_from] = self.fading_uniform(camera);
        FrameUniform {
            fading,
            fading_from,
            turning,
            moving,
            bending,
            rows,
            right: axis(glam::DVec3::X),
            down: axis(glam::DVec3::Y),
            forward: axis(glam::DVec3::Z),
            eye: pose.translation.as_vec3().extend(NEAR as f32).to_array(),
            intrinsics: [f.x as f32, f.y as f32, c.x as f32, c.y as f32],
            size: [size.0, size.1, 1.0 / size.0, 1.0 / size.1],
            clip_from_world: (clip_from_camera(camera) * pose.inverse().to_matrix())
                .as_mat4()
                .to_cols_array_2d(),
            harmonics: input.lighting.map_or([[0.0; 4]; 9], |l| {
                l.irradiance.coefficients.map(|c| c.extend(0.0).to_array())
            }),
            counts: [
                lights as u32,
                u32::from(input.shadow_mode == ShadowMode::Subtract),
                self.settings.shadow_step,
                self.light_maps.gloss.highest_level(),
            ],
            params: [input.shadow_strength, height, has_ground, (mips - 1) as f32],
            ground: ground.extend(self.exposure.factor()).to_array(),
            tiling: [
                (lights as u32).div_ceil(64).max(1),
                TILE,
                self.settings.shadow_step.ilog2(),
                TILE.ilog2(),
            ],
            near_low,
            near_high,
            planes_low: [0.0; 4],
            planes_high: [0.0; 4],
            brightest: match input.lamp_response {
                LampResponse::Paper { brightest } if self.answers => {
                    let known = if brightest.is_finite() {
                        brightest
                    } else {
                        Vec3::ZERO
                    };
                    known.clamp_length_max(1.0).extend(1.0).to_array()
                }
                _ => [0.0; 4],
            },
        }
    }
}
