//! The flat panels of a simulated room: tags and chessboards, as grids of printed cells.

use glam::{DVec2, DVec3};
use penumbra_fiducials::Family;
use penumbra_interface::RigidTransform;

/// Linear reflectance of paper.
const PAPER: f32 = 0.8;
/// Linear reflectance of ink.
const INK: f32 = 0.04;

/// A flat panel of rectangular cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Pose of the panel's frame: +X right, +Y down, +Z into the paper.
    pub world_from_panel: RigidTransform,
    /// Top left corner of the first cell in the panel's frame, metres.
    pub corner: DVec2,
    /// Size of a cell, metres.
    pub cell: DVec2,
    /// Number of cells in a row.
    pub columns: usize,
    /// Linear reflectance of the cells, row by row.
    pub reflectance: Vec<f32>,
}

impl Panel {
    /// Creates a tag with its white margin; the panel's frame is the tag's. `None` if the family
    /// has no tag with this number.
    #[must_use]
    pub fn tag(family: Family, id: u32, size: f64, world_from_tag: RigidTransform) -> Option<Self> {
        if id >= family.count() {
            return None;
        }
        let modules = family.modules();
        let side = modules + 2;
        let mut reflectance = Vec::with_capacity((side * side) as usize);
        for y in 0..side {
            for x in 0..side {
                let margin = x == 0 || y == 0 || x + 1 == side || y + 1 == side;
                let white = margin || family.is_white(id, x - 1, y - 1);
                reflectance.push(if white { PAPER } else { INK });
            }
        }
        let cell = size / f64::from(modules);
        Some(Self {
            world_from_panel: world_from_tag,
            corner: DVec2::splat(-0.5 * size - cell),
            cell: DVec2::splat(cell),
            columns: side as usize,
            reflectance,
        })
    }

    /// Creates a chessboard of `columns` × `rows` inner corners with a margin of one square (metres);
    /// the panel's frame is the board's, whose origin is the first inner corner.
    #[must_use]
    pub fn chess(
        (columns, rows): (u32, u32),
        square: f64,
        world_from_board: RigidTransform,
    ) -> Self {
        let (across, down) = (columns + 3, rows + 3);
        let reflectance = (0..across * down).map(|i| {
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
            reflectance: reflectance.collect(),
        }
    }

    /// Returns the number of rows of cells.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.reflectance.len() / self.columns.max(1)
    }

    /// Returns the index of the cell at a point of the panel's plane; `None` outside the panel.
    pub(super) fn cell_at(&self, point: DVec2) -> Option<usize> {
        let at = (point - self.corner) / self.cell;
        if at.x < 0.0 || at.y < 0.0 {
            return None;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        (x < self.columns && y < self.rows()).then(|| y * self.columns + x)
    }

    /// Returns the panel's corners in the world, metres.
    pub(super) fn corners(&self) -> [DVec3; 4] {
        let size = self.cell * DVec2::new(self.columns as f64, self.rows() as f64);
        [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|c| {
            let point = (self.corner + c * size).extend(0.0);
            self.world_from_panel.transform_point(point)
        })
    }
}
