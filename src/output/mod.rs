//! Receives a finished picture and draws nothing.

pub mod stream;
