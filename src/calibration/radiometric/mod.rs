//! Radiometric calibration of a rig's cameras: tone curves, vignetting, noise, and the gains between
//! the cameras (white balance and exposure).
//!
//! `chart` finds ColorCheckers, whose colours are in `reference`; `curve` fits the tone curve,
//! `noise`, `noise_texture` and `vignetting` the models of their
//! names; `step` is the calibration step.

pub mod chart;
pub mod curve;
pub mod noise;
pub mod noise_texture;
pub mod reference;
pub mod step;
pub mod vignetting;

#[cfg(test)]
pub(crate) mod synthetic;
