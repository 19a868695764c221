//! The input of the luminance parameters of shadowing planes: the light in each dome face.

use super::*;
use crate::geodesic::{FaceLight, FaceOfPixel, FaceSource, GeodesicDome, Membership};
use glam::Quat;

/// Maximum number of recycled buffers: in use by the compositor, on the way to it, being filled.
const MAX_RECYCLED: usize = 4;

/// The membership table of one calibration, dome and rotation, and recycled buffers for its
/// radiance.
pub(super) struct FaceTable {
    frequency: u32,
    world_from_dome: Quat,
    membership: Arc<Membership>,
    /// Pixels of the picture whose radiance is handed over first, ascending.
    pixels: Vec<u32>,
    /// Texels of the cube whose radiance follows, ascending.
    texels: Vec<u32>,
    /// Faces of pixels, then of texels.
    faces: FaceOfPixel,
    /// Buffers handed over before; one without another owner is recycled.
    recycled: Vec<Arc<FaceLight>>,
}

/// The cube, and the fill of its unseen part.
pub(super) struct Filling<'a> {
    /// Complete sphere, compact sources included, scene camera units.
    pub full: &'a [Vec3],
    /// A smooth continuation of the seen texels over the unseen ones.
    pub around: &'a [Vec3],
    pub ground_radiance: Vec3,
}

impl FaceTable {
    fn new(
        frequency: u32,
        world_from_dome: Quat,
        view: &View,
        coverage: &[f32],
        grid: &CubeGrid,
    ) -> Option<Self> {
        let dome = GeodesicDome::new(frequency)?;
        let (mut directions, mut sizes) = (Vec::new(), Vec::new());
        if let View::Fixed(fixed) = view {
            directions.clone_from(&fixed.pixels.directions);
            sizes.clone_from(&fixed.pixels.solid_angles);
        }
        let pixel_count = directions.len() as u32;
        directions.extend(&grid.directions);
        let unseen = |(i, w): (usize, &f32)| match view {
            View::Fixed(_) => w * (1.0 - coverage.get(i).unwrap_or(&0.0)).clamp(0.0, 1.0),
            // The seen part changes; the cube holds all of it.
            View::Moving(_) | View::Stated(_) => *w,
        };
        sizes.extend(grid.solid_angles.iter().enumerate().map(unseen));
        let mut membership = Membership::rotated(&dome, world_from_dome, &directions, &sizes);
        let used = compact(&mut membership, directions.len());
        let faces = FaceOfPixel::new(&membership, &used, directions.len());
        let (pixels, texels) = used.into_iter().partition(|&i| i < pixel_count);
        let texels: Vec<u32> = texels;
        Some(Self {
            frequency,
            world_from_dome,
            membership: Arc::new(membership),
            pixels,
            texels: texels.into_iter().map(|i| i - pixel_count).collect(),
            faces,
            recycled: Vec::new(),
        })
    }

    /// Fills a recycled buffer with `fill` and hands it out.
    fn hand_out(
        &mut self,
        sources: Vec<FaceSource>,
        fill: impl FnOnce(&mut Vec<[f32; 3]>, &[u32], &[u32]),
    ) -> Arc<FaceLight> {
        let free = |light: &mut Arc<FaceLight>| {
            let light = Arc::get_mut(light)?;
            Arc::get_mut(&mut light.radiance).is_some().then_some(())
        };
        let position = self
            .recycled
            .iter_mut()
            .position(|light| free(light).is_some());
        let mut light = match position {
            Some(at) => self.recycled.swap_remove(at),
            None => Arc::new(FaceLight {
                frequency: self.frequency,
                membership: self.membership.clone(),
                radiance: Arc::default(),
                sources: Vec::new(),
            }),
        };
        // Nobody else holds the buffer, so nothing is copied.
        if let Some(light) = Arc::get_mut(&mut light) {
            light.sources = sources;
            if let Some(radiance) = Arc::get_mut(&mut light.radiance) {
                radiance.clear();
                fill(radiance, &self.pixels, &self.texels);
            }
        }
        if self.recycled.len() < MAX_RECYCLED {
            self.recycled.push(light.clone());
        }
        light
    }
}

