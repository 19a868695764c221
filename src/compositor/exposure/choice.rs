//! The exposure of a picture: requested and active.

use super::control::{AutoLimits, Brightness};

/// The exposure in which a picture is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The camera's own: its codes are kept exactly.
    #[default]
    Camera,
    /// A number of stops longer (shorter below 0) than the camera's.
    Stops(f32),
    /// Follows the light that virtual lights add to the real scene.
    Automatic {
        /// Range and speed of the adaptation.
        limits: AutoLimits,
        /// Time of the picture, seconds; only differences count.
        seconds: f64,
    },
}

/// The exposure of the newest picture, and the measurement from which it follows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ActiveExposure {
    /// Stops relative to the camera's own; 0 leaves the picture unchanged.
    pub stops: f32,
    /// The target of an automatic exposure, stops; otherwise equal to `stops`.
    pub target: f32,
    /// The brightness from which the target follows; `None` if nothing was measured.
    pub brightness: Option<Brightness>,
}

/// Maximum change of the exposure in either direction, stops.
pub const MAX_STOPS: f32 = 8.0;
