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
