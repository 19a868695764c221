//! Shadowing planes and what is baked onto them (Kakuta et al. 2004, 2007): soft shadows of
//! large static models at a cost that does not depend on their triangles.
//!
//! A model's parts are covered roughly by planes. Ahead of time a parallel camera looks
//! along each plane's normal, and one basis image per plane and light is drawn: how much of
//! the light arrives there. In each frame the images are summed with the luminance of the
//! lights' faces of the dome, and the sums are mapped back onto what the planes cover.

pub mod bake;
mod choose;
mod clusters;
mod depth;
pub mod generate;
mod ground;
mod hand;
mod hull;
mod rectangle;
pub mod renew;
pub mod store;
mod surface;

pub use bake::{Bake, BakeSettings, Basis, Image, ReceiverImage};
pub use generate::{PlaneError, PlaneSettings, generate};
pub(super) use hand::covered_parts;

use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;

/// A rectangle that catches shadows.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowingPlane {
    /// Middle of the rectangle: world, metres.
    pub centre: DVec3,
    /// Unit vector along the basis images' columns, to the right as seen by the plane's
    /// camera, which looks against the normal.
    pub right: DVec3,
    /// Unit vector against the images' rows. `right × up` is the normal.
    pub up: DVec3,
    /// Half of width and height, metres.
    pub half_size: DVec2,
    /// How far behind the plane surfaces still belong to it, metres.
    pub depth: f64,
    /// On what its shadows are shown.
    pub layer: Layer,
    /// Where shadows are caught.
    pub receiver: Receiver,
    /// Indices of the parts that it covers: into [`crate::mesh::Scene::virtual_parts`] or
    /// [`crate::mesh::Scene::phantom_parts`], by its layer.
    pub parts: Vec<u32>,
}

impl ShadowingPlane {
    /// Unit vector away from what is covered.
    #[must_use]
    pub fn normal(&self) -> DVec3 {
        self.right.cross(self.up)
    }

    /// The same plane, carried along with what it covers.
    #[must_use]
    pub fn moved(&self, motion: RigidTransform) -> Self {
        Self {
            centre: motion.transform_point(self.centre),
            right: motion.rotation * self.right,
            up: motion.rotation * self.up,
            ..self.clone()
        }
    }
}

/// On what a plane's shadows are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// On the real scene: ground, phantoms. Virtual objects darken it; real ones have done so
    /// already, in the camera's picture.
    Real,
    /// On virtual objects: both virtual and real objects darken it.
    Virtual,
}

/// Where a plane's shadows are caught.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Receiver {
    /// On the rectangle itself, as in the papers: right for the ground.
    Plane,
    /// On the first surface behind each of its texels, as the plane's camera sees it: an eave
    /// shadows the wall and not the plane before it.
    Surface,
}
