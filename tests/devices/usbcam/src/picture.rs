//! Renders the picture of the sensor by its settings.
//!
//! The camera sees a card of 24 patches: 18 colours and a ramp of greys. Exposure and gain scale
//! their light, the white balance scales red against blue, and the picture is encoded in sRGB. So
//! a test can measure from a frame which settings were active during its exposure. The two
//! uppermost rows of blocks encode the frame's number, which no setting changes.

use crate::jpeg::{BLOCK, Blocks, YCbCr, encode};
use crate::stream::{Format, Mode};
use std::collections::VecDeque;

/// Settings of the sensor and its image processor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// Exposure time, 100 µs.
    pub exposure: i32,
    /// Gain, in steps of which [`GAIN_PER_STOP`] double the light.
    pub gain: i32,
    /// White balance temperature, kelvin.
    pub temperature: i32,
    /// Added to the picture's code values.
    pub brightness: i32,
    /// Contrast: scales the code values about their middle; 32 leaves them unchanged.
    pub contrast: i32,
}

/// Steps of the gain control that double the light; its default, 32, leaves it unchanged.
pub const GAIN_PER_STOP: f64 = 32.0;
/// The exposure time at which a white patch just reaches white, 100 µs.
pub const NORMAL_EXPOSURE: f64 = 157.0;
/// Colour temperature of the light, kelvin: a white balance for it renders greys as grey.
pub const LIGHT_TEMPERATURE: f64 = 5000.0;

const COLUMNS: usize = 6;
const ROWS: usize = 4;
/// Linear reflectances; the last row is the ramp of greys.
const CARD: [[f64; 3]; COLUMNS * ROWS] = [
    [0.17, 0.08, 0.06],
    [0.56, 0.30, 0.22],
    [0.11, 0.20, 0.34],
    [0.10, 0.15, 0.05],
    [0.23, 0.22, 0.43],
    [0.13, 0.52, 0.41],
    [0.70, 0.20, 0.03],
    [0.07, 0.10, 0.38],
    [0.54, 0.09, 0.12],
    [0.11, 0.04, 0.14],
    [0.34, 0.50, 0.05],
    [0.76, 0.36, 0.03],
    [0.03, 0.05, 0.28],
    [0.06, 0.29, 0.07],
    [0.43, 0.03, 0.04],
    [0.85, 0.57, 0.02],
    [0.50, 0.09, 0.30],
    [0.02, 0.24, 0.37],
    [0.90, 0.90, 0.90],
    [0.59, 0.59, 0.59],
    [0.36, 0.36, 0.36],
    [0.18, 0.18, 0.18],
    [0.09, 0.09, 0.09],
    [0.03, 0.03, 0.03],
];
/// Index of the patch with 18 % reflectance.
pub const MIDDLE_GREY: usize = 21;

const COUNTER_ROWS: usize = 2;
const COUNTER_BITS: usize = 32;
const BIT_ON: YCbCr = [235, 128, 128];
const BIT_OFF: YCbCr = [16, 128, 128];

/// Delays settings: a new value takes effect `lag` frames late, as in most cameras.
#[derive(Default)]
pub struct Sensor {
    history: VecDeque<Settings>,
    frames: u32,
}

/// One exposure: its number and its settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shot {
    /// Counts from 0 when the camera is plugged in.
    pub number: u32,
    /// Settings of the exposure.
    pub settings: Settings,
}

impl Sensor {
    /// Takes one exposure. `now` are the present control values; the exposure uses those of `lag`
    /// frames ago.
    pub fn expose(&mut self, now: Settings, lag: usize) -> Shot {
        self.history.push_front(now);
        self.history.truncate(lag + 1);
        let number = self.frames;
        self.frames = self.frames.wrapping_add(1);
        Shot {
            number,
            settings: *self.history.back().unwrap_or(&now),
        }
    }
}

/// Encodes the shot in the format of the stream.
#[must_use]
pub fn develop(shot: Shot, mode: Mode, with_tables: bool) -> Vec<u8> {
    let blocks = draw(shot, mode.width, mode.height);
    match mode.format {
        Format::Mjpeg => encode(
            &Blocks {
                width: mode.width,
                height: mode.height,
                colours: &blocks,
            },
            with_tables,
        ),
        Format::Yuyv => yuyv(&blocks, mode.width, mode.height),
    }
}

fn draw(shot: Shot, width: u16, height: u16) -> Vec<YCbCr> {
    let across = usize::from(width).div_ceil(BLOCK);
    let down = usize::from(height).div_ceil(BLOCK);
    let patches = CARD.map(|reflectance| ycbcr_from_rgb(expose(reflectance, shot.settings)));
    let mut blocks = vec![BIT_OFF; across * down];
    for (index, block) in blocks.iter_mut().enumerate() {
        let (x, y) = (index % across, index / across);
        *block = if y >= COUNTER_ROWS {
            let row = (y - COUNTER_ROWS) * ROWS / (down - COUNTER_ROWS);
            patches[row * COLUMNS + x * COLUMNS / across]
        } else if x < COUNTER_BITS && shot.number >> x & 1 == 1 {
            BIT_ON
        } else {
            BIT_OFF
        };
    }
    blocks
}

