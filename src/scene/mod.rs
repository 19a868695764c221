//! What is virtual, and the proxies of what is real. Plain data; no wgpu.

pub mod assemble;
mod casters;
pub mod change;
mod check;
pub mod detail;
pub mod error;
pub mod gate;
mod gltf_bytes;
pub mod gltf_file;
mod gltf_material;
pub mod lamps;
pub mod mesh;
pub mod near_field;
mod normals;
pub mod photometric;
pub mod planes;
pub mod ply;
pub mod primitives;
pub mod raycast;
pub mod scene_file;
pub mod simplify;

pub use assemble::{Attachments, rig_of_session};
pub use casters::{casters, casters_within};
pub use change::Change;
pub use detail::coarser;
pub use error::SceneError;
pub use gltf_bytes::Resolver;
pub use gltf_file::{Model, load_gltf, load_gltf_bytes};
pub use lamps::PlacedLamp;
pub use mesh::{Material, Mesh, Part, Phong, Scene, SceneTexture, Vertex};
pub use near_field::{NearField, NearLight, PhantomRadiance};
pub use ply::load_ply;
pub use raycast::{Hit, PhantomRays};
pub use scene_file::SceneAddition;
pub use simplify::simplify_for_casting;
