//! Shadowing planes on the GPU (Kakuta et al. 2004, 2007).

pub mod luminance;
