//! Compact sources (sun, lamp, window) in the faces' light.

use super::Membership;
use glam::Vec3;

/// A compact source, and its share of each face's light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaceSource {
    /// Constant while the source is followed, and never reused.
    pub id: u32,
    /// Unit vector towards its centre of energy, world.
    pub direction: Vec3,
    /// Half angle of a cone with its solid angle, radians.
    pub angular_radius: f32,
    /// Unit vectors distributed over the source, world, and the share of its light from each.
    pub spread: Vec<(Vec3, f32)>,
    /// Faces that contain its pixels, ascending, and the source's irradiance in each: a part of the
    /// face's S_i.
    pub irradiance_in_faces: Vec<(u32, Vec3)>,
}

impl FaceSource {
    /// Returns the irradiance on a surface that faces it: the sum over all faces.
    #[must_use]
    pub fn irradiance(&self) -> Vec3 {
        self.irradiance_in_faces.iter().map(|(_, s)| *s).sum()
    }

    /// Sums pixels, given as their faces (see [`FaceOfPixel`]), weights and radiance.
    pub fn take(&mut self, pixels: impl Iterator<Item = (u32, f32, Vec3)>) {
        self.irradiance_in_faces.clear();
        for (face, weight, radiance) in pixels {
            let at = self
                .irradiance_in_faces
                .binary_search_by_key(&face, |(f, _)| *f);
            let at = at.unwrap_or_else(|at| {
                self.irradiance_in_faces.insert(at, (face, Vec3::ZERO));
                at
            });
            self.irradiance_in_faces[at].1 += radiance * weight;
        }
    }
}

/// The face of each pixel: the inverse of a [`Membership`].
#[derive(Clone, Debug, Default)]
pub struct FaceOfPixel {
    /// Position of each pixel in the table, or [`Self::NOWHERE`].
    position: Vec<u32>,
}

impl FaceOfPixel {
    const NOWHERE: u32 = u32::MAX;

    /// Creates the inverse for the pixels in `table`, by the numbers they had before renumbering:
    /// pixel i of the table was `numbers[i]` of `count`.
    #[must_use]
    pub fn new(table: &Membership, numbers: &[u32], count: usize) -> Self {
        let mut position = vec![Self::NOWHERE; count];
        for (at, pixel) in table.pixels.iter().enumerate() {
            let number = numbers.get(*pixel as usize);
            if let Some(place) = number.and_then(|n| position.get_mut(*n as usize)) {
                *place = at as u32;
            }
        }
        Self { position }
    }

    /// Returns the face and weight of a pixel; `None` below the horizon.
    #[must_use]
    pub fn of(&self, table: &Membership, pixel: u32) -> Option<(u32, f32)> {
        let at = *self.position.get(pixel as usize)?;
        let weight = *table.weights.get(at as usize)?;
        let face = table.begins.partition_point(|begin| *begin <= at);
        Some((face.checked_sub(1)? as u32, weight))
    }
}

#[cfg(test)]
mod tests {
    use super::super::GeodesicDome;
    use super::*;
    use crate::cube::CubeGrid;

    #[test]
    fn pixels_are_found_in_their_faces() {
        let (dome, grid) = (GeodesicDome::new(2).unwrap(), CubeGrid::new(32));
        let table = Membership::new(&dome, &grid.directions, &grid.solid_angles);
        let numbers: Vec<u32> = (0..grid.directions.len() as u32).collect();
        let back = FaceOfPixel::new(&table, &numbers, numbers.len());
        for (i, d) in grid.directions.iter().enumerate() {
            let found = back.of(&table, i as u32);
            let face = found.map(|(face, _)| face as usize);
            assert_eq!(face, dome.face_of(*d));
            let (Some((_, weight)), w) = (found, grid.solid_angles[i]) else {
                continue;
            };
            assert!((weight / w - 1.0).abs() < 0.2);
        }
    }

    #[test]
    fn taken_irradiance_is_sorted_by_face() {
        let mut source = FaceSource::default();
        let pixels = [(7, 0.5, Vec3::X), (3, 1.0, Vec3::Y), (7, 1.5, Vec3::X)];
        source.take(pixels.into_iter());
        assert_eq!(
            source.irradiance_in_faces,
            [(3, Vec3::Y), (7, 2.0 * Vec3::X)]
        );
        assert_eq!(source.irradiance(), Vec3::new(2.0, 1.0, 0.0));
    }
}
