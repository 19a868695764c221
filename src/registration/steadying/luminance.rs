//! A picture's luminance, smoothed.

use glam::DVec2;

/// Luminance of a picture in the camera's codes (0 to 255), smoothed by a binomial filter of 3×3
/// pixels: noise falls to 0.4, and values between the pixels can be interpolated.
#[derive(Clone, Debug, Default)]
pub(super) struct Luminance {
    pub width: usize,
    pub height: usize,
    values: Vec<f32>,
    /// The last three rows, smoothed horizontally: 16 times the code.
    rows: [Vec<u16>; 3],
}

impl Luminance {
    /// Reads a picture of 8-bit RGBA, rows tightly packed. Allocates only if the size changes.
    pub fn read(&mut self, rgba: &[u8], [width, height]: [u32; 2]) {
        let [width, height] = [width as usize, height as usize];
        (self.width, self.height) = (width, height);
        self.values.resize(width * height, 0.0);
        self.rows.iter_mut().for_each(|row| row.resize(width, 0));
        let source = |y: usize| &rgba[4 * width * y..][..4 * width];
        let [above, row, below] = &mut self.rows;
        smooth_row(source(0), row);
        above.copy_from_slice(row);
        for (y, values) in self.values.chunks_exact_mut(width).enumerate() {
            smooth_row(source((y + 1).min(height - 1)), below);
            for (x, value) in values.iter_mut().enumerate() {
                let sum = u32::from(above[x]) + 2 * u32::from(row[x]) + u32::from(below[x]);
                *value = sum as f32 * (1.0 / 64.0);
            }
            std::mem::swap(above, row);
            std::mem::swap(row, below);
        }
    }

    /// Value of a pixel, which must be inside the picture.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Whether a square of `margin` pixels around a pixel is inside the picture.
    pub fn contains(&self, pixel: DVec2, margin: f64) -> bool {
        let last = DVec2::new(self.width as f64, self.height as f64) - 1.0 - margin;
        pixel.cmpge(DVec2::splat(margin)).all() && pixel.cmplt(last).all()
    }

    /// Value at a position that must be inside the picture, interpolated bilinearly.
    pub fn sample(&self, [x, y]: [f32; 2]) -> f32 {
        let (column, row) = (x as usize, y as usize);
        let (u, v) = (x - column as f32, y - row as f32);
        let start = row * self.width + column;
        let upper = &self.values[start..start + 2];
        let lower = &self.values[start + self.width..start + self.width + 2];
        let top = upper[0] + u * (upper[1] - upper[0]);
        let bottom = lower[0] + u * (lower[1] - lower[0]);
        top + v * (bottom - top)
    }
}

/// Smooths a row of RGBA horizontally: 16 times the luminance (R + 2 G + B) / 4.
fn smooth_row(rgba: &[u8], row: &mut [u16]) {
    let luminance = |p: &[u8]| u16::from(p[0]) + 2 * u16::from(p[1]) + u16::from(p[2]);
    let Some(first) = rgba.first_chunk::<4>() else {
        return;
    };
    let mut before = luminance(first);
    let mut now = before;
    let mut pixels = rgba.chunks_exact(4).skip(1);
    for value in row {
        let next = pixels.next().map_or(now, luminance);
        *value = before + 2 * now + next;
        (before, now) = (now, next);
    }
}
