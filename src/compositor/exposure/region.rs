//! Constants and regions of the estimate of clipped light, shared by the shaders and the reference.

/// Workgroups of the exposure meter, each with sums of its own.
pub const METER_GROUPS: u32 = 64;

/// Side of a block, pixels; `BLOCK_LOG` in the shader.
pub const BLOCK: u32 = 4;

/// Maximum width of a region, as a fraction of the picture's height: from the middle of a window of
/// that size, the region still reaches its surroundings.
const MAX_HEIGHT_FRACTION: f32 = 1.0 / 3.0;

/// Maximum width of a region, pixels: with the next ring of blocks it spans 255 blocks, whose sum
/// still fits 32 bits.
const MAX_PIXELS: f32 = 1012.0;

/// Rows of the picture per block of the neighbourhood's reach.
const ROWS_PER_NEAR_BLOCK: u32 = 160;

/// A region around a block of fractional width: two regions of whole blocks, and their mix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Blocks beyond the middle one in each direction, of the smaller region.
    pub reach: u32,
    /// Share of the larger region, which reaches one block farther.
    pub share: f32,
    /// Blocks of the neighbourhood in each direction: 2 to 3 % of the picture's height.
    pub near: u32,
}

impl Region {
    /// Returns the region for an exposure `factor` on linear light and a picture `height` in
    /// pixels: its width grows linearly from one pixel at factor 1 to the maximum at 0, as in the
    /// paper, but is at least a block.
    pub fn for_factor(factor: f32, height: u32) -> Self {
        let widest = (height as f32 * MAX_HEIGHT_FRACTION).min(MAX_PIXELS);
        let side = 1.0 + (1.0 - factor).clamp(0.0, 1.0) * (widest - 1.0).max(0.0);
        let reach = 0.5 * (side / BLOCK as f32 - 1.0).max(0.0);
        Self {
            reach: reach as u32,
            share: reach.fract(),
            near: (height / ROWS_PER_NEAR_BLOCK).clamp(1, 126),
        }
    }
}

/// Weight of the estimate of clipped light: 1 from a darkening of a fifth of a stop on, and 0
/// without darkening, so that the picture is continuous where the exposure leaves the camera's own.
pub const fn trust(factor: f32) -> f32 {
    (8.0 * (1.0 - factor)).clamp(0.0, 1.0)
}

/// Parameters of the estimate of clipped light, tuned on the bracketed pictures of rendered
/// surroundings, whose ground truth is known.
pub mod estimate {
    /// Code from which a channel may be clipped.
    pub const CLIPPED_FROM: f32 = 243.0;
    /// Code from which a channel is certainly clipped.
    pub const CLIPPED_TO: f32 = 250.0;
    /// Linear light above white in dark surroundings: of clipped areas that fill less than
    /// [`SMALL_SHARE`] of their region, and of those that fill more than [`LARGE_SHARE`].
    pub const SMALL_EXCESS: f32 = 16.0;
    pub const LARGE_EXCESS: f32 = 3.0;
    pub const SMALL_SHARE: f32 = 0.01;
    pub const LARGE_SHARE: f32 = 0.08;
    /// Minimum mean light (squared, for colours) of reliable surroundings; it regularises the
    /// division by that mean.
    pub const MIN_LIGHT: f32 = 1e-4;
    /// Luminance that is assumed for unreliable surroundings: dark, so that the middle of a large
    /// clipped area stays white.
    pub const DEFAULT_LUMINANCE: f32 = 0.25;
    /// Weight of the entire region's mean colour relative to the neighbourhood's.
    pub const FAR_COLOUR: f32 = 0.05;
    /// Mean luminance of the unclipped part of the neighbourhood: at most [`SHARP`] at a sharp
    /// edge, at least [`GENTLE`] where light rises gradually.
    pub const SHARP: f32 = 0.5;
    pub const GENTLE: f32 = 0.9;
    /// Minimum unclipped fraction of the neighbourhood for full weight of its luminance.
    pub const MIN_UNCLIPPED_FRACTION: f32 = 0.125;
    /// Maximum linear light of a clipped channel that is inferred from the pixel's other channels.
    pub const MAX_BY_COLOUR: f32 = 8.0;
}

/// Returns the constants as WGSL declarations.
pub fn constants() -> String {
    use estimate as e;
    let floats = [
        ("CLIPPED_FROM", e::CLIPPED_FROM),
        ("CLIPPED_TO", e::CLIPPED_TO),
        ("SMALL_EXCESS", e::SMALL_EXCESS),
        ("LARGE_EXCESS", e::LARGE_EXCESS),
        ("SMALL_SHARE", e::SMALL_SHARE),
        ("LARGE_SHARE", e::LARGE_SHARE),
        ("MIN_LIGHT", e::MIN_LIGHT),
        ("DEFAULT_LUMINANCE", e::DEFAULT_LUMINANCE),
        ("FAR_COLOUR", e::FAR_COLOUR),
        ("SHARP", e::SHARP),
        ("GENTLE", e::GENTLE),
        ("MIN_UNCLIPPED_FRACTION", e::MIN_UNCLIPPED_FRACTION),
        ("MAX_BY_COLOUR", e::MAX_BY_COLOUR),
    ];
    let mut text = format!("const METER_GROUPS = {}u;\n", METER_GROUPS);
    for (name, value) in floats {
        text += &format!("const {name} = {value:?};\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn region_grows_linearly_with_darkening_from_one_block() {
        let blocks = |factor: f32, height| {
            let r = Region::for_factor(factor, height);
            2.0 * (r.reach as f32 + r.share) + 1.0
        };
        assert_eq!(blocks(1.0, 480), 1.0);
        assert_eq!(blocks(2.0, 480), 1.0);
        assert!((blocks(0.0, 480) - 40.0).abs() < 1e-4);
        assert!((blocks(0.5, 480) - 20.125).abs() < 1e-4);
        assert!((blocks(0.25, 480) - 30.0625).abs() < 1e-4);
        // Sums over a region fit 32 bits for every size of the picture.
        assert!(blocks(0.0, 4320) <= 255.0);
        let largest = Region::for_factor(0.0, u32::MAX);
        assert!(u64::from(2 * largest.reach + 3).pow(2) * 16 * 4096 < 1 << 32);
        assert_eq!(blocks(0.0, 1), 1.0);
    }
}
