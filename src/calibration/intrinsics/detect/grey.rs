//! A grey picture in floating point.

use glam::DVec2;
use penumbra_picture::Picture;

/// Brightness by pixel, 0 to 255, rows tightly packed.
#[derive(Clone, Debug, PartialEq)]
pub struct Grey {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` values.
    pub data: Vec<f32>,
}

impl Grey {
    /// Converts 8-bit grey, rows tightly packed; missing pixels become black.
    #[must_use]
    pub fn from_bytes(width: usize, height: usize, bytes: &[u8]) -> Self {
        let mut data: Vec<f32> = bytes.iter().map(|&b| f32::from(b)).collect();
        data.resize(width * height, 0.0);
        Self {
            width,
            height,
            data,
        }
    }

    /// Computes the luma (Rec. 601) of a colour picture, which cameras encode at the highest
    /// resolution.
    #[must_use]
    pub fn from_picture(picture: &Picture) -> Self {
        let luma =
            |p: &[u8]| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]);
        Self {
            width: picture.width as usize,
            height: picture.height as usize,
            data: picture.rgba.chunks_exact(4).map(luma).collect(),
        }
    }

    /// Returns the value at a pixel; outside the picture, that of the nearest edge pixel.
    #[must_use]
    pub fn at(&self, x: isize, y: isize) -> f32 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.data[y * self.width + x]
    }

    /// Returns the bilinearly interpolated value at `p`, pixels.
    #[must_use]
    pub fn sample(&self, p: DVec2) -> f64 {
        let base = p.floor();
        let (x, y) = (base.x as isize, base.y as isize);
        let (u, v) = ((p.x - base.x) as f32, (p.y - base.y) as f32);
        let top = self.at(x, y) * (1.0 - u) + self.at(x + 1, y) * u;
        let bottom = self.at(x, y + 1) * (1.0 - u) + self.at(x + 1, y + 1) * u;
        f64::from(top * (1.0 - v) + bottom * v)
    }

    /// Returns whether `p` is at least `margin` pixels inside the picture.
    #[must_use]
    pub fn contains(&self, p: DVec2, margin: f64) -> bool {
        let (w, h) = (self.width as f64 - 1.0, self.height as f64 - 1.0);
        p.x >= margin && p.y >= margin && p.x <= w - margin && p.y <= h - margin
    }

    /// Returns the picture blurred by a Gaussian of `sigma` pixels.
    #[must_use]
    pub fn blurred(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let weight = |i: isize| (-((i * i) as f32) / (2.0 * sigma * sigma)).exp();
        let sum: f32 = (-reach..=reach).map(weight).sum();
        let kernel: Vec<f32> = (-reach..=reach).map(|i| weight(i) / sum).collect();
        self.convolved_along_rows(&kernel)
            .transposed()
            .convolved_along_rows(&kernel)
            .transposed()
    }

    /// Returns every other pixel after an anti-aliasing blur; its pixel p is pixel 2 p of this
    /// picture.
    #[must_use]
    pub fn halved(&self) -> Self {
        let smooth = self.blurred(0.8);
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                data.push(smooth.data[2 * y * self.width + 2 * x]);
            }
        }
        Self {
            width,
            height,
            data,
        }
    }

    fn convolved_along_rows(&self, kernel: &[f32]) -> Self {
        let reach = kernel.len() / 2;
        let mut out = self.clone();
        let mut padded = vec![0.0; self.width + 2 * reach];
        for y in 0..self.height {
            let row = &self.data[y * self.width..][..self.width];
            padded[..reach].fill(row[0]);
            padded[reach..reach + self.width].copy_from_slice(row);
            padded[reach + self.width..].fill(row[self.width - 1]);
            let into = &mut out.data[y * self.width..][..self.width];
            for (x, slot) in into.iter_mut().enumerate() {
                let window = &padded[x..x + kernel.len()];
                *slot = window.iter().zip(kernel).map(|(p, k)| p * k).sum();
            }
        }
        out
    }

    fn transposed(&self) -> Self {
        let mut data = vec![0.0; self.data.len()];
        for y in 0..self.height {
            for x in 0..self.width {
                data[x * self.height + y] = self.data[y * self.width + x];
            }
        }
        Self {
            width: self.height,
            height: self.width,
            data,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blurring_and_halving_preserve_a_ramp() {
        let data = (0..64 * 48)
            .map(|i| (i % 64 + 2 * (i / 64)) as f32)
            .collect();
        let ramp = Grey {
            width: 64,
            height: 48,
            data,
        };
        assert!((ramp.blurred(1.5).at(30, 20) - 70.0).abs() < 1e-3);
        let half = ramp.halved();
        assert_eq!((half.width, half.height), (32, 24));
        assert!((half.at(10, 10) - 60.0).abs() < 1e-3);
        assert!((ramp.sample(DVec2::new(10.25, 5.5)) - 21.25).abs() < 1e-5);
        assert!((ramp.at(-5, 100) - 94.0).abs() < 1e-6);
    }
}
