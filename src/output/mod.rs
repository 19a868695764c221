//! Receives a finished picture and draws nothing.

pub mod files;
pub mod stream;
mod surface;
pub mod window;
