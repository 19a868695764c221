//! Helpers of the tests inside the guest of `make test-devices`.
//!
//! [`v4l2`] accesses the kernel's cameras and [`serial`] its serial ports, without Penumbra's
//! drivers, so that tests of the guest do not depend on them; [`rig`] finds the devices and
//! controls the faults of the emulated cameras. [`program`] runs Penumbra, and [`recording`] reads
//! its recordings.
#![expect(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(clippy::disallowed_methods)] // a test has no rig to start its threads

pub mod program;
pub mod recording;
pub mod rig;
pub mod serial;
pub mod v4l2;
