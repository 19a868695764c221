//! Evenly distributed points of the unit disc (Vogel 1979), in lanes of eight.

use crate::layout::BORDERED;
use glam::Vec2;

/// Points that are looked at together.
pub const LANES: usize = 8;

/// Eight points.
#[derive(Clone, Copy)]
pub struct Eight {
    pub x: [f32; LANES],
    pub y: [f32; LANES],
}

/// Points of the unit disc.
pub struct Disc {
    /// For texels, in several rotations.
    points: [Vec<Eight>; ROTATIONS],
    /// For texels between which visibility is interpolated: an error there would be seen on a
    /// whole patch.
    pub many: Vec<Eight>,
}

/// Rotations of the disc; texels use them in turn.
const ROTATIONS: usize = 16;

impl Disc {
    /// Computes discs of `few` and of `many` points, both multiples of eight.
    pub fn new([few, many]: [usize; 2]) -> Self {
        let turn = |r: usize| std::f32::consts::TAU * r as f32 / ROTATIONS as f32;
        Self {
            points: std::array::from_fn(|r| points(few, turn(r))),
            many: points(many, 0.0),
        }
    }

    /// The points for texel `index`; neighbouring texels get different rotations.
    #[inline(always)]
    pub fn rotated(&self, index: usize) -> &[Eight] {
        // A permutation that spreads the rotations over any 4×4 texels.
        let (x, y) = (index % BORDERED, index / BORDERED);
        &self.points[((x & 3) * 5 + (y & 3) * 7 + ((x ^ y) & 1) * 2) % ROTATIONS]
    }
}

fn points(count: usize, turn: f32) -> Vec<Eight> {
    let point = |k: usize| {
        let radius = ((k as f32 + 0.5) / count as f32).sqrt();
        Vec2::from_angle(2.399_963_2 * k as f32 + turn) * radius
    };
    let eight = |first: usize| Eight {
        x: std::array::from_fn(|i| point(first + i).x),
        y: std::array::from_fn(|i| point(first + i).y),
    };
    (0..count).step_by(LANES).map(eight).collect()
}
