//! Places with texture in two directions, one in each cell of a grid (Shi & Tomasi 1994, "Good
//! features to track").

use super::luminance::Luminance;
use super::patch::{MIN_TEXTURE, RADIUS, eigenvalues};

/// Columns of the grid.
const COLUMNS: usize = 13;
/// Least side of a cell, pixels.
const MIN_CELL: usize = 48;
/// Side of the blocks over which the gradients' second moments are summed, pixels. A window has 3×3
/// blocks.
const BLOCK: usize = 4;
/// Least mean square of the derivative across an edge that is taken where a cell has no corner, codes²
/// per pixel².
const MIN_EDGE: f32 = 2.0;

/// A grid over a picture.
#[derive(Clone, Debug)]
pub(super) struct CornerGrid {
    /// Side of a cell, pixels; a multiple of a block.
    cell: usize,
    columns: usize,
    rows: usize,
    /// Second moments of a cell's blocks: xx, xy, yy.
    blocks: Vec<[f32; 3]>,
}

impl CornerGrid {
    pub fn new([width, height]: [u32; 2]) -> Self {
        let [width, height] = [width as usize, height as usize];
        let cell = width
            .div_ceil(COLUMNS)
            .max(MIN_CELL)
            .next_multiple_of(BLOCK);
        Self {
            cell,
            columns: width / cell,
            rows: height / cell,
            blocks: vec![[0.0; 3]; (cell / BLOCK).pow(2)],
        }
    }

    /// Number of cells.
    pub const fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// The cell of a pixel, which must be inside the picture; `None` beyond the last whole cell.
    pub fn cell_of(&self, [x, y]: [usize; 2]) -> Option<usize> {
        let (column, row) = (x / self.cell, y / self.cell);
        (column < self.columns && row < self.rows).then(|| row * self.columns + column)
    }

    /// The pixel with the most texture of a cell, if it has enough.
    pub fn best_in(&mut self, picture: &Luminance, cell: usize) -> Option<[usize; 2]> {
        let left = cell % self.columns * self.cell;
        let top = cell / self.columns * self.cell;
        let side = self.cell / BLOCK;
        for (i, block) in self.blocks.iter_mut().enumerate() {
            let corner = [left + i % side * BLOCK, top + i / side * BLOCK];
            *block = block_moments(picture, corner);
        }
        let (mut corner, mut edge) = ((MIN_TEXTURE, None), (MIN_EDGE, None));
        for y in 1..side - 1 {
            for x in 1..side - 1 {
                let mut sum = [0.0; 3];
                for row in self.blocks[(y - 1) * side..(y + 2) * side].chunks_exact(side) {
                    for block in &row[x - 1..x + 2] {
                        sum = std::array::from_fn(|k| sum[k] + block[k]);
                    }
                }
                let texture = eigenvalues(sum).map(|v| v / (9 * BLOCK * BLOCK) as f32);
                let pixel = [left + x * BLOCK + BLOCK / 2, top + y * BLOCK + BLOCK / 2];
                for (best, texture) in [&mut edge, &mut corner].into_iter().zip(texture) {
                    if texture > best.0 {
                        *best = (texture, Some(pixel));
                    }
                }
            }
        }
        let margin = 2 * RADIUS;
        let fits = |at: usize, length: usize| at >= margin && at + margin < length;
        corner
            .1
            .or(edge.1)
            .filter(|[x, y]| fits(*x, picture.width) && fits(*y, picture.height))
    }
}

/// Second moments of the gradients in a block; those at the picture's edge count as zero.
fn block_moments(picture: &Luminance, [left, top]: [usize; 2]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for y in top.max(1)..(top + BLOCK).min(picture.height - 1) {
        for x in left.max(1)..(left + BLOCK).min(picture.width - 1) {
            let dx = 0.5 * (picture.at(x + 1, y) - picture.at(x - 1, y));
            let dy = 0.5 * (picture.at(x, y + 1) - picture.at(x, y - 1));
            sum = [sum[0] + dx * dx, sum[1] + dx * dy, sum[2] + dy * dy];
        }
    }
    sum
}
