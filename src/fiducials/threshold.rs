//! Adaptive threshold halfway between the darkest and the brightest pixel of the neighbourhood
//! (as in AprilTag 2: Wang & Olson 2016).

/// Side of a tile, pixels.
const TILE: usize = 4;
/// Minimum difference of the darkest and the brightest code of a neighbourhood with an edge. Below
/// it there is only noise, and nothing is black.
const MIN_CONTRAST: u8 = 16;

/// The black pixels of a picture, with a margin of one pixel that is not black.
#[derive(Clone, Debug, Default)]
pub(super) struct Black {
    /// Width without the margin, pixels.
    pub width: usize,
    /// Height without the margin, pixels.
    pub height: usize,
    /// (width + 2) · (height + 2) pixels, row by row.
    pub pixels: Vec<bool>,
    tiles: Vec<(u8, u8)>,
    rows: Vec<(u8, u8)>,
}

impl Black {
    /// Binarises a grey picture of `width` × `height` pixels. A pixel is black if it is below
    /// `share`/256 of the range from the darkest to the brightest pixel nearby.
    pub fn binarise(&mut self, grey: &[u8], (width, height): (usize, usize), share: u8) {
        (self.width, self.height) = (width, height);
        self.pixels.clear();
        self.pixels.resize((width + 2) * (height + 2), false);
        let (across, down) = (width / TILE, height / TILE);
        if across == 0 || down == 0 {
            return;
        }
        self.find_extremes(grey, across, down);
        self.dilate_extremes(across, down);
        for y in 0..height {
            let tiles = &self.tiles[(y / TILE).min(down - 1) * across..][..across];
            let row = &grey[y * width..][..width];
            let out = &mut self.pixels[(y + 1) * (width + 2) + 1..][..width];
            for (x, (pixel, out)) in row.iter().zip(out).enumerate() {
                let (low, high) = tiles[(x / TILE).min(across - 1)];
                let range = high - low;
                let reach = (u16::from(range) * u16::from(share) / 256) as u8;
                *out = range >= MIN_CONTRAST && *pixel <= low + reach;
            }
        }
    }

    fn find_extremes(&mut self, grey: &[u8], across: usize, down: usize) {
        self.tiles.clear();
        self.tiles.resize(across * down, (255, 0));
        for y in 0..down * TILE {
            let row = &grey[y * self.width..][..across * TILE];
            let tiles = &mut self.tiles[y / TILE * across..][..across];
            for (tile, pixels) in tiles.iter_mut().zip(row.chunks_exact(TILE)) {
                for &p in pixels {
                    *tile = (tile.0.min(p), tile.1.max(p));
                }
            }
        }
    }

    /// Gives each tile the extremes of its 3×3 neighbourhood, so that tile borders have no effect.
    fn dilate_extremes(&mut self, across: usize, down: usize) {
        let join = |a: (u8, u8), b: (u8, u8)| (a.0.min(b.0), a.1.max(b.1));
        self.rows.clear();
        for row in self.tiles.chunks_exact(across) {
            self.rows.extend((0..across).map(|x| {
                let near = &row[x.saturating_sub(1)..(x + 2).min(across)];
                near.iter().copied().fold((255, 0), join)
            }));
        }
        for y in 0..down {
            for x in 0..across {
                let near = y.saturating_sub(1)..(y + 2).min(down);
                let all = near.map(|y| self.rows[y * across + x]);
                self.tiles[y * across + x] = all.fold((255, 0), join);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignores_shading_and_noise() {
        let (w, h) = (64, 32);
        // A dark stripe under light that decreases to a quarter.
        let at = |x: usize, y: usize| {
            let light = 250.0 - 3.0 * x as f64;
            let paint = if (12..20).contains(&y) { 0.3 } else { 1.0 };
            (light * paint) as u8
        };
        let grey: Vec<u8> = (0..w * h).map(|i| at(i % w, i / w)).collect();
        let mut black = Black::default();
        black.binarise(&grey, (w, h), 128);
        let is = |x: usize, y: usize| black.pixels[(y + 1) * (w + 2) + x + 1];
        assert!((0..w).all(|x| is(x, 12) && is(x, 19) && !is(x, 11) && !is(x, 20)));
        let noise: Vec<u8> = (0..w * h).map(|i| 100 + (i * 7919 % 13) as u8).collect();
        black.binarise(&noise, (w, h), 128);
        assert!(black.pixels.iter().all(|b| !b));
    }

    #[test]
    fn picture_smaller_than_a_tile_has_no_black_pixels() {
        let mut black = Black::default();
        black.binarise(&[0, 255, 0, 255], (2, 2), 128);
        assert!(black.pixels.iter().all(|b| !b));
    }
}
