//! Boards as a known camera would see them, for tests.

use super::{Board, Grey, Lens};
use glam::{DQuat, DVec2, DVec3};
use penumbra_interface::RigidTransform;

/// Samples to each side within a pixel.
const SAMPLES: u32 = 3;

/// A camera whose rays are worked out once for many pictures.
pub(crate) struct Draughtsman {
    width: u32,
    height: u32,
    rays: Vec<Option<DVec3>>,
    /// Angle between samples, radians.
    spacing: f64,
}

impl Draughtsman {
    pub fn new(lens: &Lens) -> Self {
        let mut rays = Vec::new();
        for y in 0..lens.height * SAMPLES {
            for x in 0..lens.width * SAMPLES {
                let sample = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                rays.push(lens.unproject(sample / f64::from(SAMPLES) - 0.5));
            }
        }
        Self {
            width: lens.width,
            height: lens.height,
            rays,
            spacing: 1.0 / (lens.focal.x * f64::from(SAMPLES)),
        }
    }

    /// The board on a grey wall, blurred by `blur` pixels, with noise of `noise` codes.
    pub fn draw(&self, board: &Board, pose: RigidTransform, blur: f32, noise: f64) -> Grey {
        let Board::Chess {
            columns,
            rows,
            square,
        } = *board
        else {
            return Grey::from_bytes(self.width as usize, self.height as usize, &[]);
        };
        let board_from_camera = pose.inverse();
        let origin = board_from_camera.translation;
        let squares = (f64::from(columns) + 1.0, f64::from(rows) + 1.0);
        let brightness = |ray: Option<DVec3>| {
            let Some(ray) = ray else { return 10.0 };
            let ray = board_from_camera.rotation * ray;
            let t = -origin.z / ray.z;
            if t.is_nan() || t <= 0.0 {
                return 90.0;
            }
            // In squares from the board's outer corner; its first square is dark.
            let p = (origin + ray * t).truncate() / square + 1.0;
            let margin = 0.7;
            let (x, y) = (p.x, p.y);
            if x < -margin || y < -margin || x > squares.0 + margin || y > squares.1 + margin {
                90.0
            } else if x < 0.0 || y < 0.0 || x > squares.0 || y > squares.1 {
                215.0
            } else {
                // An edge falls between samples: each stands for its surroundings.
                let width = t * self.spacing / square;
                122.5 - 92.5 * wave(x, width) * wave(y, width)
            }
        };
        let mut sharp = Grey::from_bytes(self.width as usize, self.height as usize, &[]);
        let wide = self.width * SAMPLES;
        for y in 0..self.height {
            for x in 0..self.width {
                let mut sum = 0.0;
                for j in 0..SAMPLES {
                    for i in 0..SAMPLES {
                        let at = (y * SAMPLES + j) * wide + x * SAMPLES + i;
                        sum += brightness(self.rays[at as usize]);
                    }
                }
                let at = (y * self.width + x) as usize;
                sharp.data[at] = (sum / f64::from(SAMPLES * SAMPLES)) as f32;
            }
        }
        let mut out = if blur > 0.0 {
            sharp.blurred(blur)
        } else {
            sharp
        };
        let mut random = Random::new(pose.translation.x.to_bits() ^ pose.translation.z.to_bits());
        for value in &mut out.data {
            let noisy = f64::from(*value) + noise * random.normal();
            *value = noisy.round().clamp(0.0, 255.0) as f32;
        }
        out
    }
}

/// 1 in even squares, −1 in odd ones, a ramp of this width between them.
fn wave(x: f64, width: f64) -> f64 {
    let sign = if x.rem_euclid(2.0) < 1.0 { 1.0 } else { -1.0 };
    let from_edge = (x - x.round()).abs();
    sign * (2.0 * from_edge / width).min(1.0)
}

/// A board whose middle stands at `centre` (camera frame, metres), tilted by angles about X
/// and Y and turned about Z, radians.
pub(crate) fn pose(board: &Board, centre: DVec3, tilt: DVec2, turn: f64) -> RigidTransform {
    let Board::Chess {
        columns,
        rows,
        square,
    } = *board
    else {
        return RigidTransform::IDENTITY;
    };
    let rotation = DQuat::from_rotation_x(tilt.x)
        * DQuat::from_rotation_y(tilt.y)
        * DQuat::from_rotation_z(turn);
    let middle = DVec3::new(f64::from(columns) - 1.0, f64::from(rows) - 1.0, 0.0) * 0.5 * square;
    RigidTransform::new(rotation, centre - rotation * middle)
}

/// Numbers that are the same in every run (SplitMix64).
pub(crate) struct Random(u64);

impl Random {
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// From 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Between two values.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Standard normal (Box & Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().max(1e-300).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Each component standard normal.
    pub fn normal3(&mut self) -> DVec3 {
        DVec3::new(self.normal(), self.normal(), self.normal())
    }
}
