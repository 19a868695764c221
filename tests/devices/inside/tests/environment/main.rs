//! Checks the devices of the guest, on which the other tests rely, by using the kernel directly.
#![expect(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // a test has no rig to start its threads

mod serial_port;
mod uvc;
mod uvc_faults;
mod vivid;

use penumbra_guest::rig::SCENE;
use penumbra_guest::v4l2::{
    AUTO_EXPOSURE, AUTO_WHITE_BALANCE, Camera, EXPOSURE_TIME, GAIN, WHITE_BALANCE_TEMPERATURE,
};
use std::path::Path;

fn open(path: impl AsRef<Path>, width: u32, height: u32, fourcc: &[u8; 4]) -> Camera {
    let camera = Camera::open(path.as_ref()).unwrap();
    camera.set_format(width, height, fourcc).unwrap();
    camera
}

/// The scene camera with everything that changes its picture locked.
fn locked() -> Camera {
    let camera = open(SCENE, 640, 480, b"MJPG");
    let values = [
        (AUTO_WHITE_BALANCE, 0),
        (AUTO_EXPOSURE, 1),
        (WHITE_BALANCE_TEMPERATURE, 5000),
        (EXPOSURE_TIME, 157),
        (GAIN, 32),
    ];
    for (id, value) in values {
        camera.set(id, value).unwrap();
    }
    camera
}
