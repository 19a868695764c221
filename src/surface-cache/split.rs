//! Meshes whose vertices are split where charts meet, with the coordinates of each vertex in the
//! table of pages.

use crate::cache::SurfaceCache;
use crate::layout::{ChartCells, TABLE_WIDTH, cells_of};
use crate::receivers::{CachedPart, Layer};
use std::collections::HashMap;

/// Where a vertex lies in the table of pages.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct CacheVertex {
    /// Cells from the first cell of its chart.
    pub at: [f32; 2],
    /// First cell of its chart in the table.
    pub origin: [u16; 2],
    /// Number of cells of its chart, across and down; 0 where the chart has no pages.
    pub count: [u16; 2],
}

/// A mesh for drawing with the cache.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplitMesh {
    /// For each vertex, its number in the part's own mesh.
    pub vertices: Vec<u32>,
    /// For each vertex, where it lies in the table.
    pub cache: Vec<CacheVertex>,
    /// Three per triangle, in the order of the part's own mesh.
    pub indices: Vec<u32>,
}

impl SurfaceCache {
    /// The split mesh of a virtual part or a phantom; `None` for a mirror, which has no texels.
    #[must_use]
    pub fn split_mesh(&self, layer: Layer) -> Option<SplitMesh> {
        let number = self.parts.iter().position(|part| part.layer == layer)?;
        Some(split(self, number, &self.parts[number]))
    }

    /// The table of pages, row by row, [`TABLE_WIDTH`] cells each: 0 for no page; else the page's
    /// number plus one in the lowest 16 bits, its level in the next four, and the cell's place on
    /// the page in four bits each for x and y.
    #[must_use]
    pub fn table(&self) -> Vec<u32> {
        let mut table = vec![0; (TABLE_WIDTH * self.layout.table_rows) as usize];
        for (number, page) in self.layout.pages.iter().enumerate() {
            for (cell, offset) in cells_of(page) {
                let at = page.cells.origin + cell;
                table[(at.y * TABLE_WIDTH + at.x) as usize] =
                    (number as u32 + 1) | page.level << 16 | offset.x << 20 | offset.y << 24;
            }
        }
        table
    }
}

fn split(cache: &SurfaceCache, number: usize, part: &CachedPart) -> SplitMesh {
    let receiver = &part.receiver;
    let mut known: HashMap<(u32, usize), u32> = HashMap::with_capacity(receiver.positions.len());
    let mut mesh = SplitMesh {
        indices: vec![0; receiver.indices.len()],
        ..SplitMesh::default()
    };
    for (c, chart) in receiver.charts.iter().enumerate() {
        let frame = cache.layout.frames[number][c];
        for t in &chart.triangles {
            for k in 3 * *t as usize..3 * *t as usize + 3 {
                let vertex = receiver.indices[k];
                mesh.indices[k] = *known.entry((vertex, c)).or_insert_with(|| {
                    let flat = chart.axis.project(receiver.positions[vertex as usize]);
                    let at = (flat - frame.low) / cache.layout.cell();
                    mesh.vertices.push(vertex);
                    mesh.cache.push(vertex_at(at.to_array(), frame.cells));
                    mesh.vertices.len() as u32 - 1
                });
            }
        }
    }
    if part.is_mirrored {
        mesh.indices.chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
    }
    mesh
}

fn vertex_at(at: [f32; 2], cells: ChartCells) -> CacheVertex {
    let short = |v: glam::UVec2| v.to_array().map(|x| x.min(u32::from(u16::MAX)) as u16);
    CacheVertex {
        at,
        origin: short(cells.origin),
        count: short(cells.count),
    }
}
