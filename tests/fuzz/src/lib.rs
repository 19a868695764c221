//! What each fuzz target does with an input: a target in `fuzz_targets` and the test
//! `tests/fuzz_corpus.rs` call the same function. Each gives an error or a result, without a panic;
//! an error is one line.
//!
//! Features divide the modules by their dependencies, which build slowly with sanitizers.

pub mod dialogue;
pub mod trackers;

#[cfg(feature = "session")]
pub mod session;

#[cfg(feature = "files")]
pub mod files;
#[cfg(feature = "files")]
pub mod picture;

#[cfg(feature = "http")]
pub mod http;
