//! Evenly distributed points of the unit disc (Vogel 1979).

use crate::layout::BORDERED;
use glam::Vec2;

/// Points of the unit disc.
pub struct Disc {
    /// For texels, each in one of several rotations.
    pub few: Vec<Vec2>,
    /// For texels between which visibility is interpolated: an error there would be seen on a
    /// whole patch.
    pub many: Vec<Vec2>,
    /// Cosines and sines of the rotations.
    turns: [Vec2; ROTATIONS],
}

/// Rotations of the disc; texels use them in turn.
const ROTATIONS: usize = 16;

impl Disc {
    /// Computes discs of `few` and of `many` points.
    pub fn new([few, many]: [usize; 2]) -> Self {
        let turn = |r: usize| std::f32::consts::TAU * r as f32 / ROTATIONS as f32;
        Self {
            few: points(few),
            many: points(many),
            turns: std::array::from_fn(|r| Vec2::from_angle(turn(r))),
        }
    }

    /// Cosine and sine by which the few points are turned for texel `index`; neighbouring texels
    /// get different rotations.
    #[inline(always)]
    pub fn turn(&self, index: usize) -> Vec2 {
        // A permutation that spreads the rotations over any 4×4 texels.
        let (x, y) = (index % BORDERED, index / BORDERED);
        self.turns[((x & 3) * 5 + (y & 3) * 7 + ((x ^ y) & 1) * 2) % ROTATIONS]
    }
}

fn points(count: usize) -> Vec<Vec2> {
    let point = |k: usize| {
        let radius = ((k as f32 + 0.5) / count as f32).sqrt();
        Vec2::from_angle(2.399_963_2 * k as f32) * radius
    };
    (0..count).map(point).collect()
}
