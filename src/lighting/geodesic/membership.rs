//! Which pixel of the environment lies in which face, and the faces' sums on the CPU.

use super::{FaceSource, GeodesicDome};
use glam::{DVec3, Quat, Vec3};
use std::sync::Arc;

/// Which pixels lie in which face: made once per calibration. Pixels are sorted by face.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Membership {
    /// Where each face's pixels begin; one more than faces.
    pub begins: Vec<u32>,
    /// Indices into the radiance that is summed.
    pub pixels: Vec<u32>,
    /// Solid angle of each of them in the face, steradians.
    pub weights: Vec<f32>,
}

/// What the luminance parameters are summed from: S_i = Σ weight · radiance over face i.
#[derive(Clone, Debug)]
pub struct FaceLight {
    /// Of the dome.
    pub frequency: u32,
    /// The table.
    pub membership: Arc<Membership>,
    /// Linear RGB radiance in the scene camera's units: the environment's pixels, then texels of
    /// the filled cube for what no pixel shows.
    pub radiance: Arc<Vec<[f32; 3]>>,
    /// Compact sources that are part of it, strongest first.
    pub sources: Vec<FaceSource>,
}

impl Membership {
    /// The pixels of each face: those whose `directions` (world, unit) fall into it. Pixels
    /// without solid angle (steradians) are in none.
    ///
    /// Within a face the weights are proportional to the solid angles and add up to the face's
    /// own exactly, so that a constant radiance L gives S_i = L Ω_i. What this makes up for is
    /// that pixels on an edge belong to one face with all of their area, and pixels that a
    /// fisheye's rim cuts to none: with 1000² pixels and 40 faces below 0.1 %, and 0.9 % in faces
    /// at the rim. A face that is too small for any pixel's middle takes the pixel next to its own.
    #[must_use]
    pub fn new(dome: &GeodesicDome, directions: &[Vec3], solid_angles: &[f32]) -> Self {
        Self::rotated(dome, Quat::IDENTITY, directions, solid_angles)
    }

    /// The same for a dome that has been turned along with a model: its zenith is
    /// `world_from_dome` · Z, and what is below *its* horizon is left out.
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

    /// Sorts pixels by face; `instead` is asked for the pixel of a face that has none.
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

    /// Solid angles that add up to each face's.
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

    /// Each face's range of [`Self::pixels`] and [`Self::weights`].
    pub fn ranges(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let pairs = self.begins.windows(2);
        pairs.map(|pair| pair[0] as usize..pair[1] as usize)
    }
}

/// The pixel that is seen nearest to a direction.
fn nearest(to: Vec3, directions: &[Vec3], solid_angles: &[f32]) -> Option<u32> {
    let rows = directions.iter().zip(solid_angles).zip(0..);
    let seen = rows.filter(|((_, w), _)| **w > 0.0);
    let close = |d: &Vec3| d.dot(to);
    seen.max_by(|a, b| close(a.0.0).total_cmp(&close(b.0.0)))
        .map(|(_, i)| i)
}

/// S_i = Σ weight · radiance over face i: irradiance on a surface that faces the light, scene
/// camera units. What the GPU's pass must agree with.
#[must_use]
pub fn sum_faces(light: &FaceLight) -> Vec<Vec3> {
    let mut sums = Vec::new();
    sum_faces_into(light, &mut sums);
    sums
}

/// The same into memory that is used again.
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
