//! Closed solids, collected in one mesh. All face outwards.

use crate::mesh::{Mesh, Vertex};
use crate::normals::recompute_normals;
use glam::{Vec2, Vec3, Vec4};
use std::f32::consts::TAU;

/// Minimum angle between faces at a sharp edge, radians.
const CREASE: f32 = 0.6;

/// A collection of solids.
#[derive(Clone, Debug, Default)]
pub(super) struct Solids {
    positions: Vec<Vec3>,
    indices: Vec<u32>,
}

impl Solids {
    /// The mesh, with normals.
    pub fn mesh(self) -> Mesh {
        let vertex = |position| Vertex {
            position,
            normal: Vec3::Z,
            uv: Vec2::ZERO,
            tangent: Vec4::ZERO,
        };
        let mut mesh = Mesh {
            vertices: self.positions.into_iter().map(vertex).collect(),
            indices: self.indices,
        };
        recompute_normals(&mut mesh, CREASE);
        mesh
    }

    fn point(&mut self, p: Vec3) -> u32 {
        self.positions.push(p);
        (self.positions.len() - 1) as u32
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.indices.extend([a, b, c, a, c, d]);
    }

    /// A cuboid between two corners.
    pub fn cuboid(&mut self, low: Vec3, high: Vec3) {
        let middle = low.midpoint(high);
        let half = (high - low).abs() / 2.0;
        let section = rectangle(half.x, half.y);
        let ends = [middle - Vec3::Z * half.z, middle + Vec3::Z * half.z];
        self.stack(&ends.map(|at| (at, 1.0)), &section);
    }

    /// A solid of horizontal sections: the same outline around each centre, scaled.
    pub fn stack(&mut self, levels: &[(Vec3, f32)], section: &[Vec2]) {
        let ring = |(at, scale): &(Vec3, f32)| -> Vec<Vec3> {
            section
                .iter()
                .map(|p| *at + (*p * *scale).extend(0.0))
                .collect()
        };
        let rings: Vec<Vec<Vec3>> = levels.iter().map(ring).collect();
        self.loft(&rings);
    }

    /// A solid of revolution about a vertical axis: radius and height above `foot`, bottom to top.
    pub fn turned(&mut self, foot: Vec3, profile: &[(f32, f32)], segments: u32) {
        let levels: Vec<(Vec3, f32)> = profile
            .iter()
            .map(|(r, z)| (foot + Vec3::Z * *z, *r))
            .collect();
        self.stack(&levels, &circle(1.0, segments));
    }

    /// A straight or curved beam: `section` (right and up looking along it, anticlockwise seen from its
    /// end) swept along `path`, scaled by `scale` at each point.
    pub fn sweep(
        &mut self,
        path: &[Vec3],
        up: Vec3,
        section: &[Vec2],
        scale: impl Fn(usize) -> f32,
    ) {
        let rings: Vec<Vec<Vec3>> = (0..path.len())
            .map(|i| {
                let ahead = path[(i + 1).min(path.len() - 1)];
                let behind = path[i.saturating_sub(1)];
                let forward = (ahead - behind).normalize_or(Vec3::X);
                let side = up.cross(forward).normalize_or(Vec3::X);
                let up = forward.cross(side);
                let place = |p: &Vec2| path[i] + (side * p.x + up * p.y) * scale(i);
                section.iter().map(place).collect()
            })
            .collect();
        self.loft(&rings);
    }

    /// A straight solid from one vertical section to another.
    pub fn tapered(&mut self, [from, to]: [Vec3; 2], first: [Vec2; 4], last: [Vec2; 4]) {
        let side = Vec3::Z.cross(to - from).normalize_or(Vec3::X);
        let ring = |at: Vec3, section: [Vec2; 4]| -> Vec<Vec3> {
            section
                .iter()
                .map(|p| at + side * p.x + Vec3::Z * p.y)
                .collect()
        };
        self.loft(&[ring(from, first), ring(to, last)]);
    }

    /// A straight beam of one section.
    pub fn beam(&mut self, from: Vec3, to: Vec3, width: f32, height: f32) {
        self.sweep(
            &[from, to],
            Vec3::Z,
            &rectangle(width / 2.0, height / 2.0),
            |_| 1.0,
        );
    }

    /// Adds a closed tube of rings with equal numbers of points, each anticlockwise seen from the end.
    fn loft(&mut self, rings: &[Vec<Vec3>]) {
        let starts: Vec<u32> = rings
            .iter()
            .map(|ring| {
                let first = self.positions.len() as u32;
                self.positions.extend(ring);
                first
            })
            .collect();
        let count = rings.first().map_or(0, Vec::len) as u32;
        for pair in starts.windows(2) {
            for i in 0..count {
                let j = (i + 1) % count;
                self.quad([pair[0] + i, pair[0] + j, pair[1] + j, pair[1] + i]);
            }
        }
        let (Some(first), Some(last)) = (starts.first(), starts.last()) else {
            return;
        };
        self.cap(*first, count, true);
        self.cap(*last, count, false);
    }

    fn cap(&mut self, first: u32, count: u32, reversed: bool) {
        for i in 1..count.saturating_sub(1) {
            let (b, c) = (first + i, first + i + 1);
            self.indices.extend(if reversed {
                [first, c, b]
            } else {
                [first, b, c]
            });
        }
    }

    /// A curved plate: `top(u, v)` for u and v from 0 to 1 is the side towards ∂u × ∂v; the other is
    /// offset by `through`.
    pub fn plate(
        &mut self,
        across: u32,
        along: u32,
        through: Vec3,
        top: impl Fn(f32, f32) -> Vec3,
    ) {
        let row = across + 1;
        let first = self.positions.len() as u32;
        for offset in [Vec3::ZERO, through] {
            for j in 0..=along {
                for i in 0..=across {
                    let (u, v) = (i as f32 / across as f32, j as f32 / along as f32);
                    self.point(top(u, v) + offset);
                }
            }
        }
        let back = first + row * (along + 1);
        for j in 0..along {
            for i in 0..across {
                let a = j * row + i;
                let [b, c, d] = [a + 1, a + row + 1, a + row];
                self.quad([a, b, c, d].map(|i| first + i));
                self.quad([a, d, c, b].map(|i| back + i));
            }
        }
        let last = along * row;
        let rim = (0..across)
            .map(|i| (i, i + 1))
            .chain((0..along).map(|j| (j * row + across, (j + 1) * row + across)))
            .chain((0..across).rev().map(|i| (last + i + 1, last + i)))
            .chain((0..along).rev().map(|j| ((j + 1) * row, j * row)));
        for (a, b) in rim {
            self.quad([first + b, first + a, back + a, back + b]);
        }
    }
}

/// A rectangle around the origin, anticlockwise.
pub(super) fn rectangle(half_width: f32, half_height: f32) -> [Vec2; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| Vec2::new(x * half_width, y * half_height))
}

/// A circle around the origin, anticlockwise.
pub(super) fn circle(radius: f32, segments: u32) -> Vec<Vec2> {
    let angle = |i: u32| TAU * i as f32 / segments as f32;
    (0..segments)
        .map(|i| Vec2::from_angle(angle(i)) * radius)
        .collect()
}
