//! Emulated USB webcams, for tests against the kernel's own camera driver.
//!
//! Each camera speaks USB/IP to the kernel's virtual host controller (`vhci_hcd`) over a socket
//! pair, so that usbcore and uvcvideo treat it like a camera on a cable. [`usbip`] encodes the
//! messages and [`link`] orders the answers; [`descriptors`] holds the USB descriptors;
//! [`controls`] the controls with their automatic modes; [`stream`] negotiates a format and
//! splits frames into payloads; [`picture`] renders what the sensor sees, and [`jpeg`] encodes it;
//! [`camera`] combines them, [`bus`] plugs and unplugs cameras, and [`command`] executes the
//! commands of tests.

// A test device has no rig that starts its threads, so it starts them itself.
#![allow(clippy::disallowed_methods)]

pub mod bus;
pub mod camera;
pub mod command;
pub mod controls;
pub mod descriptors;
pub mod jpeg;
pub mod link;
pub mod picture;
pub mod stream;
pub mod usbip;

/// The device does not know the request or cannot carry it out now: USB's STALL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex, even if it is poisoned: a test notices a dead thread by other means.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
