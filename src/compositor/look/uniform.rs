//! The data that the shaders of the look read.

use super::grain;
use super::input::Look;
use bytemuck::{Pod, Zeroable};
use glam::DVec2;

/// Maximum number of samples of a blur.
pub const MAX_TAPS: usize = 32;
/// Largest extents of blurs, pixels, and the samples that they need.
pub const TAPS: [(f64, usize); 3] = [(3.0, 4), (10.0, 8), (f64::INFINITY, MAX_TAPS)];
/// Pixels on each side of a pixel over which the point spread reaches.
const SPREAD_REACH: f64 = 2.0;

/// Twin of WGSL `Look`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LookUniform {
    pub size: [f32; 4],
    pub reach: [f32; 4],
    pub across: [f32; 4],
    pub down: [f32; 4],
    pub soft_across: [f32; 4],
    pub soft_down: [f32; 4],
    pub read: [f32; 4],
    pub shot: [f32; 4],
    pub grain: [u32; 4],
    pub taps: [[f32; 4]; MAX_TAPS],
}

impl LookUniform {
    /// The uniform of `look` for pictures of `size`, with blurs of up to `extent` pixels sampled by
    /// `taps`, in an exposure of `factor` relative to the camera's.
    pub fn new(look: &Look, size: (u32, u32), (extent, taps): (f64, usize), factor: f32) -> Self {
        let (width, height) = (size.0 as f32, size.1 as f32);
        let spread = look.spread.unwrap_or(penumbra_camera::PointSpread::NONE);
        let (read, shot) = look
            .noise
            .map_or(([0.0; 3], [0.0; 3]), |n| (n.read, n.shot));
        let scaled = |v: [f64; 3], by: f32| v.map(|x| x as f32 * by);
        let [r, g, b] = scaled(read, factor * factor);
        let [sr, sg, sb] = scaled(shot, factor);
        let [x, y] = grain::offset(look.picture);
        Self {
            size: [width, height, 1.0 / width, 1.0 / height],
            reach: reach(look.spread.is_some(), extent).map(|v| v as f32),
            across: row(spread.across),
            down: row(spread.down),
            soft_across: row(without_sharpening(spread.across)),
            soft_down: row(without_sharpening(spread.down)),
            read: [r, g, b, factor],
            shot: [sr, sg, sb, 0.0],
            grain: [x, y, filtered_class(extent), 0],
            taps: samples(taps),
        }
    }
}

/// Largest blur that is left out where shadows alone lie: they are soft themselves.
const MAX_SHARP_SHADOW: f64 = 3.0;

/// The lowest class of tiles whose layers are filtered: 2 = tiles that virtual objects may cover,
/// 1 = all that may have changed.
pub fn filtered_class(extent: f64) -> u32 {
    if extent > MAX_SHARP_SHADOW { 1 } else { 2 }
}

/// Pixels beyond the marked tiles that the layers, the blur, the spread and the finished picture
/// fill: as far as later passes read.
pub fn reach(spreads: bool, extent: f64) -> [f64; 4] {
    let spread = if spreads { SPREAD_REACH } else { 0.0 };
    let blur = (0.5 * extent).ceil();
    let finish = spread + blur;
    let layers = finish + 2.0 * spread + blur;
    // Interpolation reads one more pixel.
    let more = if blur > 0.0 { 1.0 } else { 0.0 };
    [
        layers + more,
        finish + 2.0 * spread,
        finish + spread,
        finish,
    ]
}

fn row([a, b, c]: [f64; 3]) -> [f32; 4] {
    [a as f32, b as f32, c as f32, 0.0]
}

/// Returns the weights without negative ones, with the same sum.
pub fn without_sharpening(weights: [f64; 3]) -> [f64; 3] {
    let [a, b, c] = weights.map(|w| w.max(0.0));
    let sum = a + 2.0 * (b + c);
    [a, b, c].map(|w| w / sum.max(1e-6))
}

/// Samples of a blur: positions along the motion, −0.5 to 0.5, and points of a spiral that fills
/// the unit disc evenly (Vogel 1979), in an order that is independent of those along the motion.
pub fn samples(count: usize) -> [[f32; 4]; MAX_TAPS] {
    const GOLDEN_ANGLE: f64 = 2.399_963_23;
    let points = |k: usize| {
        // An odd step visits each of a power of two.
        let point = (k * 5 + 3) % count;
        let radius = ((point as f64 + 0.5) / count as f64).sqrt();
        DVec2::from_angle(GOLDEN_ANGLE * point as f64) * radius
    };
    // A few points are not balanced by themselves.
    let mean = (0..count).map(points).sum::<DVec2>() / count as f64;
    let mut out = [[0.0; 4]; MAX_TAPS];
    for (k, tap) in out.iter_mut().take(count).enumerate() {
        let along = (k as f64 + 0.5) / count as f64 - 0.5;
        let disc = points(k) - mean;
        *tap = [along as f32, disc.x as f32, disc.y as f32, 0.0];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_have_no_mean_displacement() {
        for count in [4, 8, 32] {
            let taps = samples(count);
            for axis in 0..3 {
                let mean = taps.iter().map(|t| t[axis]).sum::<f32>() / count as f32;
                assert!(mean.abs() < 1e-6, "{count} {axis} {mean}");
            }
        }
    }

    #[test]
    fn every_pass_fills_the_pixels_that_the_next_one_reads() {
        for spreads in [false, true] {
            for extent in [0.0, 3.0, 47.5] {
                let [layers, blur, spread, finish] = reach(spreads, extent);
                let kernel = if spreads { 2.0 } else { 0.0 };
                let half = 0.5 * extent;
                assert!(finish >= half + kernel);
                assert!(spread >= finish + kernel && blur >= spread + kernel);
                assert!(layers >= blur + half);
            }
        }
    }

    #[test]
    fn weights_without_sharpening_are_positive_and_complete() {
        let [a, b, c] = without_sharpening([0.9, 0.15, -0.1]);
        assert!(a > 0.0 && b > 0.0 && c == 0.0);
        assert!((a + 2.0 * (b + c) - 1.0).abs() < 1e-12);
    }
}
