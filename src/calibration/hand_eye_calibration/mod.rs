//! The calibration steps `latency` and `tracker`, which relate a tracker to the pictures of the same
//! recording.
//!
//! In the order of data flow: `pose_finder` finds the scene camera's pose in each picture from tags
//! or a board, `readings` holds the tracker's readings; `latency` compares the rotations of both,
//! `mounting` their poses; `field_fit` models the distortion of an electromagnetic tracker's
//! measurement space. For each step, `…_assessment` grades the result and `…_report` presents it.

mod field_fit;
mod latency;
mod latency_assessment;
mod latency_report;
mod mounting;
mod mounting_assessment;
mod mounting_report;
mod pose_finder;
mod readings;

pub use latency::{LatencyOptions, LatencyStep};
pub use mounting::{LatencyChoice, MountingOptions, MountingStep};
pub use pose_finder::Landmarks;

#[cfg(test)]
mod tests;
