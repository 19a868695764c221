//! Directions of the environment camera's pixels.

use glam::{DVec2, DVec3};
use penumbra_camera::FisheyeLens;
use penumbra_camera::PinholeCamera;

/// The environment camera's lens.
#[derive(Clone, Debug, PartialEq)]
pub enum View {
    /// A fisheye.
    Fisheye(FisheyeLens),
    /// A lens that looks at a mirrored sphere.
    Pinhole(PinholeCamera),
}

impl View {
    /// Returns the direction of a pixel, a unit vector in the camera's frame; `None` outside the field
    /// of view.
    #[must_use]
    pub fn bearing(&self, pixel: DVec2) -> Option<DVec3> {
        let bearing = match self {
            Self::Fisheye(lens) => lens.unproject(pixel)?,
            Self::Pinhole(camera) => camera.unproject(pixel),
        };
        bearing.is_finite().then_some(bearing)
    }

    /// Returns the pixel of a direction in the camera's frame; `None` outside the field of view.
    #[must_use]
    pub fn pixel(&self, direction: DVec3) -> Option<DVec2> {
        match self {
            Self::Fisheye(lens) => lens.project(direction),
            Self::Pinhole(camera) => camera.project(direction),
        }
    }

    /// Returns the focal length at the centre, pixels per radian.
    #[must_use]
    pub fn focal(&self) -> f64 {
        match self {
            Self::Fisheye(lens) => lens.focal,
            Self::Pinhole(camera) => camera.focal.min_element(),
        }
    }
}
