//! A simulated FreeD unit.

use glam::DMat3;
use penumbra_interface::RigidTransform;

/// The state of the unit.
#[derive(Clone, Debug)]
pub(crate) struct Freed {
    streaming: bool,
    /// The beginning of a command.
    command: Vec<u8>,
}

impl Freed {
    /// A unit on a serial line waits for a command; a unit that sends datagrams cannot.
    pub(crate) fn new(streaming: bool) -> Self {
        Self {
            streaming,
            command: Vec::new(),
        }
    }

    pub(crate) fn is_streaming(&self) -> bool {
        self.streaming
    }

    /// Executes commands (D0: `D0`, camera, command, checksum) and appends the answers.
    pub(crate) fn receive(&mut self, bytes: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        for &byte in bytes {
            if self.command.is_empty() && byte != 0xd0 {
                continue;
            }
            self.command.push(byte);
            if let [_, camera, command, _] = *self.command.as_slice() {
                let sum = self
                    .command
                    .iter()
                    .fold(0_u8, |sum, b| sum.wrapping_add(*b));
                if sum == 0x40 && matches!(camera, 1 | 0xff) {
                    self.execute(command, pose, out);
                }
                self.command.clear();
            }
        }
    }

    fn execute(&mut self, command: u8, pose: RigidTransform, out: &mut Vec<u8>) {
        match command {
            0x00 => self.streaming = false,
            0x01 => self.streaming = true,
            0xd1 => Self::record(pose, out),
            _ => {}
        }
    }

    /// Appends a D1 message. The pose is that of a camera with axes right, forward and up; its
    /// angles follow from R = Rz(−pan) · Rx(tilt) · Ry(roll).
    pub(crate) fn record(pose: RigidTransform, out: &mut Vec<u8>) {
        let r = DMat3::from_quat(pose.rotation);
        let pan = r.y_axis.x.atan2(r.y_axis.y);
        let tilt = r.y_axis.z.clamp(-1.0, 1.0).asin();
        let roll = (-r.x_axis.z).atan2(r.z_axis.z);
        let start = out.len();
        out.extend([0xd1, 1]);
        for angle in [pan, tilt, roll] {
            number(angle.to_degrees() * 32768.0, out);
        }
        for metres in pose.translation.to_array() {
            number(metres * 64_000.0, out);
        }
        number(2048.0, out);
        number(1024.0, out);
        out.extend([0, 0]);
        let sum = out[start..]
            .iter()
            .fold(0_u8, |sum, b| sum.wrapping_add(*b));
        out.push(0x40_u8.wrapping_sub(sum));
    }
}

/// Appends a 24-bit big-endian number.
fn number(counts: f64, out: &mut Vec<u8>) {
    let counts = counts.round() as i32;
    out.extend(&counts.to_be_bytes()[1..]);
}
