//! Lens models: from a point in the camera's frame to a pixel and back, with derivatives.
//!
//! Camera frame: OpenCV optical (+X right, +Y down, +Z forward); pixel (0, 0) is the centre
//! of the top-left pixel.

use crate::PinholeCamera;
use glam::{DMat2, DVec2, DVec3};

/// Distortion model of a lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LensModel {
    /// Brown–Conrady: k1, k2, p1, p2, k3 (OpenCV's `plumb_bob`).
    Brown,
    /// Brown–Conrady with a denominator: k1, k2, p1, p2, k3, k4, k5, k6 (OpenCV's
    /// `rational_polynomial`).
    BrownRational,
    /// Kannala–Brandt: r = f (θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹) (OpenCV's `fisheye`,
    /// Kalibr's `equidistant`).
    KannalaBrandt,
}

impl LensModel {
    /// Names of the coefficients, in OpenCV's order.
    #[must_use]
    pub const fn coefficients(self) -> &'static [&'static str] {
        match self {
            Self::Brown => &["k1", "k2", "p1", "p2", "k3"],
            Self::BrownRational => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
            Self::KannalaBrandt => &["k1", "k2", "k3", "k4"],
        }
    }

    /// Name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Brown => "brown",
            Self::BrownRational => "brown-rational",
            Self::KannalaBrandt => "fisheye",
        }
    }

    /// Returns the model of a name, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Brown, Self::BrownRational, Self::KannalaBrandt]
            .into_iter()
            .find(|m| m.name() == name)
    }
}

/// Maximum number of parameters of a lens: fx, fy, cx, cy and eight coefficients.
pub const MAX_PARAMETERS: usize = 12;

/// Intrinsics of one camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// Distortion model.
    pub model: LensModel,
    /// Focal lengths, pixels (of a fisheye: pixels per radian at the axis).
    pub focal: DVec2,
    /// Image of the optical axis, pixels.
    pub centre: DVec2,
    /// Coefficients in the order of [`LensModel::coefficients`]; the rest is zero.
    pub coefficients: [f64; 8],
}

/// The pixel of a point and its derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    /// The pixel.
    pub pixel: DVec2,
    /// ∂pixel/∂x, ∂y, ∂z of the point in the camera's frame.
    pub by_point: [DVec2; 3],
    /// ∂pixel/∂fx, fy, cx, cy and the coefficients in order.
    pub by_parameter: [DVec2; MAX_PARAMETERS],
}

/// A distorted point on the z = 1 plane, with derivatives.
#[derive(Clone, Copy, Debug)]
struct Distorted {
    point: DVec2,
    by_point: [DVec2; 3],
    by_coefficient: [DVec2; 8],
}

impl Lens {
    /// Creates a lens without distortion.
    #[must_use]
    pub const fn ideal(
        model: LensModel,
        (width, height): (u32, u32),
        focal: DVec2,
        centre: DVec2,
    ) -> Self {
        Self {
            width,
            height,
            model,
            focal,
            centre,
            coefficients: [0.0; 8],
        }
    }

