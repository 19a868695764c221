//! The pinhole camera of a frame: the picture plane on which everything is composed.

use super::frame_input::FrameInput;
use super::lens::LensStage;
use glam::{DMat4, DVec4};
use penumbra_camera::PinholeCamera;

/// Distance of the near plane, metres: closer than any hand-held object is viewed.
pub const NEAR: f64 = 0.02;

/// The cameras of a frame. They differ where the lens distorts.
pub struct FrameView {
    /// The camera without distortion in whose picture the frame is composed.
    pub camera: PinholeCamera,
    /// The scene camera.
    pub own: PinholeCamera,
    /// Squared tangent up to which the lens model of `own` holds.
    pub reach: f64,
    /// Width and height of the composed picture, pixels.
    pub size: (u32, u32),
}

impl FrameView {
    /// The view of `input`; `lens` is the stage of its camera if that distorts.
    pub fn new(input: &FrameInput<'_>, lens: Option<&LensStage>) -> Self {
        let own = input.camera.clone();
        match lens {
            Some(lens) => Self {
                camera: lens.undistorted.clone(),
                own,
                reach: lens.reach,
                size: (lens.undistorted.width, lens.undistorted.height),
            },
            None => Self {
                camera: own.clone(),
                own,
                reach: f64::from(f32::MAX),
                size: (input.picture.width, input.picture.height),
            },
        }
    }

    /// Projection of the world for a camera at the pose `camera_from_world`.
    pub fn clip_from_world(&self, camera_from_world: DMat4) -> DMat4 {
        clip_from_camera(&self.camera) * camera_from_world
    }
}

/// Projection of the camera frame (+X right, +Y down, +Z forward) to clip space with
/// reversed depth and the far plane at infinity. Pixel (0, 0) is the centre of the
/// top-left pixel, so the left edge of the picture lies at −0.5.
pub fn clip_from_camera(camera: &PinholeCamera) -> DMat4 {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let (f, c) = (camera.focal, camera.centre);
    DMat4::from_cols(
        DVec4::new(2.0 * f.x / w, 0.0, 0.0, 0.0),
        DVec4::new(0.0, -2.0 * f.y / h, 0.0, 0.0),
        DVec4::new(
            2.0 * (c.x + 0.5) / w - 1.0,
            1.0 - 2.0 * (c.y + 0.5) / h,
            0.0,
            1.0,
        ),
        DVec4::new(0.0, 0.0, NEAR, 0.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};

    #[test]
    fn projection_matches_the_camera_model() {
        let camera = PinholeCamera {
            width: 640,
            height: 480,
            focal: DVec2::new(700.0, 701.5),
            centre: DVec2::new(322.3, 237.1),
            distortion: [0.0; 5],
        };
        for p in [DVec3::new(0.1, -0.2, 1.5), DVec3::new(-0.4, 0.3, 0.9)] {
            let clip = clip_from_camera(&camera) * p.extend(1.0);
            let ndc = clip.truncate() / clip.w;
            let frame = DVec2::new((ndc.x + 1.0) * 320.0, (1.0 - ndc.y) * 240.0);
            let pixel = camera.project(p).unwrap();
            assert!((frame - pixel - DVec2::splat(0.5)).length() < 1e-9);
            assert!((ndc.z - NEAR / p.z).abs() < 1e-12);
        }
    }
}
