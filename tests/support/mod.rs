//! Helpers of several integration tests.
#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod board;
pub mod chromium;
pub mod show;
