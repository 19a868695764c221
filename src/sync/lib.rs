//! Pairing by time stamps: a tracker's pose history, the brackets of the environment camera, and
//! everything that belongs to one picture of the scene camera as a [`RigFrame`].
//!
//! Modules in the order of the data flow: `fit` (local least squares through poses), `history`
//! (poses at any time, by interpolation or prediction), `brackets` (exposures of one view of the
//! environment), `stations` and `lost_readings` (of the tracker), `pairing`. No clock is read: [`Pairing`] takes frames and poses in the order of
//! arrival, and equal input gives equal output, live or replayed.

mod brackets;
mod fit;
mod history;
mod lost_readings;
mod pairing;
mod stations;

pub use brackets::EnvironmentSet;
pub use fit::Degree;
pub use history::{HistoryConfig, PoseAt, PoseHistory, Provenance, Pushed, Smoothing};
pub use pairing::{PairedEnvironment, Pairing, PairingConfig, PairingCounts, RigFrame};
pub use stations::Stations;
