//! Shadowing planes and their basis images (Kakuta et al. 2004, 2007): soft shadows of large static
//! models at a cost that does not depend on their triangles.
//!
//! Planes cover the parts of a model roughly. Offline, one basis image per plane and light of the
//! dome is rendered with a parallel camera along the plane's normal: the light that does not arrive.
//! In each frame the images are summed, weighted by the luminance of the dome's faces, and the sums
//! are mapped back to the surfaces that the planes cover.

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

/// A rectangle that receives shadows.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowingPlane {
    /// Centre of the rectangle, world, metres.
    pub centre: DVec3,
    /// Unit vector to the right in the basis images, as seen by the plane's camera, which looks
    /// against the normal.
    pub right: DVec3,
    /// Unit vector upwards in the images. `right × up` is the normal.
    pub up: DVec3,
    /// Half of width and height, metres.
    pub half_size: DVec2,
    /// Maximum distance behind the plane of the surfaces that it covers, metres.
    pub depth: f64,
    /// Surfaces on which its shadows are visible.
    pub layer: Layer,
    /// Surface for which shadows are baked.
    pub receiver: Receiver,
    /// Indices of the parts that it covers, in [`crate::scene::Scene::virtual_parts`] or
    /// [`crate::scene::Scene::phantom_parts`] by its layer.
    pub parts: Vec<u32>,
}

impl ShadowingPlane {
    /// Unit normal, away from the covered surfaces.
    #[must_use]
    pub fn normal(&self) -> DVec3 {
        self.right.cross(self.up)
    }

    /// Returns the plane after a rigid motion of the surfaces that it covers.
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

/// Surfaces on which a plane's shadows are visible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// The real scene: ground, phantoms. Shadows of virtual objects are added; those of real objects
    /// are in the camera's picture already.
    Real,
    /// Virtual objects: shadows of virtual and real objects are added.
    Virtual,
}

/// Surface for which shadows are baked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Receiver {
    /// The rectangle itself, as in the papers: exact for the ground.
    Plane,
    /// The first surface behind each texel, as the plane's camera sees it: an eave shadows the wall,
    /// not the plane in front of it.
    Surface,
}
