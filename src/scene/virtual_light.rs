//! Virtual lights (lamps): they exist only in the picture and light real and virtual surfaces there.

use crate::mesh::SceneTexture;
use glam::{DVec2, DVec3, Vec3};
use std::sync::Arc;

/// A virtual light.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualLight {
    /// For messages.
    pub name: String,
    /// Distribution of its light.
    pub kind: VirtualLightKind,
    /// Linear RGB, scene camera units: a white diffuse surface at r metres has the radiance
    /// `intensity · cos θ / (π r²)`. Of an area light: along its normal, its texture included.
    pub intensity: Vec3,
    /// Appearance of an area light; `None` for other kinds.
    pub screen: Option<Screen>,
    /// Path over time, interpolated by smoothstep between keys.
    pub keys: Vec<VirtualLightKey>,
    /// Period of the path, seconds; `None` if it does not repeat.
    pub repeat: Option<f64>,
}

/// Distribution of a virtual light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VirtualLightKind {
    /// The same in all directions.
    Point,
    /// Full inside `beam`, falling linearly in angle to zero at `cutoff`.
    Spot {
        /// Half angle, radians.
        beam: f64,
        /// Half angle, radians.
        cutoff: f64,
    },
    /// A rectangle of equal radiance in all directions (Lambert).
    Area {
        /// Half of its width and height, metres.
        half_size: DVec2,
        /// Direction of its height, world; made perpendicular to its normal.
        up: DVec3,
        /// Whether it emits to both sides.
        two_sided: bool,
    },
}

/// Appearance of an area light.
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    /// Colours over the area, upright as seen from in front; uniform without a texture.
    pub texture: Option<Arc<SceneTexture>>,
    /// Whether the area itself is rendered.
    pub visible: bool,
}

/// State of a virtual light at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VirtualLightKey {
    /// Seconds from the session's start.
    pub seconds: f64,
    /// World, metres.
    pub position: DVec3,
    /// Point at which a spot aims, world, metres.
    pub target: Option<DVec3>,
    /// Factor of the intensity.
    pub gain: f64,
}
