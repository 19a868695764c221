//! Divides meshes into charts: connected pieces without creases that can be projected along one axis
//! of the world without overlapping themselves (box projection, as for the cards of a surface cache).

use glam::{UVec2, Vec2, Vec3};
use std::collections::HashMap;

/// Minimum cosine between a triangle's normal and the axis of its chart: texels are stretched by at
/// most its inverse.
const MIN_FACING: f32 = 0.4;
/// Cosine between the normals of two faces at a common edge up to which the edge is a crease. Light
/// differs across it; texels there would belong to one face or the other by chance.
const CREASE: f32 = 0.94;
/// Cells along the longest side of a mesh in which overlaps are noticed.
const OVERLAP_CELLS: f32 = 256.0;
/// Cells along a side of the grid: those and one more for the upper edges.
const GRID: usize = OVERLAP_CELLS as usize + 1;

/// Direction along which a chart is projected: an axis of the world (0 to 2) and its sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    index: usize,
    negative: bool,
}

impl Axis {
    /// The axis that is nearest to `normal`.
    fn nearest(normal: Vec3) -> Self {
        let index = normal.abs().max_position();
        Self {
            index,
            negative: normal[index] < 0.0,
        }
    }

    /// Cosine between the axis and a unit normal.
    fn facing(self, normal: Vec3) -> f32 {
        if self.negative {
            -normal[self.index]
        } else {
            normal[self.index]
        }
    }

    /// Coordinates of a point of the world on the chart's plane, metres.
    pub fn project(self, p: Vec3) -> Vec2 {
        match self.index {
            0 => Vec2::new(p.y, p.z),
            1 => Vec2::new(p.z, p.x),
            _ => Vec2::new(p.x, p.y),
        }
    }

    /// The point at the coordinates `flat` in the plane through the world's origin.
    pub fn lift(self, flat: Vec2) -> Vec3 {
        match self.index {
            0 => Vec3::new(0.0, flat.x, flat.y),
            1 => Vec3::new(flat.y, 0.0, flat.x),
            _ => Vec3::new(flat.x, flat.y, 0.0),
        }
    }

    /// Unit vector along the axis, without its sign.
    pub fn unit(self) -> Vec3 {
        [Vec3::X, Vec3::Y, Vec3::Z][self.index]
    }

    /// Coordinate of a point along the axis, metres.
    fn along(self, p: Vec3) -> f32 {
        p[self.index]
    }
}

/// A piece of a mesh.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Direction of projection.
    pub axis: Axis,
    /// Indices of its triangles.
    pub triangles: Vec<u32>,
    /// Lower corner of its projection, metres.
    pub low: Vec2,
    /// Upper corner of its projection, metres.
    pub high: Vec2,
}

/// Triangles in the world.
pub struct Surface<'a> {
    /// Corners, metres.
    pub positions: &'a [Vec3],
    /// Three per triangle.
    pub indices: &'a [u32],
}

impl Surface<'_> {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.indices.len() / 3
    }

    /// Corners of a triangle.
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        let at = 3 * triangle as usize;
        [0, 1, 2].map(|k| self.positions[self.indices[at + k] as usize])
    }

    fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        let corners = self.indices.iter().map(|i| self.positions[*i as usize]);
        corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| {
            (lo.min(p), hi.max(p))
        })
    }
}

/// Divides a surface into charts. Degenerate triangles are in none.
/// `vertex_normals`: unit vectors.
pub fn charts(surface: &Surface<'_>, vertex_normals: &[Vec3]) -> Vec<Chart> {
    let normals: Vec<Vec3> = (0..surface.len() as u32)
        .map(|t| surface.normal(t))
        .collect();
    let neighbours = neighbours(surface, vertex_normals);
    let mut seeds: Vec<u32> = (0..normals.len() as u32)
        .filter(|t| normals[*t as usize] != Vec3::ZERO)
        .collect();
    let facing = |t: u32| normals[t as usize].abs().max_element();
    seeds.sort_by(|a, b| facing(*b).total_cmp(&facing(*a)).then(a.cmp(b)));
    let (low, high) = surface.bounds();
    let mut growth = Growth {
        surface,
        normals: &normals,
        neighbours: &neighbours,
        is_taken: vec![false; normals.len()],
        low,
        cell: (high - low).max_element().max(1e-6) / OVERLAP_CELLS,
        heights: vec![(0, 0.0); GRID * GRID],
        cells: Vec::new(),
    };
    let mut charts = Vec::new();
    for seed in seeds {
        if !growth.is_taken[seed as usize] {
            charts.push(growth.grow(seed, charts.len() as u32 + 1));
        }
    }
    charts
}

