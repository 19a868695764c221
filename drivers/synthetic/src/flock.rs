//! A simulated Flock of Birds.

use crate::receivers::{in_hemisphere, receiver_pose};
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;
use std::f64::consts::PI;

/// Full scale of a position with the standard transmitter, metres.
const FULL_SCALE: f64 = 36.0 * 0.0254;

/// Birds on the bus; their addresses are 1 to 4.
const BIRDS: usize = 4;

/// The state of the device. The bird with address 1 has the serial port.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flock {
    streaming: bool,
    group: bool,
    /// Birds that take part in group mode.
    configured: Option<usize>,
    birds: [Bird; BIRDS],
    /// The address that the next command is for.
    addressed: Option<u8>,
    /// The beginning of a command.
    command: Vec<u8>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Bird {
    angles: bool,
    hemisphere: Option<DVec3>,
}

impl Flock {
    /// Sets the mode of a protocol name.
    pub(crate) fn configure_for(&mut self, protocol: &str) {
        for bird in &mut self.birds {
            bird.angles = protocol.contains("angles");
        }
        self.group = protocol.contains("group");
    }

    pub(crate) fn is_streaming(&self) -> bool {
        self.streaming
    }

    /// Executes commands, which are one byte and a known number of parameters, and appends the
    /// answers.
    pub(crate) fn receive(&mut self, bytes: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        for &byte in bytes {
            // RS232-to-FBB: the next command is for the bird with this address.
            if self.command.is_empty() && byte & 0xf0 == 0xf0 {
                self.addressed = Some(byte & 0x0f);
                continue;
            }
            self.command.push(byte);
            if self.command.len() > parameters(&self.command) {
                let command = std::mem::take(&mut self.command);
                self.execute(&command, pose, out);
            }
        }
    }

    fn execute(&mut self, command: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        let address = usize::from(self.addressed.take().unwrap_or(1));
        let Some(bird) = self.birds.get_mut(address.wrapping_sub(1)) else {
            return;
        };
        match *command {
            [b'B'] => {
                self.streaming = false;
                self.records(pose, out);
            }
            [b'@'] => self.streaming = true,
            [b'Y'] => bird.angles = true,
            [b']'] => bird.angles = false,
            [b'O', 1] => out.extend([3, 60]),
            [b'O', _] => out.extend([0, 0]),
            [b'L', axis, sign] => {
                let axis = match axis {
                    0x00 => DVec3::X,
                    0x06 => DVec3::Y,
                    _ => DVec3::Z,
                };
                bird.hemisphere = Some(if sign == 0 { axis } else { -axis });
            }
            [b'P', 0x23, group] => self.group = group != 0,
            [b'P', 0x32, birds] => self.configured = Some(usize::from(birds)),
            _ => {}
        }
    }

    /// Appends one record; in group mode one of every bird that takes part.
    pub(crate) fn records(&self, pose: RigidTransform, out: &mut Vec<u8>) {
        let count = if self.group {
            self.configured.unwrap_or(1)
        } else {
            1
        };
        for (i, bird) in self.birds.iter().take(count).enumerate() {
            bird.record(receiver_pose(pose, i), out);
            out.extend(self.group.then_some(i as u8 + 1));
        }
    }
}

impl Bird {
    fn record(&self, pose: RigidTransform, out: &mut Vec<u8>) {
        let pose = in_hemisphere(pose, self.hemisphere.unwrap_or(DVec3::X));
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
    }
}

/// Number of parameters of a command.
fn parameters(command: &[u8]) -> usize {
    match command {
        [b'L', ..] | [b'P', 0x23 | 0x32, ..] => 2,
        [b'O' | b'P', ..] => 1,
        _ => 0,
    }
}

/// Appends a fraction of full scale as two bytes of seven bits, least significant first.
fn word(fraction: f64, out: &mut Vec<u8>) {
    let word = (fraction * 32768.0).round().clamp(-32768.0, 32767.0) as i16;
    let bits = word.cast_unsigned();
    out.extend([(bits >> 2 & 0x7f) as u8, (bits >> 9 & 0x7f) as u8]);
}