    /// Number of parameters: four plus the model's coefficients.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        4 + self.model.coefficients().len()
    }

    /// Returns fx, fy, cx, cy and the coefficients; the rest is zero.
    #[must_use]
    pub fn parameters(&self) -> [f64; MAX_PARAMETERS] {
        let mut out = [0.0; MAX_PARAMETERS];
        out[..4].copy_from_slice(&[self.focal.x, self.focal.y, self.centre.x, self.centre.y]);
        out[4..].copy_from_slice(&self.coefficients);
        out
    }

    /// Returns the lens with other parameters, in the order of [`Self::parameters`].
    #[must_use]
    pub fn with_parameters(&self, parameters: &[f64; MAX_PARAMETERS]) -> Self {
        let mut out = self.clone();
        out.focal = DVec2::new(parameters[0], parameters[1]);
        out.centre = DVec2::new(parameters[2], parameters[3]);
        out.coefficients.copy_from_slice(&parameters[4..]);
        out
    }

    /// Projects a point of the camera's frame to a pixel; `None` where the model has none (behind a
    /// pinhole, or straight behind a fisheye).
    #[must_use]
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        Some(self.distorted(point)?.point * self.focal + self.centre)
    }

    /// As [`Self::project`], with derivatives.
    #[must_use]
    pub fn project_with_derivatives(&self, point: DVec3) -> Option<Projection> {
        let d = self.distorted(point)?;
        let mut by_parameter = [DVec2::ZERO; MAX_PARAMETERS];
        by_parameter[0] = DVec2::new(d.point.x, 0.0);
        by_parameter[1] = DVec2::new(0.0, d.point.y);
        by_parameter[2] = DVec2::X;
        by_parameter[3] = DVec2::Y;
        for (slot, by) in by_parameter[4..].iter_mut().zip(d.by_coefficient) {
            *slot = by * self.focal;
        }
        Some(Projection {
            pixel: d.point * self.focal + self.centre,
            by_point: d.by_point.map(|by| by * self.focal),
            by_parameter,
        })
    }

    /// Returns the unit direction of the ray through a pixel; `None` beyond the radius at which the
    /// model's polynomial is no longer monotonic.
    #[must_use]
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let distorted = (pixel - self.centre) / self.focal;
        match self.model {
            LensModel::KannalaBrandt => kannala_brandt::undistort(&self.coefficients, distorted),
            _ => brown_conrady::undistort(&self.coefficients, distorted),
        }
    }

    fn distorted(&self, point: DVec3) -> Option<Distorted> {
        match self.model {
            LensModel::KannalaBrandt => kannala_brandt::distort(&self.coefficients, point),
            _ => brown_conrady::distort(&self.coefficients, point),
        }
    }

    /// Returns whether every pixel of the picture within `radius` pixels of the centre has a ray.
    #[must_use]
    pub fn is_invertible_within(&self, radius: f64) -> bool {
        (0..=64).all(|i| {
            let angle = f64::from(i) / 64.0 * std::f64::consts::TAU;
            let pixel = self.centre + DVec2::from_angle(angle) * radius;
            let inside = pixel.clamp(DVec2::ZERO, self.last_pixel());
            self.unproject(inside).is_some()
        })
    }

    /// Centre of the bottom-right pixel.
    #[must_use]
    pub fn last_pixel(&self) -> DVec2 {
        DVec2::new(f64::from(self.width) - 1.0, f64::from(self.height) - 1.0)
    }

    /// Converts to a [`PinholeCamera`]; `None` if the model is not [`LensModel::Brown`].
    #[must_use]
    pub fn as_pinhole(&self) -> Option<PinholeCamera> {
        let [k1, k2, p1, p2, k3, ..] = self.coefficients;
        (self.model == LensModel::Brown).then_some(PinholeCamera {
            width: self.width,
            height: self.height,
            focal: self.focal,
            centre: self.centre,
            distortion: [k1, k2, p1, p2, k3],
        })
    }
}

impl From<&PinholeCamera> for Lens {
    fn from(camera: &PinholeCamera) -> Self {
        let mut coefficients = [0.0; 8];
        coefficients[..5].copy_from_slice(&camera.distortion);
        Self {
            width: camera.width,
            height: camera.height,
            model: LensModel::Brown,
            focal: camera.focal,
            centre: camera.centre,
            coefficients,
        }
    }
}

/// Solves J d = e; `None` if the determinant of J is not positive, which is where the distortion
/// folds over.
fn newton_step(by_x: DVec2, by_y: DVec2, error: DVec2) -> Option<DVec2> {
    let jacobian = DMat2::from_cols(by_x, by_y);
    (jacobian.determinant() > 1e-6).then(|| jacobian.inverse() * error)
}

mod brown_conrady;
mod kannala_brandt;
#[cfg(test)]
mod tests;
