//! What the queues wait, count and start threads with: the standard library and crossbeam. Under the
//! feature `model`, which only tests set, the same names are those of the model checker shuttle,
//! which runs the code under schedules of its choice.

#[cfg(feature = "model")]
mod model;
#[cfg(not(feature = "model"))]
mod real {
    pub use crossbeam_channel as channel;
    pub use penumbra_interface::threads;
    pub use std::sync::atomic;
    pub use std::sync::{Condvar, Mutex, MutexGuard};
    pub use std::thread::JoinHandle;
}

#[cfg(feature = "model")]
pub use model::*;
#[cfg(not(feature = "model"))]
pub use real::*;

/// The limit of a queue; in the model `in_model`, so that a few steps reach it.
#[must_use]
pub const fn limit(limit: usize, in_model: usize) -> usize {
    if cfg!(feature = "model") {
        in_model
    } else {
        limit
    }
}
