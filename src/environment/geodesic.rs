//! The light of the papers on shadowing planes (Kakuta et al. 2004, 2007): the triangles of a
//! geodesic dome, Class I, over the upper hemisphere, and which pixel of the environment lies
//! in which.

use glam::Vec3;
use std::sync::Arc;

/// One triangle of the dome.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Unit vectors, counter-clockwise seen from outside the sphere.
    pub corners: [Vec3; 3],
    /// Unit vector through the middle: the direction of the light that stands for the face.
    pub centre: Vec3,
    /// Of the spherical triangle, steradians.
    pub solid_angle: f32,
}

/// Which pixels lie in which face: made once per calibration. Pixels are sorted by face.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Membership {
    /// Where each face's pixels begin; one more than faces.
    pub begins: Vec<u32>,
    /// Indices into the radiance that is summed.
    pub pixels: Vec<u32>,
    /// Solid angle of each of them in the face, steradians.
    pub weights: Vec<f32>,
}

/// What the luminance parameters are summed from: S_i = Σ weight · radiance over face i.
#[derive(Clone, Debug)]
pub struct FaceLight {
    /// Of the dome.
    pub frequency: u32,
    /// The table.
    pub membership: Arc<Membership>,
    /// Linear RGB radiance in the scene camera's units: the environment's pixels, then texels of
    /// the filled cube for what no pixel shows.
    pub radiance: Arc<Vec<[f32; 3]>>,
}
