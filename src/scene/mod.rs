//! What is virtual, and the proxies of what is real. Plain data; no wgpu.

pub mod mesh;

pub use mesh::{Material, Mesh, Part, Scene, SceneTexture, Vertex};
