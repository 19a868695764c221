//! Lens and pose of the environment camera: the step [`EnvironmentStep`].
//!
//! In the order of data flow: `step` gathers pictures and poses (`gathered`, `inputs`; `pairs` reads
//! the user's clicks). `optics` finds the lens from a fisheye's circle (`image_circle`) or a mirrored
//! sphere's outline (`sphere_outline`), both from steps of brightness along `rays`; `view` is the
//! lens found. `observations` collects what the environment camera observed at known points or in
//! known directions: fiducials (`tags`), clicks, and lights (`bright_pixels`, `light_directions`,
//! matched by `light_matching` and refined by `mirror`). `resection` computes the pose from them,
//! `pose` chooses among the kinds of evidence, `assessment` grades the pose; `solve` runs all of this
//! and writes the calibration, `report` presents it.

mod assessment;
mod bright_pixels;
mod clicks;
mod gathered;
mod image_circle;
mod inputs;
mod light_directions;
mod light_matching;
mod mirror;
mod observations;
mod optics;
mod pose;
mod rays;
mod report;
mod resection;
mod solve;
mod sphere_outline;
mod step;
#[cfg(test)]
mod synthetic;
mod tags;
mod view;

pub use clicks::{Click, ClickError, ClickTarget, parse_clicks};
pub use inputs::{EnvironmentCameraKind, EnvironmentOptions, KnownRig, NotReady};
pub use sphere_outline::RoughSphere;
pub use step::EnvironmentStep;
