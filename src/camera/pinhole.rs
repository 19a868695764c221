//! The pinhole camera with Brown–Conrady distortion (OpenCV's model).

use glam::{DVec2, DVec3};

/// Intrinsics of a perspective camera. Camera frame: OpenCV optical (+X right, +Y down,
/// +Z forward); pixel (0, 0) is the centre of the top-left pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct PinholeCamera {
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// Focal lengths, pixels.
    pub focal: DVec2,
    /// Principal point, pixels.
    pub centre: DVec2,
    /// k1, k2, p1, p2, k3 (OpenCV's order); all zero for none.
    pub distortion: [f64; 5],
}

impl PinholeCamera {
    /// Projects a point of the camera frame (metres) to a pixel; `None` behind the camera.
    #[must_use]
    pub fn project(&self, point_in_camera: DVec3) -> Option<DVec2> {
        if point_in_camera.z <= 1e-9 {
            return None;
        }
        let ideal = point_in_camera.truncate() / point_in_camera.z;
        Some(self.distort(ideal) * self.focal + self.centre)
    }

    /// Returns the unit direction, in the camera frame, of the ray through a pixel.
    #[must_use]
    pub fn unproject(&self, pixel: DVec2) -> DVec3 {
        let distorted = (pixel - self.centre) / self.focal;
        self.undistort(distorted).extend(1.0).normalize()
    }

    /// Applies OpenCV's radial and tangential distortion on the z = 1 plane.
    fn distort(&self, p: DVec2) -> DVec2 {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let tangential = DVec2::new(
            2.0 * p1 * p.x * p.y + p2 * (r2 + 2.0 * p.x * p.x),
            p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y,
        );
        p * radial + tangential
    }

    /// Inverse of [`Self::distort`] by fixed-point iteration, as in OpenCV.
    fn undistort(&self, distorted: DVec2) -> DVec2 {
        if self.distortion == [0.0; 5] {
            return distorted;
        }
        let mut p = distorted;
        for _ in 0..20 {
            p += distorted - self.distort(p);
        }
        p
    }
}
