//! Colour and brightness of a rig's cameras: charts found in pictures, what they say of white
//! balance and exposure, tone curves, fall-off towards the edge, noise.

pub mod chart;
pub mod curve;
pub mod noise;
pub mod reference;
pub mod step;
pub mod vignetting;

#[cfg(test)]
pub(crate) mod drawn;
