//! The tracker's cable: both ends of a USB serial port.

use std::fs::{File, OpenOptions};
use std::process::Command;

/// Opens a serial port in raw mode: no echo, no line editing.
pub fn open(path: &str) -> File {
    let raw = Command::new("stty")
        .args(["-F", path, "raw", "-echo"])
        .status();
    assert!(raw.expect("stty runs").success(), "stty {path}");
    OpenOptions::new()
        .read(true)
        .write(true)
        .open(path)
        .unwrap()
}
