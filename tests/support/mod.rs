//! Helpers of several integration tests.
#![allow(dead_code)]

pub mod board;
pub mod chromium;
pub mod show;
