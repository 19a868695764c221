//! Irradiance of light that phantoms reflect, in the air around the objects, as ambient cubes (McTaggart
//! 2004).

use super::directions::{AXES, Directions};
use super::obstacles::{FirstHit, Obstacles};
use super::region::Region;
use super::result::{Irradiance, VOLUME_SIZE};
use super::shares::{DistantLight, TileShares};
use glam::{UVec3, Vec3};

/// Distance from a virtual surface, in distances of probes, below which a probe stands for its neighbours
/// no longer: what it sees is not what surfaces beside it see.
const BESIDE: f32 = 0.5;

/// A grid of probes, which is finer about the objects along x and y, as that of the ground is.
pub(super) struct Volume {
    probes: Vec<Probe>,
}

struct Probe {
    /// Tiles of phantoms that are visible without virtual objects: index of the direction and tile.
    phantoms: Vec<(usize, u32)>,
    window: f32,
    /// Whether it is neither inside an object nor close to one.
    is_outside: bool,
}

impl Volume {
    pub fn new(obstacles: &Obstacles, directions: &Directions, region: &Region) -> Self {
        let [nx, ny, nz] = VOLUME_SIZE;
        let counts = Vec3::new(nx as f32, ny as f32, nz as f32);
        let place = |cell: UVec3| region.in_air((cell.as_vec3() + 0.5) / counts);
        let middle = UVec3::new(nx, ny, nz) / 2;
        let beside = BESIDE * (place(middle) - place(middle - 1)).min_element();
        let probes = (0..nx * ny * nz)
            .map(|i| {
                let point = place(UVec3::new(i % nx, i / nx % ny, i / (nx * ny)));
                probe(point, obstacles, directions, region, beside)
            })
            .collect();
        Self { probes }
    }

    /// Computes the irradiance at every probe on surfaces that face the six axes.
    pub fn gather(
        &self,
        tiles: &TileShares,
        directions: &Directions,
        light: &DistantLight<'_>,
        out: &mut Irradiance,
    ) {
        for face in &mut out.volume {
            face.clear();
            face.resize(self.probes.len(), Vec3::ZERO);
        }
        for (i, probe) in self.probes.iter().enumerate() {
            for (direction, tile) in &probe.phantoms {
                let d = directions.all[*direction];
                let radiance = tiles.radiance(*tile, light);
                for (face, axis) in out.volume.iter_mut().zip(AXES) {
                    let weight = d.dot(axis).max(0.0) * Directions::solid_angle();
                    face[i] += radiance * (weight * probe.window);
                }
            }
        }
        (out.volume.iter_mut()).for_each(|face| self.fill_inside(face));
    }

    /// Sets probes inside objects or close to them to the mean of their neighbours, so that surfaces
    /// beside them are neither too dark nor too bright.
    fn fill_inside(&self, face: &mut [Vec3]) {
        let [nx, ny, nz] = VOLUME_SIZE.map(|n| n as usize);
        let strides = [(1, nx), (nx, ny), (nx * ny, nz)];
        for i in (0..face.len()).filter(|i| !self.probes[*i].is_outside) {
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for (stride, n) in strides {
                let at = i / stride % n;
                let before = (at > 0).then(|| i - stride);
                let after = (at + 1 < n).then(|| i + stride);
                for j in [before, after]
                    .into_iter()
                    .flatten()
                    .filter(|j| self.probes[*j].is_outside)
                {
                    sum += face[j];
                    count += 1.0;
                }
            }
            if count > 0.0 {
                face[i] = sum / count;
            }
        }
    }
}

fn probe(
    point: Vec3,
    obstacles: &Obstacles,
    directions: &Directions,
    region: &Region,
    beside: f32,
) -> Probe {
    let mut probe = Probe {
        phantoms: Vec::new(),
        window: region.window(point),
        is_outside: false,
    };
    let mut nearest = f32::INFINITY;
    for (i, d) in directions.all.iter().enumerate() {
        match obstacles.first_hit(point, *d) {
            FirstHit::Virtual(hit) => {
                nearest = nearest.min(hit.point.distance(point));
                let hidden = obstacles.hidden_tile(point, *d);
                probe.phantoms.extend(hidden.map(|tile| (i, tile)));
            }
            FirstHit::Ground(_) | FirstHit::Sky => probe.is_outside = true,
            FirstHit::Phantom(tile) => probe.phantoms.push((i, tile)),
        }
    }
    probe.is_outside &= nearest >= beside;
    probe
}
