//! The Kannala–Brandt fisheye (Kannala & Brandt 2006; OpenCV's `fisheye` model).

use crate::FisheyeLens;
use glam::{DVec2, DVec3};

impl FisheyeLens {
    /// Projects a direction of the camera frame to a pixel; `None` outside the field of view.
    #[must_use]
    pub fn project(&self, direction_in_camera: DVec3) -> Option<DVec2> {
        let across = direction_in_camera.truncate();
        let theta = across.length().atan2(direction_in_camera.z);
        if !theta.is_finite() || theta > self.max_theta {
            return None;
        }
        Some(self.centre + across.normalize_or_zero() * self.radius_from_theta(theta))
    }

    /// Returns the unit direction, in the camera frame, of the ray through a pixel; `None` outside
    /// the image circle.
    #[must_use]
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let across = pixel - self.centre;
        let radius = across.length();
        let theta = self.theta_from_radius(radius)?;
        if theta > self.max_theta {
            return None;
        }
        let side = across.normalize_or_zero() * theta.sin();
        Some(side.extend(theta.cos()))
    }

    /// Returns the distance from the image centre (pixels) of a ray at the angle `theta` from the axis.
    fn radius_from_theta(&self, theta: f64) -> f64 {
        let [k1, k2, k3, k4] = self.distortion;
        let t2 = theta * theta;
        self.focal * theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    }

    /// Inverse of [`Self::radius_from_theta`] by Newton's method; `None` where it does not converge, which
    /// is outside the range of the fitted polynomial.
    fn theta_from_radius(&self, radius: f64) -> Option<f64> {
        let ideal = radius / self.focal;
        if self.distortion == [0.0; 4] {
            return Some(ideal);
        }
        let [k1, k2, k3, k4] = self.distortion;
        let mut theta = ideal.min(self.max_theta);
        for _ in 0..12 {
            let t2 = theta * theta;
            let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
            theta -= (self.radius_from_theta(theta) - radius) / (self.focal * slope.max(0.05));
        }
        let converged = (self.radius_from_theta(theta) - radius).abs() < 1e-6 * self.focal;
        converged.then_some(theta)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lens(distortion: [f64; 4]) -> FisheyeLens {
        FisheyeLens {
            width: 480,
            height: 480,
            focal: 151.0,
            centre: DVec2::new(241.2, 238.6),
            distortion,
            max_theta: std::f64::consts::FRAC_PI_2,
        }
    }

    #[test]
    fn ideal_lens_is_equidistant() {
        let pixel = lens([0.0; 4]).project(DVec3::new(1.0, 0.0, 1.0)).unwrap();
        assert!((pixel.x - 241.2 - 151.0 * std::f64::consts::FRAC_PI_4).abs() < 1e-9);
        assert!(lens([0.0; 4]).project(DVec3::new(1.0, 0.0, -0.1)).is_none());
        assert!(lens([0.0; 4]).unproject(DVec2::new(0.0, 0.0)).is_none());
    }

    proptest! {
        #[test]
        fn unproject_inverts_project(theta in 0.0f64..1.57, phi in 0.0f64..6.2, k1 in -0.05f64..0.05) {
            let lens = lens([k1, 0.01, -0.004, 0.0005]);
            let d = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let back = lens.unproject(lens.project(d).unwrap()).unwrap();
            prop_assert!((back - d).length() < 1e-6);
        }
    }
}
