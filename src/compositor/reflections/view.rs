//! The scene camera, as mirror rays need it.

use glam::{Mat3, Vec2, Vec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::smoothstep;

/// Part of the picture's width over which reflections of the picture fade towards its edges.
const FADE: f32 = 0.05;

/// The camera of a frame without distortion.
pub struct View {
    camera: PinholeCamera,
    pub eye: Vec3,
    world_from_camera: Mat3,
}

impl View {
    pub fn new(camera: &PinholeCamera, pose: RigidTransform) -> Self {
        Self {
            camera: camera.clone(),
            eye: pose.translation.as_vec3(),
            world_from_camera: Mat3::from_quat(pose.rotation.as_quat()),
        }
    }

    /// The direction of a pixel, 1 long along the camera's axis.
    pub fn through(&self, pixel: Vec2) -> Vec3 {
        let (focal, centre) = (self.camera.focal.as_vec2(), self.camera.centre.as_vec2());
        self.world_from_camera * ((pixel - centre) / focal).extend(1.0)
    }

    /// Where the picture shows `p`, in the picture's width and height, and its distance along the
    /// camera's axis, metres; `None` behind the camera.
    pub fn place_of(&self, p: Vec3) -> Option<(Vec2, f32)> {
        let own = self.world_from_camera.transpose() * (p - self.eye);
        let (focal, centre) = (self.camera.focal.as_vec2(), self.camera.centre.as_vec2());
        let size = Vec2::new(self.camera.width as f32, self.camera.height as f32);
        let uv = (own.truncate() / own.z * focal + centre + 0.5) / size;
        (own.z > 0.0).then_some((uv, own.z))
    }

    /// Whether the picture shows `p`, if nothing hides it.
    pub fn shows(&self, p: Vec3) -> bool {
        self.place_of(p).is_some_and(|(uv, _)| inside(uv) > 0.0)
    }
}

/// 1 within the picture, 0 beside it, in between at its edges.
pub fn inside(uv: Vec2) -> f32 {
    smoothstep(0.0, FADE, uv.min(1.0 - uv).min_element())
}
