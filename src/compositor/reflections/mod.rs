//! What glossy surfaces mirror of their neighbourhood: phantoms, other virtual objects, themselves.
//!
//! The environment is seen from one place; what is close by looks different from every surface. The
//! processor traces mirror rays from the glossy surfaces that the camera sees, on a lattice of
//! pixels, and the composite looks the result up. On every adapter the processor does it: a
//! software driver would read the hierarchy's boxes lane by lane.

mod bounce;
mod bvh;
mod nearby;
mod nearby_scene;
mod pixel_mean;
mod radiance;
mod stage;
mod texel;
mod trace;
mod view;

pub use nearby_scene::NearbyScene;
pub use stage::{ReflectionTiles, ReflectionsStage};
