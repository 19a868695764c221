//! D0, the commands to a FreeD unit: `D0`, the camera's number, the command, a checksum as
//! in D1.

use crate::dialogue::Step;
use crate::settings::{PortName, TrackerSettings};
use std::time::Duration;

/// Ends the stream.
pub(crate) const STOP: u8 = 0x00;
/// Starts the stream.
pub(crate) const START: u8 = 0x01;
/// Any camera.
const ANYONE: u8 = 0xff;

/// Starts the stream on a serial line; datagrams come unasked.
pub(crate) fn greeting(settings: &TrackerSettings) -> Vec<Step> {
    let mut steps = Vec::new();
    if matches!(settings.port, PortName::Serial(_)) {
        steps.push(Step::Send(command(START).to_vec()));
    }
    steps.push(Step::Stream(Duration::from_secs(2)));
    steps
}

/// A command to any camera.
pub(crate) fn command(command: u8) -> [u8; 4] {
    let sum = 0xd0_u8.wrapping_add(ANYONE).wrapping_add(command);
    [0xd0, ANYONE, command, 0x40_u8.wrapping_sub(sum)]
}
