//! What the tests inside the guest of `make test-devices` need.
//!
//! [`v4l2`] speaks to the kernel's cameras and [`serial`] to its serial ports, without
//! Penumbra's drivers, so that a test of the guest itself proves the guest; [`rig`] finds the
//! devices and has the emulated cameras misbehave. [`program`] runs Penumbra, and
//! [`recording`] reads what it recorded.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(clippy::disallowed_methods)] // a test has no rig to start its threads

pub mod program;
pub mod recording;
pub mod rig;
pub mod serial;
pub mod v4l2;
