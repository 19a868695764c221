//! Virtual objects, proxies of real objects, lamps and shadowing planes, as plain data; their file
//! readers and geometry. No GPU code.
//!
//! The modules below are listed in the order of the data: data types, readers, motion over time,
//! changes, simplified meshes, rays, indirect light, shadowing planes.

mod check;
pub mod error;
mod ground_plane;
pub mod mesh;
pub mod photometric;
mod virtual_light;

pub mod gate;
mod normals;
pub mod primitives;

mod choice;
pub mod enclosed;
mod gltf_bytes;
pub mod gltf_file;
mod gltf_lamp;
mod gltf_material;
mod gltf_motion;
pub mod ply;
mod rendering;
pub mod scene_file;

pub mod change;
pub mod edit;
pub mod lamps;
pub mod motion;
mod scene;

mod casters;
pub mod detail;
pub mod simplify;

pub mod raycast;

pub mod indirect_light;

pub mod planes;

pub use casters::{casters, casters_within};
pub use change::Change;
pub use choice::SceneChoice;
pub use detail::coarser;
pub use error::SceneError;
pub use gltf_bytes::Resolver;
pub use gltf_file::{Model, Playing, load_gltf, load_gltf_bytes};
pub use gltf_lamp::ModelLamp;
pub use gltf_motion::z_up_from_y_up;
pub use ground_plane::GroundPlane;
pub use indirect_light::{
    GroundBrightness, IndirectLight, IndirectLightBlender, IndirectLightSolver, PhantomRadiance,
    RealSurfaces,
};
pub use lamps::{PlacedArea, PlacedLamp};
pub use mesh::{Material, Mesh, Part, Phong, SceneTexture, Vertex};
pub use motion::{Motion, Motions, Mover};
pub use ply::load_ply;
pub use raycast::{Hit, RayCaster};
pub use rendering::{Highlights, LampResponse, PlaneShading, ShadowMode};
pub use scene::{Scene, still_and_moving};
pub use scene_file::SceneAddition;
pub use simplify::simplify_for_casting;
pub use virtual_light::{Screen, VirtualLight, VirtualLightKey, VirtualLightKind};
