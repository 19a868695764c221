//! The camera picture as a shorter or a longer exposure would have shown it (DiVerdi and
//! Höllerer 2004, section 4.3), chosen by hand or by the light that virtual lights add.
//!
//! The picture is scaled in linear light. A clipped pixel stands for any light from white up: the
//! mean of its surroundings, from a summed-area table, gives an estimate. Virtual objects, lights
//! and shadows are drawn in the same exposure.
//!
//! `choice` says which exposure is requested; `meter` measures on the GPU what virtual lights add;
//! `control` turns that into an automatic exposure; `region` holds the constants of the estimate of
//! clipped light; `stage` owns the passes and runs them as one step of the frame.

pub(crate) mod choice;
mod control;
mod meter;
pub(crate) mod region;
pub(crate) mod stage;

pub use choice::{ActiveExposure, Exposure, MAX_STOPS};
pub use control::{AutoLimits, Brightness};
