//! A Flock of Birds' side of its protocol.

use crate::fastrak::mirrored;
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;
use std::f64::consts::PI;

/// Full scale of the standard transmitter, metres.
const FULL_SCALE: f64 = 36.0 * 0.0254;

/// What the device has been told. One bird, address 1.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flock {
    streaming: bool,
    angles: bool,
    group: bool,
    hemisphere: Option<DVec3>,
    /// A command that waits for its parameters.
    command: Vec<u8>,
}

impl Flock {
    pub(crate) fn set_as(&mut self, protocol: &str) {
        self.angles = protocol.contains("angles");
        self.group = protocol.contains("group");
    }

    pub(crate) fn is_streaming(&self) -> bool {
        self.streaming
    }

    /// Takes commands: a byte, some with parameters of a known number.
    pub(crate) fn receive(&mut self, bytes: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        for &byte in bytes {
            // RS232-to-FBB: the next command is for the bird with this address.
            if self.command.is_empty() && byte & 0xf0 == 0xf0 {
                continue;
            }
            self.command.push(byte);
            if self.command.len() > parameters(&self.command) {
                let command = std::mem::take(&mut self.command);
                self.carry_out(&command, pose, out);
            }
        }
    }

    fn carry_out(&mut self, command: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        match *command {
            [b'B'] => {
                self.streaming = false;
                self.record(pose, out);
            }
            [b'@'] => self.streaming = true,
            [b'Y'] => self.angles = true,
            [b']'] => self.angles = false,
            [b'O', 1] => out.extend([3, 60]),
            [b'O', _] => out.extend([0, 0]),
            [b'L', axis, sign] => {
                let axis = match axis {
                    0x00 => DVec3::X,
                    0x06 => DVec3::Y,
                    _ => DVec3::Z,
                };
                self.hemisphere = Some(if sign == 0 { axis } else { -axis });
            }
            [b'P', 0x23, group] => self.group = group != 0,
            _ => {}
        }
    }

    pub(crate) fn record(&self, pose: RigidTransform, out: &mut Vec<u8>) {
        let pose = mirrored(pose, self.hemisphere.unwrap_or(DVec3::X));
        let start = out.len();
        for value in (pose.translation / FULL_SCALE).to_array() {
            word(value, out);
        }
        if self.angles {
            let (a, e, r) = pose.rotation.to_euler(EulerRot::ZYX);
            [a, e, r]
                .into_iter()
                .for_each(|angle| word(angle / PI, out));
        } else {
            let DQuat { x, y, z, w } = pose.rotation;
            [w, x, y, z].into_iter().for_each(|value| word(value, out));
        }
        out[start] |= 0x80;
        out.extend(self.group.then_some(1));
    }
}

/// Parameters that a command takes.
fn parameters(command: &[u8]) -> usize {
    match command {
        [b'L', ..] | [b'P', 0x23 | 0x32, ..] => 2,
        [b'O' | b'P', ..] => 1,
        _ => 0,
    }
}

/// A fraction of full scale as two bytes of seven bits, the lesser one first.
fn word(fraction: f64, out: &mut Vec<u8>) {
    let word = (fraction * 32768.0).round().clamp(-32768.0, 32767.0) as i16;
    let bits = word.cast_unsigned();
    out.extend([(bits >> 2 & 0x7f) as u8, (bits >> 9 & 0x7f) as u8]);
}
