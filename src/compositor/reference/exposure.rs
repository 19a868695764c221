//! The camera's picture in another exposure, with plain sums over entire regions instead of a
//! table.

use super::super::exposure::Exposure;
use super::super::exposure::region::{BLOCK, Region, estimate as e, trust};
use super::super::frame_input::FrameInput;
use glam::{DVec3, DVec4};
use penumbra_camera::Response;
use penumbra_numerics::smoothstep;
use penumbra_picture::Picture;
use penumbra_scene::Highlights;

const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Returns the factor on linear light. An automatic exposure depends on earlier pictures, which the
/// twin does not have: it uses the camera's exposure.
#[must_use]
pub fn factor(input: &FrameInput<'_>) -> f32 {
    match input.exposure {
        Exposure::Stops(stops) if input.show_virtual => stops.exp2(),
        _ => 1.0,
    }
}

/// Returns the linear light of every pixel, row by row, with all light multiplied by `factor`;
/// above 1 where the pixel becomes white.
#[must_use]
pub fn exposed(
    picture: &Picture,
    response: &Response,
    factor: f32,
    highlights: Highlights,
) -> Vec<DVec3> {
    let region = Region::for_factor(factor, picture.height);
    if highlights == Highlights::Paper && factor < 1.0 {
        return by_paper(picture, response, factor, region);
    }
    let trusted = f64::from(trust(factor));
    let blocks = Blocks::new(picture, response, region, around);
    let pixels = (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| (x, y)));
    pixels
        .map(|(x, y)| {
            let codes = picture.rgb(x, y);
            let linear = DVec3::from(response.linear_from_rgb(codes).map(f64::from));
            let clipped = clipped(codes);
            if factor >= 1.0 || clipped == DVec3::ZERO {
                return linear * f64::from(factor);
            }
            let level = level(linear, clipped, blocks.around(x, y));
            (linear + clipped * trusted * (level.max(linear) - linear)) * f64::from(factor)
        })
        .collect()
}

/// The paper's rule: the factor rises from `factor` to 1 with the mean intensity of a region that
/// grows with the darkening (DiVerdi and Höllerer 2004, section 4.3).
fn by_paper(picture: &Picture, response: &Response, factor: f32, region: Region) -> Vec<DVec3> {
    let blocks = Blocks::new(picture, response, region, |region, _| {
        DVec4::W * (region.intensity / region.pixels)
    });
    let factor = f64::from(factor);
    let pixels = (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| (x, y)));
    pixels
        .map(|(x, y)| {
            let linear = response.linear_from_rgb(picture.rgb(x, y)).map(f64::from);
            let mean = blocks.around(x, y).w;
            DVec3::from(linear) * (factor + (1.0 - factor) * mean)
        })
        .collect()
}

fn clipped(codes: [u8; 3]) -> DVec3 {
    let (from, to) = (f64::from(e::CLIPPED_FROM), f64::from(e::CLIPPED_TO));
    DVec3::from(codes.map(|c| ((f64::from(c) - from) / (to - from)).clamp(0.0, 1.0)))
}

/// Estimates the light of a pixel's clipped channels: from its unclipped channels and the colour of
/// its surroundings where these are reliable, else from the surroundings' height above white.
fn level(linear: DVec3, clipped: DVec3, around: DVec4) -> DVec3 {
    let reliable = DVec3::ONE - clipped;
    let colour = around.truncate();
    let scale = reliable.dot(linear) / reliable.dot(colour).max(1e-6);
    let by_colour = (colour * scale).clamp(DVec3::ONE, DVec3::splat(f64::from(e::MAX_BY_COLOUR)));
    let by_region = 1.0 + around.w;
    let known = reliable.element_sum().clamp(0.0, 1.0) * colour.max_element();
    DVec3::from(
        by_colour
            .to_array()
            .map(|c| by_region.powf(1.0 - known) * c.powf(known)),
    )
}

/// Sums over a block or a region.
#[derive(Clone, Copy, Default)]
struct Sums {
    colour: DVec3,
    clipped: f64,
    reliable: f64,
    reliable_squared: f64,
    intensity: f64,
    pixels: f64,
}

impl Sums {
    fn add(&mut self, other: &Self, weight: f64) {
        self.colour += other.colour * weight;
        self.clipped += other.clipped * weight;
        self.reliable += other.reliable * weight;
        self.reliable_squared += other.reliable_squared * weight;
        self.intensity += other.intensity * weight;
        self.pixels += other.pixels * weight;
    }

