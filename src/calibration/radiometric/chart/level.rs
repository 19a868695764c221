//! A reduced picture, in which a chart's patches have a handful of pixels each.

use glam::DVec2;
use penumbra_picture::Picture;

/// A level of an image pyramid: means of blocks of pixels.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub width: usize,
    pub height: usize,
    /// Codes, 0 to 255, row by row.
    pub codes: Vec<[f32; 3]>,
    /// Reduction: pixels of the picture per pixel of the level.
    pub factor: usize,
}

impl Level {
    /// Reduces a picture to at most `longest` pixels on the longer side.
    pub fn new(picture: &Picture, longest: usize) -> Self {
        let (w, h) = (picture.width as usize, picture.height as usize);
        let factor = w.max(h).div_ceil(longest.max(1)).max(1);
        let (width, height) = (w / factor, h / factor);
        let mut codes = vec![[0.0f32; 3]; width * height];
        for (y, row) in codes.chunks_exact_mut(width.max(1)).enumerate() {
            for v in y * factor..(y + 1) * factor {
                let line = &picture.rgba[4 * w * v..4 * w * v + 4 * factor * width];
                for (out, block) in row.iter_mut().zip(line.chunks_exact(4 * factor)) {
                    for pixel in block.chunks_exact(4) {
                        for c in 0..3 {
                            out[c] += f32::from(pixel[c]);
                        }
                    }
                }
            }
        }
        let scale = 1.0 / (factor * factor) as f32;
        for code in codes.iter_mut().flatten() {
            *code *= scale;
        }
        Self {
            width,
            height,
            codes,
            factor,
        }
    }

    /// Blurs by means over 3×3 pixels, to suppress noise.
    pub fn blurred(mut self) -> Self {
        let (w, h) = (self.width, self.height);
        let source = self.codes.clone();
        for y in 1..h.saturating_sub(1) {
            for x in 1..w.saturating_sub(1) {
                let mut sum = [0.0; 3];
                for row in [y - 1, y, y + 1] {
                    for code in &source[row * w + x - 1..row * w + x + 2] {
                        for c in 0..3 {
                            sum[c] += code[c];
                        }
                    }
                }
                self.codes[y * w + x] = sum.map(|s| s / 9.0);
            }
        }
        self
    }

    /// Returns the roughness of each pixel: maximum less minimum over itself and its eight
    /// neighbours, the largest of the channels; `f32::MAX` at the border.
    pub fn roughness(&self) -> Vec<f32> {
        let (w, h) = (self.width, self.height);
        let mut rough = vec![f32::MAX; w * h];
        for y in 1..h.saturating_sub(1) {
            for x in 1..w.saturating_sub(1) {
                let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
                for row in [y - 1, y, y + 1] {
                    for code in &self.codes[row * w + x - 1..row * w + x + 2] {
                        for c in 0..3 {
                            low[c] = low[c].min(code[c]);
                            high[c] = high[c].max(code[c]);
                        }
                    }
                }
                rough[y * w + x] = (0..3).map(|c| high[c] - low[c]).fold(0.0, f32::max);
            }
        }
        rough
    }

    /// Maps a point of the level to the picture, pixels.
    pub fn to_picture(&self, p: DVec2) -> DVec2 {
        (p + 0.5) * self.factor as f64 - 0.5
    }

    /// Returns the mean codes at a point of the picture; `None` outside.
    pub fn at(&self, pixel: DVec2) -> Option<[f32; 3]> {
        let p = ((pixel + 0.5) / self.factor as f64 - 0.5).round();
        let (width, height) = (self.width as f64, self.height as f64);
        let inside = p.x >= 0.0 && p.y >= 0.0 && p.x < width && p.y < height;
        inside.then(|| self.codes[p.y as usize * self.width + p.x as usize])
    }
}