/// sRGB code values, 0 to 1.
fn expose(reflectance: [f64; 3], settings: Settings) -> [f64; 3] {
    let stops = (f64::from(settings.gain) - GAIN_PER_STOP) / GAIN_PER_STOP;
    let light = f64::from(settings.exposure) / NORMAL_EXPOSURE * stops.exp2();
    // A power of the ratio of the temperatures approximates the ratio of red and blue light.
    let warmth = (f64::from(settings.temperature) / LIGHT_TEMPERATURE).powf(0.7);
    let balance = [warmth, 1.0, 1.0 / warmth];
    let offset = f64::from(settings.brightness) / 255.0;
    let spread = f64::from(settings.contrast) / 32.0;
    std::array::from_fn(|i| {
        ((srgb_from_linear(reflectance[i] * balance[i] * light) - 0.5) * spread + 0.5 + offset)
            .clamp(0.0, 1.0)
    })
}

fn srgb_from_linear(linear: f64) -> f64 {
    match linear.min(1.0) {
        dark if dark <= 0.003_130_8 => 12.92 * dark,
        light => 1.055 * light.powf(1.0 / 2.4) - 0.055,
    }
}

/// Full-range BT.601.
fn ycbcr_from_rgb([r, g, b]: [f64; 3]) -> YCbCr {
    let luma = 0.299 * r + 0.587 * g + 0.114 * b;
    let byte = |value: f64| (value * 255.0).round().clamp(0.0, 255.0) as u8;
    let centred = |value: f64| byte(value + 128.0 / 255.0);
    [
        byte(luma),
        centred((b - luma) / 1.772),
        centred((r - luma) / 1.402),
    ]
}

fn yuyv(blocks: &[YCbCr], width: u16, height: u16) -> Vec<u8> {
    let across = usize::from(width).div_ceil(BLOCK);
    let mut frame = Vec::with_capacity(usize::from(width) * usize::from(height) * 2);
    let mut row = Vec::with_capacity(usize::from(width) * 2);
    for y in 0..usize::from(height) {
        if y % BLOCK == 0 {
            row.clear();
            for [luma, blue, red] in &blocks[y / BLOCK * across..][..across] {
                for _ in 0..BLOCK / 2 {
                    row.extend([*luma, *blue, *luma, *red]);
                }
            }
            row.truncate(usize::from(width) * 2);
        }
        frame.extend(&row);
    }
    frame
}

/// Column and row of the centre of a patch in the picture.
#[must_use]
pub fn middle_of_patch(patch: usize, width: usize, height: usize) -> (usize, usize) {
    let top = COUNTER_ROWS * BLOCK;
    let middle = |index: usize, count: usize, size: usize| size * (2 * index + 1) / (2 * count);
    let y = top + middle(patch / COLUMNS, ROWS, height - top);
    (middle(patch % COLUMNS, COLUMNS, width), y)
}

/// Reads the frame's number from a picture's luma.
#[must_use]
pub fn number(luma: &[u8], width: usize) -> u32 {
    let bit = |index: usize| luma[BLOCK / 2 * width + index * BLOCK + BLOCK / 2] > 125;
    (0..COUNTER_BITS).fold(0, |number, index| number | u32::from(bit(index)) << index)
}

/// The light of a patch relative to its reflectance, from a code value of luma: 1 at
/// [`NORMAL_EXPOSURE`]; too low for a clipped patch.
#[must_use]
pub fn light(code: u8, reflectance: f64) -> f64 {
    let code = f64::from(code) / 255.0;
    let linear = if code <= 0.040_45 {
        code / 12.92
    } else {
        ((code + 0.055) / 1.055).powf(2.4)
    };
    linear / reflectance
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const MODE: Mode = Mode {
        format: Format::Mjpeg,
        width: 1280,
        height: 720,
        interval: Duration::from_millis(33),
    };

    fn settings(exposure: i32) -> Settings {
        Settings {
            exposure,
            gain: 32,
            temperature: 5000,
            brightness: 0,
            contrast: 32,
        }
    }

    #[test]
    fn frame_encodes_its_number_and_its_exposure() {
        let shot = Shot {
            number: 0xdead_beef,
            settings: settings(314),
        };
        let yuv = turbojpeg::decompress_to_yuv(&develop(shot, MODE, true)).unwrap();
        assert_eq!(number(&yuv.pixels, 1280), 0xdead_beef);
        let (x, y) = middle_of_patch(MIDDLE_GREY, 1280, 720);
        let light = light(yuv.pixels[y * 1280 + x], 0.18);
        assert!((light - 2.0).abs() < 0.03, "{light}");
    }

    #[test]
    fn settings_take_effect_after_the_lag() {
        let mut sensor = Sensor::default();
        sensor.expose(settings(100), 2);
        let shown: Vec<_> = (0..4)
            .map(|_| sensor.expose(settings(200), 2).settings.exposure)
            .collect();
        assert_eq!(shown, [100, 100, 200, 200]);
    }

    #[test]
    fn higher_temperature_makes_the_picture_warmer() {
        let red_over_blue = |temperature| {
            let [r, _, b] = expose(
                [0.18; 3],
                Settings {
                    temperature,
                    ..settings(157)
                },
            );
            r / b
        };
        assert!(red_over_blue(6500) > 1.1 && red_over_blue(2800) < 0.7);
        assert!((red_over_blue(5000) - 1.0).abs() < 1e-9);
    }
}
