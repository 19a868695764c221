//! The program with the kernel's own devices: what it finds, records, and lives through.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(clippy::disallowed_methods)] // a test has no rig to start its threads

mod cost;
mod devices;
mod faults;
mod record;
mod setup;
