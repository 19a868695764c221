//! What hangs and lies about in a rehearsal's room: flat things with printed cells.

use glam::{DVec2, DVec3};
use penumbra_fiducials::Family;
use penumbra_interface::RigidTransform;

/// Reflectance of paper and of ink.
const PAPER: f32 = 0.8;
const INK: f32 = 0.04;

/// A flat thing, printed in rectangular cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Its own frame: +X right, +Y down, +Z into the paper.
    pub world_from_panel: RigidTransform,
    /// Top left of the first cell, metres.
    pub corner: DVec2,
    /// A cell's size, metres.
    pub cell: DVec2,
    /// Cells in a row.
    pub columns: usize,
    /// Linear reflectance by cell, row by row.
    pub light: Vec<f32>,
}

impl Panel {
    /// A tag with its white margin; its frame is the tag's. `None` of a number that the family
    /// does not have.
    #[must_use]
    pub fn tag(family: Family, id: u32, size: f64, world_from_tag: RigidTransform) -> Option<Self> {
        if id >= family.count() {
            return None;
        }
        let modules = family.modules();
        let side = modules + 2;
        let mut light = Vec::with_capacity((side * side) as usize);
        for y in 0..side {
            for x in 0..side {
                let margin = x == 0 || y == 0 || x + 1 == side || y + 1 == side;
                let white = margin || family.is_white(id, x - 1, y - 1);
                light.push(if white { PAPER } else { INK });
            }
        }
        let cell = size / f64::from(modules);
        Some(Self {
            world_from_panel: world_from_tag,
            corner: DVec2::splat(-0.5 * size - cell),
            cell: DVec2::splat(cell),
            columns: side as usize,
            light,
        })
    }

    /// A chessboard of so many inner corners, with a margin of one square; its frame is
    /// the board's, which begins at the first inner corner.
    #[must_use]
    pub fn chess(
        (columns, rows): (u32, u32),
        square: f64,
        world_from_board: RigidTransform,
    ) -> Self {
        let (across, down) = (columns + 3, rows + 3);
        let light = (0..across * down).map(|i| {
            let (x, y) = (i % across, i / across);
            let margin = x == 0 || y == 0 || x + 1 == across || y + 1 == down;
            let ink = !margin && (x + y) % 2 == 0;
            if ink { INK } else { PAPER }
        });
        Self {
            world_from_panel: world_from_board,
            corner: DVec2::splat(-2.0 * square),
            cell: DVec2::splat(square),
            columns: across as usize,
            light: light.collect(),
        }
    }

    /// Rows of cells.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.light.len() / self.columns.max(1)
    }

    /// Number of the cell at a place of the panel's plane; `None` beside it.
    pub(super) fn cell_at(&self, place: DVec2) -> Option<usize> {
        let at = (place - self.corner) / self.cell;
        if at.x < 0.0 || at.y < 0.0 {
            return None;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        (x < self.columns && y < self.rows()).then(|| y * self.columns + x)
    }

    /// Its corners in the world.
    pub(super) fn corners(&self) -> [DVec3; 4] {
        let size = self.cell * DVec2::new(self.columns as f64, self.rows() as f64);
        [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|c| {
            let place = (self.corner + c * size).extend(0.0);
            self.world_from_panel.transform_point(place)
        })
    }
}