/// Up to three neighbours of each triangle across its edges, but not across creases; `u32::MAX` for
/// none. Vertices at the same position count as one.
fn neighbours(surface: &Surface<'_>, normals: &[Vec3]) -> Vec<[u32; 3]> {
    let mut welded: HashMap<[u32; 3], u32> = HashMap::with_capacity(surface.positions.len());
    let point: Vec<u32> = surface
        .positions
        .iter()
        .map(|p| {
            let next = welded.len() as u32;
            *welded
                .entry((*p + Vec3::ZERO).to_array().map(f32::to_bits))
                .or_insert(next)
        })
        .collect();
    let mut open: HashMap<(u32, u32), OpenEdge> = HashMap::with_capacity(surface.len() * 2);
    let mut found = vec![[u32::MAX; 3]; surface.len()];
    for t in 0..surface.len() {
        for k in 0..3 {
            let [a, b] = [k, (k + 1) % 3].map(|k| surface.indices[3 * t + k] as usize);
            let ends = if point[a] < point[b] { [a, b] } else { [b, a] };
            let edge = (point[ends[0]], point[ends[1]]);
            let normals = ends.map(|i| normals[i]);
            if let Some(other) = open.remove(&edge) {
                let is_same = |i: usize| normals[i].dot(other.normals[i]) > CREASE;
                if is_same(0) && is_same(1) {
                    found[t][k] = other.triangle;
                    found[other.triangle as usize][other.side] = t as u32;
                }
            } else {
                open.insert(
                    edge,
                    OpenEdge {
                        triangle: t as u32,
                        side: k,
                        normals,
                    },
                );
            }
        }
    }
    found
}

/// An edge of which one triangle has been seen.
struct OpenEdge {
    triangle: u32,
    side: usize,
    /// That triangle's normals at both ends.
    normals: [Vec3; 2],
}

struct Growth<'a> {
    surface: &'a Surface<'a>,
    normals: &'a [Vec3],
    neighbours: &'a [[u32; 3]],
    is_taken: Vec<bool>,
    /// Lower corner of the surface, metres.
    low: Vec3,
    /// Length of a cell of the grid, metres.
    cell: f32,
    /// By cell, row by row: the last chart with a triangle there (from 1), and its height, metres.
    heights: Vec<(u32, f32)>,
    /// Cells of the present triangle, with its heights there.
    cells: Vec<(usize, f32)>,
}

impl Growth<'_> {
    /// Takes all triangles that are connected to `seed` and fit into its chart, the `number`th.
    fn grow(&mut self, seed: u32, number: u32) -> Chart {
        let axis = Axis::nearest(self.normals[seed as usize]);
        let mut chart = Chart {
            axis,
            triangles: Vec::new(),
            low: Vec2::INFINITY,
            high: Vec2::NEG_INFINITY,
        };
        let mut front = std::collections::VecDeque::from([seed]);
        while let Some(t) = front.pop_front() {
            if self.is_taken[t as usize]
                || axis.facing(self.normals[t as usize]) < MIN_FACING
                || !self.occupy(axis, t, number)
            {
                continue;
            }
            self.is_taken[t as usize] = true;
            chart.triangles.push(t);
            for p in self.surface.corners(t).map(|p| axis.project(p)) {
                chart.low = chart.low.min(p);
                chart.high = chart.high.max(p);
            }
            front.extend(
                self.neighbours[t as usize]
                    .iter()
                    .filter(|n| **n != u32::MAX),
            );
        }
        chart
    }

    /// Enters a triangle's heights into the cells that it covers; false, without a change, if
    /// another triangle of the chart lies above or below it there.
    fn occupy(&mut self, axis: Axis, t: u32, chart: u32) -> bool {
        let corners = self.surface.corners(t);
        let low = axis.project(self.low);
        let flat = corners.map(|p| (axis.project(p) - low) / self.cell);
        let height = corners.map(|p| axis.along(p));
        self.cells.clear();
        cover(flat, height, &mut self.cells);
        // Neighbours in one cell differ by the height of a steep triangle across it.
        let apart = 4.0 * self.cell / MIN_FACING;
        let is_free = |(cell, h): &(usize, f32)| {
            let (owner, other) = self.heights[*cell];
            owner != chart || (other - h).abs() < apart
        };
        if !self.cells.iter().all(is_free) {
            return false;
        }
        for (cell, h) in &self.cells {
            self.heights[*cell] = (chart, *h);
        }
        true
    }
}

