//! One white point and one exposure for two cameras: `scene = gains × environment`, linear,
//! per channel.
//!
//! Three methods check one another: [`chart`] compares two pictures of the same colour chart;
//! [`gather`] finds surfaces that both cameras see now and [`overlap`] compares them, filtered
//! over time; [`reflectance`] predicts the colour of a known surface from the measured light.
//! [`WhiteBalanceMatch`] selects the gains to use. The reflectance of a mirrored sphere is no part
//! of the gains: the environment estimator divides by it.

pub mod colour;
mod colour_matrix;
mod gains;
mod robust_mean;

pub mod chart;

mod view;

pub mod gather;

pub mod overlap;

pub mod reflectance;

mod exposure;
mod settings;

mod status;

mod selection;

pub use exposure::ExposureRatio;
pub use gains::GainEstimate;
pub use selection::{SameModel, WhiteBalanceMatch};
pub use settings::{CalibratedGains, Provenance, WhiteBalanceMethod, WhiteBalanceSettings};
pub use status::{MatchStatus, MethodStatus};
