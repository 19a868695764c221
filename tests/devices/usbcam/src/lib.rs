//! Emulated USB webcams, for tests against the kernel's own camera driver.
//!
//! Each camera speaks USB/IP to the kernel's virtual host controller (`vhci_hcd`) over a
//! socket pair, so that usbcore and uvcvideo do with it what they do with a camera on a
//! cable. [`usbip`] is that wire and [`link`] the order of its answers; [`descriptors`] is
//! what the camera says it is; [`controls`] are its knobs, with their automatic modes;
//! [`stream`] agrees on a format and cuts frames into payloads; [`picture`] is what the
//! sensor sees, which [`jpeg`] spells; [`camera`] puts them together, [`bus`] plugs and
//! unplugs, and [`command`] is what a test may ask for.

// A test device has no rig to start its threads, and `main` alone would be too late to.
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

/// The request is one that the device does not know or cannot do now: USB's STALL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// What a mutex holds, also after a thread died with it: a test sees that by its own means.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
