//! Construction of the icosahedron standing on a vertex, and the subdivision of its sides.

use super::{BELOW, Face, GeodesicDome};
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Sides of the icosahedron that reach above the horizon.
const SIDES: usize = 15;

impl GeodesicDome {
    pub(super) fn build(frequency: u32) -> Self {
        let sides = icosahedron();
        let mut corners = Corners::default();
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        let mut face_of_triangle = Vec::new();
        for side in &sides {
            for points in small_triangles(side, frequency) {
                let above = points.iter().map(|p| p.z).sum::<f64>() > 0.0;
                face_of_triangle.push(if above { triangles.len() as u32 } else { BELOW });
                if above {
                    triangles.push(points.map(|p| corners.number(p)));
                }
            }
        }
        let place = |k: u32| corners.0[k as usize].as_vec3();
        let faces: Vec<Face> = triangles.iter().map(|t| Face::new(t.map(place))).collect();
        let around = around(&triangles, corners.0.len());
        let weights = sides.map(|[a, b, c]| DMat3::from_cols(a, b, c).inverse());
        Self {
            edge_normals: faces.iter().map(Face::edge_normals).collect(),
            weights: weights.to_vec(),
            faces,
            frequency,
            face_of_triangle,
            around,
        }
    }
}

/// Corners of the triangles, without duplicates.
#[derive(Default)]
struct Corners(Vec<DVec3>);

impl Corners {
    fn number(&mut self, p: DVec3) -> u32 {
        let known = self.0.iter().position(|q| q.distance_squared(p) < 1e-16);
        known.unwrap_or_else(|| {
            self.0.push(p);
            self.0.len() - 1
        }) as u32
    }
}

/// The zenith, then the other corners by azimuth.
pub(super) fn upper_corners() -> [DVec3; 6] {
    std::array::from_fn(|k| match k {
        0 => DVec3::Z,
        _ => ring((k - 1) as f64, 1.0),
    })
}

/// Returns a corner of the ring next to the zenith (`side` 1) or the nadir (−1): the tangent of its
/// elevation is ½.
fn ring(fifths: f64, side: f64) -> DVec3 {
    let (sin, cos) = (TAU * fifths / 5.0).sin_cos();
    DVec3::new(2.0 * cos, 2.0 * sin, side) / 5.0_f64.sqrt()
}

/// The sides that reach above the horizon, corners counter-clockwise from outside.
fn icosahedron() -> [[DVec3; 3]; SIDES] {
    std::array::from_fn(|k| {
        let at = (k % 5) as f64;
        let (left, right) = (ring(at, 1.0), ring((k + 1) as f64 % 5.0, 1.0));
        let low = |fifths: f64| ring(fifths, -1.0);
        match k / 5 {
            0 => [DVec3::Z, left, right],
            1 => [low(at + 0.5), right, left],
            _ => [left, low(at - 0.5), low(at + 0.5)],
        }
    })
}

/// Divides a side into triangles on the unit sphere, row by row from its first corner.
fn small_triangles([a, b, c]: &[DVec3; 3], frequency: u32) -> Vec<[DVec3; 3]> {
    let point = |row: u32, column: u32| {
        let parts = [frequency - row, row - column, column].map(f64::from);
        let p = (*a * parts[0] + *b * parts[1] + *c * parts[2]).normalize();
        // The horizon is exactly level, so that every direction above it is in a face.
        if p.z.abs() < 1e-12 { p.with_z(0.0) } else { p }
    };
    let mut triangles = Vec::new();
    for row in 0..frequency {
        for column in 0..=row {
            let (here, below) = (point(row, column), point(row + 1, column + 1));
            triangles.push([here, point(row + 1, column), below]);
            if column < row {
                triangles.push([here, below, point(row, column + 1)]);
            }
        }
    }
    triangles
}

/// For each face, the faces that share a corner with it, itself included; ascending.
fn around(triangles: &[[u32; 3]], corners: usize) -> Vec<Vec<u32>> {
    let mut at_corner = vec![Vec::new(); corners];
    for (face, triangle) in triangles.iter().enumerate() {
        for &k in triangle {
            at_corner[k as usize].push(face as u32);
        }
    }
    let around = |triangle: &[u32; 3]| {
        let mut all: Vec<u32> = triangle
            .iter()
            .flat_map(|&k| at_corner[k as usize].clone())
            .collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    triangles.iter().map(around).collect()
}
