//! The light in the papers on shadowing planes (Kakuta et al. 2004, 2007): the triangles of a
//! geodesic dome, Class I, over the upper hemisphere, and which pixels of the environment lie in
//! each.
//!
//! The dome is an icosahedron standing on a vertex. Each of its triangles is divided into
//! frequency² smaller ones by straight lines, which are projected onto the sphere from its centre.
//! With an even frequency the horizon runs along edges, so that the upper half consists of complete
//! triangles; odd frequencies, where the horizon cuts triangles, are refused.

mod build;
mod membership;
mod six;
mod sources;

pub use membership::{FaceLight, Membership, sum_faces, sum_faces_into};
pub use six::SixGroups;
pub use sources::{FaceOfPixel, FaceSource};

use glam::{DMat3, DVec3, Vec3};

/// Maximum frequency: 2560 triangles, four degrees wide.
pub const MAX_FREQUENCY: u32 = 16;
/// Marks a small triangle below the horizon.
const BELOW: u32 = u32::MAX;
/// Sine of the angle from an edge within which all neighbouring faces are tested.
const NEAR_EDGE: f64 = 1e-6;
/// Sine of the angle within which a direction lies on an edge: a thousand times the rounding error.
const ON_EDGE: f64 = 1e-12;

/// One triangle of the dome.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Unit vectors of the corners, counter-clockwise seen from outside the sphere.
    pub corners: [Vec3; 3],
    /// Unit vector through the middle: the direction of the light that represents the face.
    pub centre: Vec3,
    /// Solid angle of the spherical triangle, steradians.
    pub solid_angle: f32,
}

impl Face {
    fn new(corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        Self {
            corners,
            centre: (a + b + c).normalize().as_vec3(),
            solid_angle: triangle_solid_angle(a, b, c) as f32,
        }
    }

    /// Normals of the planes through the edges and the sphere's centre, pointing inwards. Two faces
    /// get exactly opposite normals for a shared edge.
    fn edge_normals(&self) -> [DVec3; 3] {
        let [a, b, c] = self.corners.map(Vec3::as_dvec3);
        [a.cross(b), b.cross(c), c.cross(a)]
    }
}

/// Solid angle of a spherical triangle (Van Oosterom & Strackee 1983).
pub(crate) fn triangle_solid_angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let numerator = a.dot(b.cross(c)).abs();
    let denominator = 1.0 + a.dot(b) + b.dot(c) + c.dot(a);
    2.0 * numerator.atan2(denominator)
}

/// The triangles of the upper hemisphere.
///
/// Their order never changes, because bakes depend on it. Sides of the icosahedron: the five around
/// the zenith, the first from azimuth 0 (+X) to 72°; the five that share an edge with those,
/// standing on a vertex; the five between these; each five anticlockwise from above. Within a side
/// by rows, from its first corner (the zenith; the lower corner; the upper corner); within a row
/// from the second corner's end to the third's, where the three are counter-clockwise from outside.
/// Of the ten lower sides, the part above the horizon.
#[derive(Clone, Debug)]
pub struct GeodesicDome {
    /// The faces.
    pub faces: Vec<Face>,
    frequency: u32,
    /// Barycentric weights of a side's corners from a direction.
    weights: Vec<DMat3>,
    /// Face of every small triangle of every side.
    face_of_triangle: Vec<u32>,
    edge_normals: Vec<[DVec3; 3]>,
    /// For each face, the faces that share a corner with it, itself included; ascending.
    around: Vec<Vec<u32>>,
}

impl GeodesicDome {
    /// Creates the dome of an even `frequency` up to [`MAX_FREQUENCY`]: 10 · frequency² faces, 40
    /// for the papers' frequency of 2. `None` for any other frequency.
    #[must_use]
    pub fn new(frequency: u32) -> Option<Self> {
        let fits = frequency.is_multiple_of(2) && (2..=MAX_FREQUENCY).contains(&frequency);
        fits.then(|| Self::build(frequency))
    }

    /// Returns the frequency of the subdivision.
    #[must_use]
    pub const fn frequency(&self) -> u32 {
        self.frequency
    }

    /// Returns the face that contains a direction of any length; on an edge, the first of the faces
    /// that meet there. `None` below the horizon.
    #[must_use]
    pub fn face_of(&self, direction: Vec3) -> Option<usize> {
        let d = direction.as_dvec3();
        let length = d.length();
        if !(d.z >= 0.0 && length > 0.0 && length.is_finite()) {
            return None;
        }
        let Some(guess) = self.guess(d) else {
            return self.first_with(0..self.faces.len() as u32, d);
        };
        if self.depth(guess, d) > NEAR_EDGE * length {
            return Some(guess as usize);
        }
        let around = self.around.get(guess as usize)?;
        self.first_with(around.iter().copied(), d)
    }

    /// Finds the face by the straight lines on the icosahedron's side; correct except for rounding.
    fn guess(&self, d: DVec3) -> Option<u32> {
        let mut best = (0, DVec3::ZERO, f64::NEG_INFINITY);
        for (side, matrix) in self.weights.iter().enumerate() {
            let weights = *matrix * d;
            let min = weights.min_element();
            if min > best.2 {
                best = (side, weights, min);
            }
            if min > 0.0 {
                break;
            }
        }
        let (side, weights, _) = best;
        let frequency = f64::from(self.frequency);
        let scale = frequency / (weights.x + weights.y + weights.z);
        let (row, column) = ((weights.y + weights.z) * scale, weights.z * scale);
        let (i, j) = (row.floor().clamp(0.0, frequency - 1.0), column.floor());
        let j = j.clamp(0.0, i);
        let pointing_down = j < i && column - j > row - i;
        let (i, j) = (i as usize, j as usize);
        let n = self.frequency as usize;
        let at = side * n * n + i * i + 2 * j + usize::from(pointing_down);
        self.face_of_triangle
            .get(at)
            .copied()
            .filter(|&f| f != BELOW)
    }

    /// Signed distance inside a face, relative to the direction's length; negative outside.
    fn depth(&self, face: u32, d: DVec3) -> f64 {
        let normals = self.edge_normals.get(face as usize);
        let inside = |n: &[DVec3; 3]| n.iter().map(|n| n.dot(d)).fold(f64::INFINITY, f64::min);
        normals.map_or(f64::NEG_INFINITY, inside)
    }

    /// Returns the first of the ascending `faces` with the direction inside or on its edge; if
    /// rounding leaves it in none, the one with the smallest distance outside.
    fn first_with(&self, faces: impl Iterator<Item = u32>, d: DVec3) -> Option<usize> {
        let mut best = (None, f64::NEG_INFINITY);
        for face in faces {
            let depth = self.depth(face, d);
            if depth >= -ON_EDGE * d.length() {
                return Some(face as usize);
            }
            if depth > best.1 {
                best = (Some(face as usize), depth);
            }
        }
        best.0
    }
}

#[cfg(test)]
mod tests;
