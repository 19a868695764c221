//! The commands to a FreeD unit (D0): `D0`, the camera's number, the command and a checksum
//! as in D1.

use crate::settings::{PortName, TrackerSettings};
use crate::step::Step;
use std::time::Duration;

/// Stops the stream.
pub(crate) const STOP: u8 = 0x00;
/// Starts the stream.
pub(crate) const START: u8 = 0x01;
/// Addresses any camera.
const ANY_CAMERA: u8 = 0xff;

/// Starts the stream on a serial line. Units that send datagrams do so without being asked.
pub(crate) fn start_sequence(settings: &TrackerSettings) -> Vec<Step> {
    let mut steps = Vec::new();
    if matches!(settings.port, PortName::Serial(_)) {
        steps.push(Step::Send(command(START).to_vec()));
    }
    steps.push(Step::AwaitRecords(Duration::from_secs(2)));
    steps
}

/// The bytes of a command to any camera.
pub(crate) fn command(command: u8) -> [u8; 4] {
    let sum = 0xd0_u8.wrapping_add(ANY_CAMERA).wrapping_add(command);
    [0xd0, ANY_CAMERA, command, 0x40_u8.wrapping_sub(sum)]
}
