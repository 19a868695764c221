//! Draws pictures of a textured table with a camera that moves by hand.

use crate::SurfaceAt;
use glam::{DMat3, DQuat, DVec2, DVec3};
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::RigidTransform;
use penumbra_numerics::Random;

/// Standard deviation of the pictures' noise, codes.
const NOISE_CODES: f64 = 2.0;

pub fn camera() -> PinholeCamera {
    PinholeCamera {
        width: 336,
        height: 240,
        focal: DVec2::splat(340.0),
        centre: DVec2::new(167.0, 121.0),
        distortion: [0.0; 5],
    }
}

/// A hand's motion around the table's middle.
pub fn truth(seconds: f64) -> RigidTransform {
    let eye = DVec3::new(
        0.12 * (1.3 * seconds).sin(),
        -0.45 + 0.03 * (1.7 * seconds).cos(),
        0.4 + 0.04 * (1.1 * seconds).sin(),
    );
    let forward = (DVec3::new(0.01 * (2.0 * seconds).sin(), 0.0, 0.0) - eye).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    RigidTransform::new(DQuat::from_mat3(&axes), eye)
}

/// Mean error of a pose at points around the table's middle, pixels.
pub fn pixels_off(camera: &PinholeCamera, pose: RigidTransform, truth: RigidTransform) -> DVec2 {
    let points = [-0.05, 0.05].map(|x| DVec3::new(x, 0.0, 0.03));
    let shown = |pose: RigidTransform, p: DVec3| camera.project(pose.inverse().transform_point(p));
    let off = |p: DVec3| Some(shown(pose, p)? - shown(truth, p)?);
    points.into_iter().filter_map(off).sum::<DVec2>() / points.len() as f64
}

/// A table z = 0.
#[derive(Clone, Copy)]
pub struct Scene {
    /// Amplitude of the texture, codes.
    pub contrast: f64,
    /// Height above what is known of the part of the table right of a place, metres.
    pub step: f64,
    /// That place.
    pub step_from: f64,
    /// Share of the light that is missing in a lamp's shadow, whose edge moves by 2 cm a second.
    pub shadow: f64,
    /// Half the side of a thing that is carried through the picture by 70 pixels a second, pixels.
    pub carried: f64,
    /// Whether the table is known.
    pub is_known: bool,
}

impl Scene {
    pub const fn plane() -> Self {
        Self {
            contrast: 60.0,
            step: 0.0,
            step_from: 0.06,
            shadow: 0.0,
            carried: 0.0,
            is_known: true,
        }
    }

    /// Where a ray meets the table, as far as it is known.
    pub fn known(&self, origin: DVec3, direction: DVec3) -> Option<SurfaceAt> {
        let along = -origin.z / direction.z;
        (self.is_known && along > 0.0).then(|| SurfaceAt {
            point: origin + direction * along,
            normal: DVec3::Z,
        })
    }

    /// Draws a picture as RGBA. `pose`: that of the camera, by the time since the middle of the picture.
    pub fn draw(
        &self,
        camera: &PinholeCamera,
        pose: &dyn Fn(f64) -> RigidTransform,
        row_seconds: f64,
        seconds: f64,
        rgba: &mut Vec<u8>,
    ) {
        let mut random = Random::new(seconds.to_bits());
        rgba.clear();
        for y in 0..camera.height {
            let rows = f64::from(y) - RollingShutter::middle_row(camera);
            let pose = pose(rows * row_seconds);
            for x in 0..camera.width {
                let pixel = DVec2::new(f64::from(x), f64::from(y));
                let ray = pose.rotation * camera.unproject(pixel);
                let value = self.value(pose.translation, ray, pixel, seconds);
                let noise = NOISE_CODES * random.normal();
                let code =
                    (1.0 - self.shaded(&pose, ray, seconds)) * (120.0 + self.contrast * value);
                let code = (code + noise.clamp(-8.0, 8.0)) as u8;
                rgba.extend([code, code, code, 255]);
            }
        }
        if self.contrast == 0.0 {
            rgba.fill(120);
        }
    }

    /// Share of the light that is missing at a place of the table.
    fn shaded(&self, pose: &RigidTransform, ray: DVec3, seconds: f64) -> f64 {
        let point = pose.translation - ray * (pose.translation.z / ray.z);
        let inside = 0.02 * seconds + 0.02 * (30.0 * point.y).sin() - point.x.abs();
        self.shadow * (0.5 + inside / 0.006).clamp(0.0, 1.0)
    }

    /// Texture seen at a pixel, −1 to 1.
    fn value(&self, origin: DVec3, ray: DVec3, pixel: DVec2, seconds: f64) -> f64 {
        let carried = pixel - DVec2::new(60.0 + 70.0 * seconds, 120.0);
        if carried.abs().max_element() < self.carried {
            return texture(carried * 0.0021 + 5.0);
        }
        let at = |height: f64| origin + ray * ((height - origin.z) / ray.z);
        let raised = at(self.step);
        let point = if raised.x > self.step_from {
            raised
        } else {
            at(0.0)
        };
        texture(point.truncate())
    }
}

/// Smooth irregular texture, −1 to 1; details of 1 cm.
fn texture(p: DVec2) -> f64 {
    let waves = [
        (310.0, 120.0),
        (-150.0, 290.0),
        (220.0, -260.0),
        (90.0, 410.0),
        (470.0, 60.0),
        (-330.0, -170.0),
    ];
    let sum: f64 = (0..)
        .zip(waves)
        .map(|(i, (u, v))| (u * p.x + v * p.y + f64::from(i)).sin())
        .sum();
    (sum / 3.0).clamp(-1.0, 1.0)
}