    fn pixel(codes: [u8; 3], response: &Response) -> Self {
        let linear = DVec3::from(response.linear_from_rgb(codes).map(f64::from));
        let (clipped, y) = (clipped(codes), linear.dot(LUMINANCE));
        let reliable = (1.0 - clipped.min_element()) * y;
        Self {
            colour: linear * (y * (1.0 - clipped.max_element())),
            clipped: clipped.max_element(),
            reliable,
            reliable_squared: reliable * y,
            intensity: linear.element_sum() / 3.0,
            pixels: 1.0,
        }
    }

    /// Estimated light above white of clipped pixels in this region.
    fn excess(&self) -> f64 {
        let min_light = f64::from(e::MIN_LIGHT) * self.pixels;
        let surround = (self.reliable_squared + min_light * f64::from(e::DEFAULT_LUMINANCE))
            / (self.reliable + min_light);
        let edge = (1.0 - surround).clamp(0.0, 1.0);
        let size = smoothstep(
            f64::from(e::SMALL_SHARE),
            f64::from(e::LARGE_SHARE),
            self.clipped / self.pixels,
        );
        let small = f64::from(e::SMALL_EXCESS);
        edge * edge * (small + (f64::from(e::LARGE_EXCESS) - small) * size)
    }

    /// 1 where the light of the neighbourhood rises gradually to the clipped pixels.
    fn gentleness(&self) -> f64 {
        let free = 1.0 - self.clipped / self.pixels;
        let mean = self.reliable / self.pixels / (free + 1e-3);
        smoothstep(f64::from(e::SHARP), f64::from(e::GENTLE), mean)
            * (free / f64::from(e::MIN_UNCLIPPED_FRACTION)).clamp(0.0, 1.0)
    }
}

/// Colour of the unclipped pixels, whose greatest channel is its confidence, and the clipped light
/// above white.
fn around(region: &Sums, near: &Sums) -> DVec4 {
    let far = f64::from(e::FAR_COLOUR);
    let colour = near.colour / near.pixels + far * region.colour / region.pixels;
    let colour = colour / (colour.max_element() + far * f64::from(e::MIN_LIGHT));
    colour.extend(region.excess() * (1.0 - near.gentleness()))
}

/// The surroundings of each block.
struct Blocks {
    across: i64,
    down: i64,
    around: Vec<DVec4>,
}

impl Blocks {
    /// `of` computes the result from the sums of a region and of the neighbourhood.
    fn new(
        picture: &Picture,
        response: &Response,
        region: Region,
        of: impl Fn(&Sums, &Sums) -> DVec4,
    ) -> Self {
        let across = i64::from(picture.width.div_ceil(BLOCK));
        let down = i64::from(picture.height.div_ceil(BLOCK));
        let mut sums = vec![Sums::default(); (across * down) as usize];
        for (x, y) in (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| (x, y))) {
            let block = i64::from(y / BLOCK) * across + i64::from(x / BLOCK);
            sums[block as usize].add(&Sums::pixel(picture.rgb(x, y), response), 1.0);
        }
        let share = f64::from(region.share);
        let mut around = Vec::with_capacity(sums.len());
        for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
            let reach = i64::from(region.reach);
            let inside = |r: i64| {
                let rows = (y - r).max(0)..=(y + r).min(down - 1);
                let mut all = Sums::default();
                for v in rows {
                    for u in (x - r).max(0)..=(x + r).min(across - 1) {
                        all.add(&sums[(v * across + u) as usize], 1.0);
                    }
                }
                all
            };
            let mut both = Sums::default();
            both.add(&inside(reach), 1.0 - share);
            both.add(&inside(reach + 1), share);
            around.push(of(&both, &inside(i64::from(region.near))));
        }
        Self {
            across,
            down,
            around,
        }
    }

    /// Interpolates at a pixel's centre between the centres of blocks.
    fn around(&self, x: u32, y: u32) -> DVec4 {
        let position = |v: u32| (f64::from(v) + 0.5) / f64::from(BLOCK) - 0.5;
        let (u, v) = (position(x), position(y));
        let at = |i: i64, j: i64| {
            let (i, j) = (i.clamp(0, self.across - 1), j.clamp(0, self.down - 1));
            self.around[(j * self.across + i) as usize]
        };
        let (i, j) = (u.floor() as i64, v.floor() as i64);
        let row = |j: i64| at(i, j).lerp(at(i + 1, j), u - u.floor());
        row(j).lerp(row(j + 1), v - v.floor())
    }
}
