//! Demosaicing of a sensor's Bayer pattern.
//!
//! H. S. Malvar, L. He, R. Cutler: High-quality linear interpolation for demosaicing of
//! Bayer-patterned color images, ICASSP 2004, figure 2. A missing colour is the mean of its
//! neighbours, corrected by the gradient of the measured colour (gains 1/2, 5/8, 3/4), which keeps
//! edges sharp. The filters are linear and sum to one: they preserve planes, and keep the codes of
//! uniform areas exactly.

use crate::picture::Picture;
use penumbra_interface::BayerPattern;

/// The columns or rows around a pixel, which is the third.
type Five<T> = [T; 5];

/// Position of a pixel in the Bayer pattern.
#[derive(Clone, Copy)]
enum Site {
    Red,
    /// Green, red to the left and right, blue above and below.
    GreenInRedRow,
    /// Green, blue to the left and right, red above and below.
    GreenInBlueRow,
    Blue,
}

impl Site {
    const fn of(x: usize, y: usize, red: (u32, u32)) -> Self {
        match ((x ^ red.0 as usize) & 1, (y ^ red.1 as usize) & 1) {
            (0, 0) => Self::Red,
            (_, 0) => Self::GreenInRedRow,
            (0, _) => Self::GreenInBlueRow,
            _ => Self::Blue,
        }
    }
}

/// Fills a picture of the right size from rows of `stride` bytes in `data`.
pub(super) fn demosaic(data: &[u8], stride: usize, pattern: BayerPattern, picture: &mut Picture) {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let row = |y: usize| {
        let start = y * stride;
        data.get(start..start + width).unwrap_or_default()
    };
    let red = pattern.red();
    for (y, out) in picture.rgba.chunks_exact_mut(4 * width).enumerate() {
        let rows: Five<&[u8]> = around(y, height).map(row);
        if rows.iter().any(|row| row.len() < width) {
            return;
        }
        let sites = [Site::of(0, y, red), Site::of(1, y, red)];
        let done = tiles(&rows, sites, out);
        let edges = (0..2.min(width)).chain(done.max(2)..width);
        for x in edges {
            let columns = around(x, width);
            let codes = rows.map(|row| columns.map(|column| i16::from(row[column])));
            let pixel = interpolate(&Sums::of(&codes), sites[x & 1]);
            out[4 * x..4 * x + 4].copy_from_slice(&pixel);
        }
    }
}

/// Pixels per tile; even, so that each tile starts with the same site.
const TILE: usize = 64;

/// Codes of a tile's pixels from one filter.
type Plane = [u8; TILE];

/// Interpolates complete tiles from the third pixel on, with the filters of all sites at once, which
/// compiles to vector instructions. Returns the first pixel after them.
fn tiles(rows: &Five<&[u8]>, sites: [Site; 2], out: &mut [u8]) -> usize {
    let width = out.len() / 4;
    let mut start = 2;
    while start + TILE + 2 <= width {
        let mut around: Five<&[u8; TILE + 4]> = [&[0; TILE + 4]; 5];
        for (tile, row) in around.iter_mut().zip(rows) {
            if let Some((found, _)) = row[start - 2..].split_first_chunk() {
                *tile = found;
            }
        }
        let planes = Planes::of(&around);
        let pixels = &mut out[4 * start..4 * (start + TILE)];
        let (even, odd) = (planes.of_site(sites[0]), planes.of_site(sites[1]));
        for (pair, two) in pixels.chunks_exact_mut(8).enumerate() {
            let i = 2 * pair;
            let [a, b] = [even.map(|plane| plane[i]), odd.map(|plane| plane[i + 1])];
            two.copy_from_slice(&[a[0], a[1], a[2], 255, b[0], b[1], b[2], 255]);
        }
        start += TILE;
    }
    start
}

/// Results of the filters over a tile.
struct Planes {
    own: Plane,
    green: Plane,
    colour_beside: Plane,
    colour_above: Plane,
    opposite: Plane,
}