/// Renumbers a table's pixels so that those in no face are dropped; returns the old numbers of the
/// others, ascending.
fn compact(membership: &mut Membership, count: usize) -> Vec<u32> {
    const UNUSED: u32 = u32::MAX;
    let mut new_number = vec![UNUSED; count];
    for &i in &membership.pixels {
        new_number[i as usize] = 0;
    }
    let mut used = Vec::with_capacity(membership.pixels.len());
    for (old, new) in new_number
        .iter_mut()
        .enumerate()
        .filter(|(_, n)| **n != UNUSED)
    {
        *new = used.len() as u32;
        used.push(old as u32);
    }
    for i in &mut membership.pixels {
        *i = new_number[*i as usize];
    }
    used
}

impl EnvironmentEstimator {
    /// Switches the light in the faces of a geodesic dome on or off while running, and sets the
    /// dome's frequency (see [`GeodesicDome::new`]; an unsupported frequency switches it off).
    pub fn set_faces(&mut self, frequency: Option<u32>) {
        if self.settings.faces != frequency {
            self.settings.faces = frequency;
            let table = self.faces.as_ref();
            self.rebuild_faces(table.map_or(Quat::IDENTITY, |t| t.world_from_dome));
        }
    }

    /// Rotates the dome with the model to which it is attached. The table is rebuilt.
    pub fn rotate_faces(&mut self, world_from_dome: Quat) {
        let rotated = |table: &FaceTable| table.world_from_dome != world_from_dome;
        if self.faces.as_ref().is_some_and(rotated) {
            self.rebuild_faces(world_from_dome);
        }
    }

    pub(super) fn rebuild_faces(&mut self, world_from_dome: Quat) {
        let coverage = match &self.placed {
            View::Fixed(fixed) => &fixed.table.coverage,
            View::Moving(_) | View::Stated(_) => &self.coverage,
        };
        self.faces = self.settings.faces.and_then(|frequency| {
            FaceTable::new(
                frequency,
                world_from_dome,
                &self.placed,
                coverage,
                &self.grid,
            )
        });
    }

    /// Returns the radiance in the faces, in the scene camera's units, from the same pixels as the
    /// dome lights.
    pub(super) fn face_light(
        &mut self,
        gains: Mat3,
        filling: &Filling<'_>,
        sources: &[Source],
    ) -> Option<Arc<FaceLight>> {
        let mut table = self.faces.take()?;
        let sources = self.face_sources(&table, gains, filling, sources);
        let light = table.hand_out(sources, |out, pixels, texels| {
            let pixel = |&i: &u32| {
                (gains * self.radiance[i as usize])
                    .max(Vec3::ZERO)
                    .to_array()
            };
            out.extend(pixels.iter().map(pixel));
            let by_texel = !matches!(self.placed, View::Fixed(_));
            let texel = |&i: &u32| {
                let i = i as usize;
                if by_texel {
                    return filling.full[i].to_array();
                }
                self.unseen(i, filling.around, filling.ground_radiance)
                    .to_array()
            };
            out.extend(texels.iter().map(texel));
        });
        self.faces = Some(table);
        Some(light)
    }

    /// Returns the shares of the compact sources of this picture in the faces' light.
    fn face_sources(
        &self,
        table: &FaceTable,
        gains: Mat3,
        filling: &Filling<'_>,
        sources: &[Source],
    ) -> Vec<FaceSource> {
        let Dome::Adaptive(dome) = &self.dome else {
            return Vec::new();
        };
        let by_texel = !matches!(self.placed, View::Fixed(_));
        let solid_angles = match &self.placed {
            View::Fixed(fixed) => &fixed.pixels.solid_angles,
            View::Moving(_) | View::Stated(_) => &self.grid.solid_angles,
        };
        // The radiance of a pixel that is summed, and its part above the source's background.
        let share = |(i, flux): &(u32, Vec3)| {
            let (face, weight) = table.faces.of(&table.membership, *i)?;
            let at = *i as usize;
            let own = if by_texel {
                filling.full[at]
            } else {
                (gains * self.radiance[at]).max(Vec3::ZERO)
            };
            let above = gains * *flux / solid_angles[at].max(f32::MIN_POSITIVE);
            Some((face, weight, above.clamp(Vec3::ZERO, own)))
        };
        let followed = dome.face_sources().zip(sources);
        followed
            .map(|(mut followed, found)| {
                followed.take(found.parts.iter().filter_map(share));
                followed
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
