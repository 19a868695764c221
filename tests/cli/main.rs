//! Runs the program: the files that it writes, its output, and its one-line errors.

#![expect(clippy::unwrap_used, clippy::panic)]

mod bake;
#[path = "../support/board.rs"]
mod board;
mod calibrate;
mod calibrate_live;
mod calibrate_motion;
mod display;
mod live;
mod live_tracker;
mod photo;
mod photo_page;
mod program;
mod refusals;
mod reload;
mod replay;
mod scenes;
mod service;
mod sessions;
mod setups;
mod simulate;
mod technique;
mod tools;
mod webcam;
mod window;
