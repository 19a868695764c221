//! Constants and regions of the estimate of clipped light, shared by the shaders and the reference.

/// Workgroups of the exposure meter, each with sums of its own.
pub const METER_GROUPS: u32 = 64;

/// Side of a block, pixels; `BLOCK_LOG` in the shader.
pub const BLOCK: u32 = 4;

/// The widest region, as a share of the picture's height: what surrounds a window of that
/// size can still be seen from its middle.
const WIDEST: f32 = 1.0 / 3.0;

/// No region is wider, pixels: with the next ring of blocks it has 255 each way, of which a sum
/// still fits 32 bits.
const MOST_PIXELS: f32 = 1012.0;

/// What is close by reaches one block for so many rows of the picture.
const NEAR: u32 = 160;

/// A region around a block, as two whole ones and how they are mixed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Blocks beyond the middle one, each way.
    pub reach: u32,
    /// Share of the region that reaches one block farther.
    pub share: f32,
    /// Blocks of what is close by, each way: two or three hundredths of the picture's height.
    pub near: u32,
}

impl Region {
    /// One pixel where nothing is darkened, growing linearly with what is taken away, as in the
    /// paper; never less than a block.
    pub fn for_factor(factor: f32, height: u32) -> Self {
        let widest = (height as f32 * WIDEST).min(MOST_PIXELS);
        let side = 1.0 + (1.0 - factor).clamp(0.0, 1.0) * (widest - 1.0).max(0.0);
        let reach = 0.5 * (side / BLOCK as f32 - 1.0).max(0.0);
        Self {
            reach: reach as u32,
            share: reach.fract(),
            near: (height / NEAR).clamp(1, 126),
        }
    }
}

/// How much of the estimate of clipped light counts: all of it from a fifth of a stop on, and none
/// where nothing is darkened, so that nothing jumps when the exposure leaves the camera's own.
pub const fn trust(factor: f32) -> f32 {
    (8.0 * (1.0 - factor)).clamp(0.0, 1.0)
}

/// What the estimate of clipped light goes by; found on the bracketed pictures of rendered
/// surroundings, where the truth is known.
pub mod estimate {
    /// From this code on a channel may be clipped; at [`CLIPPED_TO`] it is.
    pub const CLIPPED_FROM: f32 = 243.0;
    pub const CLIPPED_TO: f32 = 250.0;
    /// Above white, linear, in dark surroundings: of clipped areas that fill less than
    /// [`SMALL_SHARE`] of their region, and of those that fill more than [`LARGE_SHARE`].
    pub const SMALL_EXCESS: f32 = 16.0;
    pub const LARGE_EXCESS: f32 = 3.0;
    pub const SMALL_SHARE: f32 = 0.01;
    pub const LARGE_SHARE: f32 = 0.08;
    /// Mean light (squared, for colours) of surroundings that hardly tell anything, and how bright
    /// those are taken to be: dark, so that the middle of a large clipped area stays white.
    pub const FAINT: f32 = 1e-4;
    pub const USUAL: f32 = 0.25;
    /// Next to the mean of what is close by, that of the whole region counts so much for colours.
    pub const FAR_COLOUR: f32 = 0.05;
    /// Mean luminance of what is close by and not clipped: up to this at a sharp edge, from
    /// [`GENTLE`] on where light rises gently; of which a share of 1 / [`ENOUGH`] is enough.
    pub const SHARP: f32 = 0.5;
    pub const GENTLE: f32 = 0.9;
    pub const ENOUGH: f32 = 8.0;
    /// Greatest light of a channel that the pixel's other channels ask for.
    pub const MOST_BY_COLOUR: f32 = 8.0;
}

/// The same for the shaders.
pub fn constants() -> String {
    use estimate as e;
    let floats = [
        ("CLIPPED_FROM", e::CLIPPED_FROM),
        ("CLIPPED_TO", e::CLIPPED_TO),
        ("SMALL_EXCESS", e::SMALL_EXCESS),
        ("LARGE_EXCESS", e::LARGE_EXCESS),
        ("SMALL_SHARE", e::SMALL_SHARE),
        ("LARGE_SHARE", e::LARGE_SHARE),
        ("FAINT", e::FAINT),
        ("USUAL", e::USUAL),
        ("FAR_COLOUR", e::FAR_COLOUR),
        ("SHARP", e::SHARP),
        ("GENTLE", e::GENTLE),
        ("ENOUGH", e::ENOUGH),
        ("MOST_BY_COLOUR", e::MOST_BY_COLOUR),
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
    fn a_region_grows_from_a_block_with_what_is_taken_away() {
        let blocks = |factor: f32, height| {
            let r = Region::for_factor(factor, height);
            2.0 * (r.reach as f32 + r.share) + 1.0
        };
        assert_eq!(blocks(1.0, 480), 1.0);
        assert_eq!(blocks(2.0, 480), 1.0);
        assert!((blocks(0.0, 480) - 40.0).abs() < 1e-4);
        assert!((blocks(0.5, 480) - 20.125).abs() < 1e-4);
        assert!((blocks(0.25, 480) - 30.0625).abs() < 1e-4);
        // However large the picture is, sums over a region fit 32 bits.
        assert!(blocks(0.0, 4320) <= 255.0);
        let whole = Region::for_factor(0.0, u32::MAX);
        assert!(u64::from(2 * whole.reach + 3).pow(2) * 16 * 4096 < 1 << 32);
        assert_eq!(blocks(0.0, 1), 1.0);
    }
}
