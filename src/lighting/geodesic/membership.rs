//! The pixels of the environment in each face, and the faces' sums on the CPU.

use super::{FaceSource, GeodesicDome};
use glam::{DVec3, Quat, Vec3};
use std::sync::Arc;

/// The pixels in each face, computed once per calibration and sorted by face.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Membership {
    /// Index of each face's first pixel, and the total number: one more than faces.
    pub begins: Vec<u32>,
    /// Indices into the radiance that is summed.
    pub pixels: Vec<u32>,
    /// Solid angle of each pixel in its face, steradians.
    pub weights: Vec<f32>,
}

/// Input of the luminance parameters: S_i = Σ weight · radiance over face i.
#[derive(Clone, Debug)]
pub struct FaceLight {
    /// Frequency of the dome.
    pub frequency: u32,
    /// The pixels in each face.
    pub membership: Arc<Membership>,
    /// Linear RGB radiance in the scene camera's units: the environment's pixels, then texels of
    /// the filled cube for unseen directions.
    pub radiance: Arc<Vec<[f32; 3]>>,
    /// Compact sources included in the radiance, strongest first.
    pub sources: Vec<FaceSource>,
}

impl Membership {
    /// Assigns to each face the pixels whose `directions` (world, unit) fall into it. Pixels
    /// without solid angle (steradians) are in none.
    ///
    /// Within a face the weights are proportional to the solid angles and add up to exactly the
    /// face's own, so that a constant radiance L gives S_i = L Ω_i. This corrects for pixels on an
    /// edge, whose entire area belongs to one face, and for pixels cut by a fisheye's rim, which
    /// belong to none: with 1000² pixels and 40 faces less than 0.1 %, and 0.9 % in faces at the
    /// rim. A face too small to contain a pixel's centre takes the pixel nearest to its own.
    #[must_use]
    pub fn new(dome: &GeodesicDome, directions: &[Vec3], solid_angles: &[f32]) -> Self {
        Self::rotated(dome, Quat::IDENTITY, directions, solid_angles)
    }

    /// The same for a dome that rotates with a model: its zenith is `world_from_dome` · Z, and
    /// directions below *its* horizon are excluded.
    #[must_use]
    pub fn rotated(
        dome: &GeodesicDome,
        world_from_dome: Quat,
        directions: &[Vec3],
        solid_angles: &[f32],
    ) -> Self {
        let dome_from_world = world_from_dome.inverse();
        let face = |(d, w): (&Vec3, &f32)| (*w > 0.0).then(|| dome.face_of(dome_from_world * *d));
        let rows = directions.iter().zip(solid_angles);
        let face_of: Vec<Option<usize>> = rows.map(|row| face(row).flatten()).collect();
        let mut table = Self::sorted(&face_of, dome.faces.len(), |face| {
            let centre = world_from_dome * dome.faces[face].centre;
            nearest(centre, directions, solid_angles)
        });
        table.weigh(dome, solid_angles);
        table
    }

    /// Sorts pixels by face; `instead` returns the pixel of a face that has none.
    fn sorted(
        face_of: &[Option<usize>],
        faces: usize,
        instead: impl Fn(usize) -> Option<u32>,
    ) -> Self {
        let mut members = vec![Vec::new(); faces];
        for (pixel, face) in face_of.iter().enumerate() {
            if let Some(members) = face.and_then(|f| members.get_mut(f)) {
                members.push(pixel as u32);
            }
        }
        let mut table = Self {
            begins: vec![0],
            ..Self::default()
        };
        for (face, mut members) in members.into_iter().enumerate() {
            if members.is_empty() {
                members.extend(instead(face));
            }
            table.pixels.append(&mut members);
            table.begins.push(table.pixels.len() as u32);
        }
        table
    }

    /// Computes weights that add up to each face's solid angle.
    fn weigh(&mut self, dome: &GeodesicDome, solid_angles: &[f32]) {
        let size = |pixel: &u32| f64::from(solid_angles[*pixel as usize]);
        self.weights.reserve(self.pixels.len());
        for (range, face) in self.begins.windows(2).zip(&dome.faces) {
            let pixels = &self.pixels[range[0] as usize..range[1] as usize];
            let scale = f64::from(face.solid_angle) / pixels.iter().map(size).sum::<f64>();
            let weights = pixels.iter().map(|pixel| (size(pixel) * scale) as f32);
            self.weights.extend(weights);
        }
    }

    /// Returns each face's range of [`Self::pixels`] and [`Self::weights`].
    pub fn ranges(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let pairs = self.begins.windows(2);
        pairs.map(|pair| pair[0] as usize..pair[1] as usize)
    }
}

/// Returns the visible pixel nearest to a direction.
fn nearest(to: Vec3, directions: &[Vec3], solid_angles: &[f32]) -> Option<u32> {
    let rows = directions.iter().zip(solid_angles).zip(0..);
    let seen = rows.filter(|((_, w), _)| **w > 0.0);
    let close = |d: &Vec3| d.dot(to);
    seen.max_by(|a, b| close(a.0.0).total_cmp(&close(b.0.0)))
        .map(|(_, i)| i)
}

/// Returns S_i = Σ weight · radiance over face i: irradiance on a surface that faces the light,
/// scene camera units. Reference for the GPU's pass.
#[must_use]
pub fn sum_faces(light: &FaceLight) -> Vec<Vec3> {
    let mut sums = Vec::new();
    sum_faces_into(light, &mut sums);
    sums
}

/// The same into a reused buffer.
pub fn sum_faces_into(light: &FaceLight, sums: &mut Vec<Vec3>) {
    let table = light.membership.as_ref();
    let sum = |range: std::ops::Range<usize>| {
        let pixels = table.pixels.get(range.clone()).unwrap_or_default();
        let weights = table.weights.get(range).unwrap_or_default();
        let value = |(pixel, weight): (&u32, &f32)| {
            let radiance = light.radiance.get(*pixel as usize)?;
            Some(Vec3::from(*radiance).as_dvec3() * f64::from(*weight))
        };
        let values = pixels.iter().zip(weights).filter_map(value);
        values.sum::<DVec3>().as_vec3()
    };
    sums.clear();
    sums.extend(table.ranges().map(sum));
}
