//! The program with the kernel's own devices: listing, recording and recovery from faults.
#![expect(clippy::unwrap_used, clippy::panic)]
#![allow(clippy::disallowed_methods)] // a test has no rig to start its threads

mod cost;
mod devices;
mod faults;
mod power;
mod record;
mod setup;
mod webcam;
