//! Pure functions of time stamps: a tracker's history, the brackets of the environment
//! camera, and pairing everything into one [`RigFrame`].
//!
//! Nothing here reads a clock. [`Pairing`] takes what arrives, in the order of arrival,
//! and says which environment and which pose belong to each picture of the scene camera;
//! the same input gives the same answer, live or replayed.

mod brackets;
mod fit;
mod history;
mod pairing;

pub use brackets::EnvironmentSet;
pub use fit::Degree;
pub use history::{HistoryConfig, PoseAt, PoseHistory, Provenance, Pushed, Smoothing};
pub use pairing::{PairedEnvironment, Pairing, PairingConfig, PairingCounts, RigFrame};
