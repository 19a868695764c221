//! A decoded picture in memory.

/// 8-bit RGBA, rows tightly packed, pixel (0, 0) top left, as the camera encoded it (not
/// linear). Alpha is 255 and means nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `4 * width * height` bytes.
    pub rgba: Vec<u8>,
}

impl Picture {
    /// The three codes of pixel (`x`, `y`), which must lie inside.
    #[must_use]
    pub fn rgb(&self, x: u32, y: u32) -> [u8; 3] {
        let i = 4 * (y as usize * self.width as usize + x as usize);
        [self.rgba[i], self.rgba[i + 1], self.rgba[i + 2]]
    }
}
