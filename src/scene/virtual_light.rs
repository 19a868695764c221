//! Lamps that exist in the picture only, and light the real scene there.

use crate::mesh::SceneTexture;
use glam::{DVec2, DVec3, Vec3};
use std::sync::Arc;

/// A lamp that exists in the picture only.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualLight {
    /// For messages.
    pub name: String,
    /// How it spreads its light.
    pub kind: VirtualLightKind,
    /// Linear, scene camera units: a white diffuse surface at r metres shows
    /// `intensity · cos θ / (π r²)`. Of an area what leaves along its normal, its picture
    /// included.
    pub intensity: Vec3,
    /// Of an area only.
    pub screen: Option<Screen>,
    /// Path in time, eased with smoothstep between keys.
    pub keys: Vec<VirtualLightKey>,
    /// Seconds after which the path begins anew.
    pub repeat: Option<f64>,
}

/// How a virtual light spreads.
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
    /// A rectangle that is equally bright from all sides (Lambert).
    Area {
        /// Half of its width and height, metres.
        half_size: DVec2,
        /// Its height's direction, world; made perpendicular to where it looks.
        up: DVec3,
        /// It shines to both sides.
        two_sided: bool,
    },
}

/// What an area lamp shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    /// Colours over the area, upright as seen from in front; without one it is even.
    pub texture: Option<Arc<SceneTexture>>,
    /// The area itself is drawn.
    pub visible: bool,
}

/// Where a virtual light is at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VirtualLightKey {
    /// Seconds from the session's start.
    pub seconds: f64,
    /// World, metres.
    pub position: DVec3,
    /// What a spot points at, world.
    pub target: Option<DVec3>,
    /// Multiplies the intensity.
    pub gain: f64,
}
