//! A decoded picture in memory.

use crate::error::PictureError;

/// Maximum number of pixels of a picture: a damaged header must not request more memory than the
/// machine has.
pub const MAX_PIXELS: u64 = 64 << 20;

/// A picture of 8-bit RGBA, rows tightly packed, pixel (0, 0) top left, in the camera's codes (not
/// linear). Alpha is 255 and has no meaning.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `4 * width * height` bytes.
    pub rgba: Vec<u8>,
}

impl Picture {
    /// Returns the RGB codes of pixel (`x`, `y`), which must be inside the picture.
    ///
    /// # Panics
    /// The pixel is outside.
    #[must_use]
    pub fn rgb(&self, x: u32, y: u32) -> [u8; 3] {
        let i = 4 * (y as usize * self.width as usize + x as usize);
        [self.rgba[i], self.rgba[i + 1], self.rgba[i + 2]]
    }

    /// Returns the picture stretched to `size`, each pixel that of the nearest one.
    #[must_use]
    pub fn stretched(&self, (width, height): (u32, u32)) -> Self {
        let mut rgba = Vec::with_capacity(4 * width as usize * height as usize);
        let source =
            |at: u32, size: u32, of: u32| (u64::from(at) * u64::from(of) / u64::from(size)) as u32;
        for y in 0..height {
            for x in 0..width {
                let (x, y) = (source(x, width, self.width), source(y, height, self.height));
                let [r, g, b] = self.rgb(x, y);
                rgba.extend([r, g, b, 255]);
            }
        }
        Self {
            width,
            height,
            rgba,
        }
    }

    /// Copies `other`, reusing the buffer.
    pub fn copy_from(&mut self, other: &Self) {
        (self.width, self.height) = (other.width, other.height);
        self.rgba.clone_from(&other.rgba);
    }

    /// Sets the size, reusing the buffer.
    ///
    /// # Errors
    /// The picture has more than [`MAX_PIXELS`] pixels.
    pub(crate) fn resize(&mut self, width: u32, height: u32) -> Result<(), PictureError> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels > MAX_PIXELS {
            return Err(PictureError::TooLarge { width, height });
        }
        self.rgba.resize(4 * pixels as usize, 255);
        (self.width, self.height) = (width, height);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretched_picture_repeats_or_leaves_out_pixels() {
        let rgba = (0..4).flat_map(|i| [i, i, i, 255]).collect();
        let picture = Picture {
            width: 2,
            height: 2,
            rgba,
        };
        let large = picture.stretched((4, 2));
        let row = |p: &Picture, y| (0..p.width).map(|x| p.rgb(x, y)[0]).collect::<Vec<_>>();
        assert_eq!(
            (row(&large, 0), row(&large, 1)),
            (vec![0, 0, 1, 1], vec![2, 2, 3, 3])
        );
        assert_eq!(large.stretched((2, 2)), picture);
        assert_eq!(row(&picture.stretched((1, 1)), 0), [0]);
    }
}
