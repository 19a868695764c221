//! Encoding and decoding of one D1 message.

use super::axes::Axes;
use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;

/// Length of a D1 message, bytes.
pub const D1_LEN: usize = 29;
/// First byte of a message with position and angles.
pub(crate) const D1: u8 = 0xd1;
/// The sum of all 29 bytes, modulo 256.
const SUM: u8 = 0x40;
const COUNTS_PER_DEGREE: f64 = 32768.0;
const COUNTS_PER_METRE: f64 = 64_000.0;
const MAX_COUNT: f64 = 8_388_607.0;

/// Zoom and focus in units of the lens (24 bits).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lens {
    /// Zoom.
    pub zoom: u32,
    /// Focus.
    pub focus: u32,
}

/// The numbers of a message in their order, in degrees and metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Message {
    /// The camera's number; 255 addresses any.
    pub camera: u8,
    /// Pan, tilt, roll if the sender follows the manual.
    pub angles_degrees: [f64; 3],
    /// X, Y, height if the sender follows the manual.
    pub position_metres: [f64; 3],
    /// Zoom and focus.
    pub lens: Lens,
}

impl Message {
    /// Decodes a message. `None` if it is not a D1 message or its checksum is wrong.
    #[must_use]
    pub fn decode(bytes: &[u8; D1_LEN]) -> Option<Self> {
        let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        let [D1, camera, numbers @ .., _, _, _] = bytes else {
            return None;
        };
        let (numbers, _) = numbers.as_chunks::<3>();
        let [pan, tilt, roll, x, y, z, zoom, focus] = numbers else {
            return None;
        };
        (sum == SUM).then_some(Self {
            camera: *camera,
            angles_degrees: [pan, tilt, roll].map(|n| f64::from(signed(*n)) / COUNTS_PER_DEGREE),
            position_metres: [x, y, z].map(|n| f64::from(signed(*n)) / COUNTS_PER_METRE),
            lens: Lens {
                zoom: unsigned(*zoom),
                focus: unsigned(*focus),
            },
        })
    }

    /// Encodes a message. Numbers beyond the range of their field are clamped.
    #[must_use]
    pub fn encode(&self) -> [u8; D1_LEN] {
        let mut bytes = [0; D1_LEN];
        bytes[0] = D1;
        bytes[1] = self.camera;
        let angles = self.angles_degrees.map(|v| v * COUNTS_PER_DEGREE);
        let positions = self.position_metres.map(|v| v * COUNTS_PER_METRE);
        for (i, count) in angles.into_iter().chain(positions).enumerate() {
            let count = count.round().clamp(-MAX_COUNT - 1.0, MAX_COUNT) as i32;
            bytes[2 + 3 * i..][..3].copy_from_slice(&count.to_be_bytes()[1..]);
        }
        for (i, count) in [self.lens.zoom, self.lens.focus].into_iter().enumerate() {
            let count = count.min(0xff_ffff);
            bytes[20 + 3 * i..][..3].copy_from_slice(&count.to_be_bytes()[1..]);
        }
        let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        bytes[D1_LEN - 1] = SUM.wrapping_sub(sum);
        bytes
    }

    /// The pose of the camera, in the frame that the module's documentation defines.
    #[must_use]
    pub fn pose(&self, axes: Axes) -> RigidTransform {
        let ([a, b, c], [d, e, f]) = (self.angles_degrees, self.position_metres);
        let [pan, tilt, roll, x, y, z] = axes.to_quantities([a, b, c, d, e, f]);
        let rotation = DQuat::from_rotation_z(-pan.to_radians())
            * DQuat::from_rotation_x(tilt.to_radians())
            * DQuat::from_rotation_y(roll.to_radians());
        RigidTransform::new(rotation, DVec3::new(x, y, z))
    }

    /// The message for a pose.
    #[must_use]
    pub fn from_pose(camera: u8, pose: RigidTransform, axes: Axes, lens: Lens) -> Self {
        let [pan, tilt, roll] = angles_of(pose.rotation);
        let DVec3 { x, y, z } = pose.translation;
        let [a, b, c, d, e, f] = axes.to_fields([pan, tilt, roll, x, y, z]);
        Self {
            camera,
            angles_degrees: [a, b, c],
            position_metres: [d, e, f],
            lens,
        }
    }
}

/// Pan, tilt and roll in degrees.
///
/// The second column of R = Rz(−p) Rx(t) Ry(r) is the direction of view, (sin p cos t,
/// cos p cos t, sin t); its third row is (−cos t sin r, sin t, cos t cos r). When the camera
/// looks straight up or down, pan and roll turn about the same axis, and roll is set to 0.
fn angles_of(rotation: DQuat) -> [f64; 3] {
    let r = DMat3::from_quat(rotation.normalize());
    let forward = r.y_axis;
    let tilt = forward.z.clamp(-1.0, 1.0).asin();
    let (pan, roll) = if forward.z.abs() > 1.0 - 1e-9 {
        ((-r.x_axis.y).atan2(r.x_axis.x), 0.0)
    } else {
        (forward.x.atan2(forward.y), (-r.x_axis.z).atan2(r.z_axis.z))
    };
    [pan, tilt, roll].map(f64::to_degrees)
}

/// A 24-bit number in two's complement.
fn signed(bytes: [u8; 3]) -> i32 {
    (unsigned(bytes) << 8).cast_signed() >> 8
}

fn unsigned([high, middle, low]: [u8; 3]) -> u32 {
    u32::from_be_bytes([0, high, middle, low])
}