/// Adds the cells whose centre a triangle covers, at least that of its centroid, with its height
/// there.
fn cover(flat: [Vec2; 3], height: [f32; 3], cells: &mut Vec<(usize, f32)>) {
    let [a, b, c] = flat;
    let index = |p: Vec2| {
        let cell = p
            .max(Vec2::ZERO)
            .as_uvec2()
            .min(UVec2::splat(GRID as u32 - 1));
        cell.y as usize * GRID + cell.x as usize
    };
    cells.push((
        index((a + b + c) / 3.0),
        (height[0] + height[1] + height[2]) / 3.0,
    ));
    let area = (b - a).perp_dot(c - a);
    if area.abs() < 1e-9 {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    for y in low.y.floor() as i32..=high.y.floor() as i32 {
        for x in low.x.floor() as i32..=high.x.floor() as i32 {
            let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let w = [(b, c), (c, a), (a, b)].map(|(u, v)| (v - u).perp_dot(p - u) / area);
            if w.iter().all(|w| *w >= 0.0) {
                let at = w[0] * height[0] + w[1] * height[1] + w[2] * height[2];
                cells.push((index(p), at));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_scene::{Mesh, primitives};

    fn surface_charts(mesh: &Mesh) -> (Vec<Vec3>, Vec<Chart>) {
        let positions: Vec<Vec3> = mesh.vertices.iter().map(|v| v.position).collect();
        let surface = Surface {
            positions: &positions,
            indices: &mesh.indices,
        };
        let normals: Vec<Vec3> = mesh.vertices.iter().map(|v| v.normal).collect();
        let charts = charts(&surface, &normals);
        (positions, charts)
    }

    #[test]
    fn a_torus_has_few_charts_that_hold_every_triangle_once() {
        let mesh = primitives::torus(0.09, 0.035, 60, 40);
        let (_, charts) = surface_charts(&mesh);
        let mut all: Vec<u32> = charts.iter().flat_map(|c| c.triangles.clone()).collect();
        all.sort_unstable();
        assert_eq!(all, (0..mesh.indices.len() as u32 / 3).collect::<Vec<_>>());
        assert!(charts.len() <= 24, "{}", charts.len());
    }

    #[test]
    fn charts_do_not_overlap_themselves() {
        let mesh = primitives::torus(0.09, 0.035, 60, 40);
        let (positions, charts) = surface_charts(&mesh);
        let surface = Surface {
            positions: &positions,
            indices: &mesh.indices,
        };
        for chart in &charts {
            for p in [0.1, 0.35, 0.6, 0.85].into_iter().flat_map(|x| {
                [0.15, 0.4, 0.65, 0.9]
                    .map(|y| chart.low + (chart.high - chart.low) * Vec2::new(x, y))
            }) {
                let holding = chart.triangles.iter().filter(|t| {
                    let [a, b, c] = surface.corners(**t).map(|p| chart.axis.project(p));
                    let area = (b - a).perp_dot(c - a);
                    [(a, b), (b, c), (c, a)]
                        .iter()
                        .all(|(u, v)| (*v - *u).perp_dot(p - *u) / area > 1e-4)
                });
                assert!(holding.count() <= 1);
            }
        }
    }

    #[test]
    fn a_crease_divides_charts_and_a_smooth_edge_does_not() {
        // Two faces at 40°, both of which the vertical axis faces.
        let positions = [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.84]]
            .into_iter()
            .flat_map(|[x, z]| [0.0, 1.0].map(|y| Vec3::new(x, y, z)));
        let of = |i: usize| positions.clone().nth(i).expect("six points");
        let corners = [0, 2, 3, 0, 3, 1, 2, 4, 5, 2, 5, 3];
        let positions: Vec<Vec3> = corners.iter().map(|i| of(*i)).collect();
        let indices: Vec<u32> = (0..12).collect();
        let surface = Surface {
            positions: &positions,
            indices: &indices,
        };
        let sharp: Vec<Vec3> = (0..12).map(|k| surface.normal(k / 3)).collect();
        assert_eq!(charts(&surface, &sharp).len(), 2);
        assert_eq!(charts(&surface, &[Vec3::Z; 12]).len(), 1);
    }

    #[test]
    fn a_box_has_one_chart_a_face() {
        let mesh = primitives::cuboid(Vec3::new(0.2, 0.1, 0.3));
        let (_, charts) = surface_charts(&mesh);
        assert_eq!(charts.len(), 6);
        assert!(charts.iter().all(|c| c.triangles.len() == 2));
    }
}