impl Planes {
    fn of(rows: &Five<&[u8; TILE + 4]>) -> Self {
        let mut planes = Self {
            own: [0; TILE],
            green: [0; TILE],
            colour_beside: [0; TILE],
            colour_above: [0; TILE],
            opposite: [0; TILE],
        };
        for x in 0..TILE {
            let code = |row: usize, column: usize| i16::from(rows[row][x + column]);
            let sums = Sums {
                centre: code(2, 2),
                beside: code(2, 1) + code(2, 3),
                above: code(1, 2) + code(3, 2),
                far_beside: code(2, 0) + code(2, 4),
                far_above: code(0, 2) + code(4, 2),
                corners: code(1, 1) + code(1, 3) + code(3, 1) + code(3, 3),
            };
            planes.own[x] = rows[2][x + 2];
            planes.green[x] = sums.green();
            planes.colour_beside[x] = sums.colour_beside();
            planes.colour_above[x] = sums.colour_above();
            planes.opposite[x] = sums.opposite();
        }
        planes
    }

    /// Planes of red, green and blue for a site.
    const fn of_site(&self, site: Site) -> [&Plane; 3] {
        match site {
            Site::Red => [&self.own, &self.green, &self.opposite],
            Site::Blue => [&self.opposite, &self.green, &self.own],
            Site::GreenInRedRow => [&self.colour_beside, &self.own, &self.colour_above],
            Site::GreenInBlueRow => [&self.colour_above, &self.own, &self.colour_beside],
        }
    }
}

/// The five positions around `at`, mirrored at the edges, which keeps each colour's parity.
fn around(at: usize, len: usize) -> Five<usize> {
    let last = len as isize - 1;
    [-2, -1, 0, 1, 2].map(|offset| {
        let mut place = at as isize + offset;
        // A width of two pixels needs two reflections; a width of one has no neighbours.
        for _ in 0..2 {
            place = place.abs();
            place = if place > last {
                2 * last - place
            } else {
                place
            };
        }
        place.clamp(0, last) as usize
    })
}

/// Sums of neighbours that the filters combine; 16 bits suffice (at most 28 · 255).
struct Sums {
    centre: i16,
    beside: i16,
    above: i16,
    far_beside: i16,
    far_above: i16,
    corners: i16,
}

// ┌ Figure 2 of the paper, in sixteenths:                                                 ┐
// │            .  . -2  .  .       .  .  1  .  .       .  . -2  .  .      .  . -3  .  .   │
// │            .  .  4  .  .       . -2  . -2  .       . -2  8 -2  .      .  4  .  4  .   │
// │           -2  4  8  4 -2      -2  8 10  8 -2       1  . 10  .  1     -3  . 12  . -3   │
// │            .  .  4  .  .       . -2  . -2  .       . -2  8 -2  .      .  4  .  4  .   │
// │            .  . -2  .  .       .  .  1  .  .       .  . -2  .  .      .  . -3  .  .   │
// └            G at R or B          colour beside        colour above     opposite corner ┘
impl Sums {
    fn of(p: &Five<Five<i16>>) -> Self {
        Self {
            centre: p[2][2],
            beside: p[2][1] + p[2][3],
            above: p[1][2] + p[3][2],
            far_beside: p[2][0] + p[2][4],
            far_above: p[0][2] + p[4][2],
            corners: p[1][1] + p[1][3] + p[3][1] + p[3][3],
        }
    }

    fn green(&self) -> u8 {
        let far = self.far_beside + self.far_above;
        code(8 * self.centre + 4 * (self.beside + self.above) - 2 * far)
    }

    fn colour_beside(&self) -> u8 {
        let less = self.corners + self.far_beside;
        code(10 * self.centre + 8 * self.beside - 2 * less + self.far_above)
    }

    fn colour_above(&self) -> u8 {
        let less = self.corners + self.far_above;
        code(10 * self.centre + 8 * self.above - 2 * less + self.far_beside)
    }

    fn opposite(&self) -> u8 {
        let far = self.far_beside + self.far_above;
        code(12 * self.centre + 4 * self.corners - 3 * far)
    }
}

fn code(sixteenths: i16) -> u8 {
    ((sixteenths + 8) >> 4).clamp(0, 255) as u8
}

fn interpolate(sums: &Sums, site: Site) -> [u8; 4] {
    let own = sums.centre as u8;
    match site {
        Site::Red => [own, sums.green(), sums.opposite(), 255],
        Site::Blue => [sums.opposite(), sums.green(), own, 255],
        Site::GreenInRedRow => [sums.colour_beside(), own, sums.colour_above(), 255],
        Site::GreenInBlueRow => [sums.colour_above(), own, sums.colour_beside(), 255],
    }
}
