//! The program as its users have it: what it writes, what it says, and that a mistake
//! costs one line and nothing else.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod bake;
#[path = "../support/board.rs"]
mod board;
mod calibrate;
mod calibrate_live;
mod calibrate_motion;
mod display;
mod live;
mod live_tracker;
mod program;
mod refusals;
mod reload;
mod replay;
mod service;
mod sessions;
mod setups;
mod simulate;
mod tools;
mod window;
