//! Irradiance of indirect light in the air around the objects, as ambient cubes (McTaggart 2004).

use super::directions::{AXES, Directions};
use super::obstacles::{FirstHit, Obstacles};
use super::region::Region;
use super::result::{IndirectLight, VOLUME_SIZE};
use super::shares::{DistantLight, GroundShares, SideShares, ground_texel};
use super::surfels::{ReflectingPoint, Surfels};
use glam::{UVec3, Vec3};

/// Distance from a virtual surface, in distances of probes, below which a probe stands for its neighbours
/// no longer: what it sees is not what surfaces beside it see.
const BESIDE: f32 = 0.5;
/// Least width of the lobe in which a probe sees a mirror's surroundings, radians: twice the distance of its
/// directions. A narrower one makes single probes as bright as a window, which the eye sees as a spot on
/// the wall.
const MIRRORED: f32 = 0.4;

/// A regular grid of probes.
pub(super) struct Volume {
    probes: Vec<Probe>,
}

struct Probe {
    /// Index of a direction, the virtual surface there and what it hides.
    virtual_points: Vec<(usize, ReflectingPoint, Hidden)>,
    /// Index of a direction and the ground texel there.
    ground: Vec<(usize, u32)>,
    /// Index of a direction and the phantom side there.
    phantoms: Vec<(usize, u32)>,
    window: f32,
    /// Whether it is neither inside an object nor close to one.
    is_outside: bool,
}

#[derive(Clone, Copy)]
enum Hidden {
    Sky,
    Ground,
    Phantom(u32),
}

impl Volume {
    pub fn new(
        obstacles: &Obstacles,
        surfels: &Surfels,
        directions: &Directions,
        region: &Region,
    ) -> Self {
        let [nx, ny, nz] = VOLUME_SIZE;
        let size = region.high - region.low;
        let counts = Vec3::new(nx as f32, ny as f32, nz as f32);
        let beside = BESIDE * (size / counts).min_element();
        let probes = (0..nx * ny * nz)
            .map(|i| {
                let cell = UVec3::new(i % nx, i / nx % ny, i / (nx * ny)).as_vec3();
                let point = region.low + size * (cell + 0.5) / counts;
                probe(point, obstacles, surfels, directions, region, beside)
            })
            .collect();
        Self { probes }
    }

    /// Computes the irradiance at every probe on surfaces that face the six axes.
    pub fn gather(
        &self,
        surfels: &Surfels,
        ground: &GroundShares,
        sides: &SideShares,
        directions: &Directions,
        light: &DistantLight<'_>,
        out: &mut IndirectLight,
    ) {
        for part in [&mut out.change, &mut out.real, &mut out.real_now] {
            for face in &mut part.volume {
                face.clear();
                face.resize(self.probes.len(), Vec3::ZERO);
            }
        }
        for (i, probe) in self.probes.iter().enumerate() {
            let add = |volume: &mut [Vec<Vec3>; 6], direction: usize, radiance: Vec3| {
                let d = directions.all[direction];
                for (face, axis) in volume.iter_mut().zip(AXES) {
                    let weight = d.dot(axis).max(0.0) * Directions::solid_angle();
                    face[i] += radiance * (weight * probe.window);
                }
            };
            for (direction, point, hidden) in &probe.virtual_points {
                let before = match hidden {
                    Hidden::Sky => Vec3::ZERO,
                    Hidden::Ground => light.floor,
                    // Hidden sides are in `phantoms` too, as for the ground.
                    Hidden::Phantom(side) => sides.radiance(*side, light),
                };
                let now = surfels.radiance(point, MIRRORED, ground, sides, light);
                add(&mut out.change.volume, *direction, now - before);
            }
            for (direction, texel) in &probe.ground {
                let lost = light.floor * (ground.share(*texel) - Vec3::ONE);
                add(&mut out.change.volume, *direction, lost);
            }
            for (direction, side) in &probe.phantoms {
                let (before, now) = (light.phantom_radiance(*side), sides.radiance(*side, light));
                add(&mut out.change.volume, *direction, now - before);
                add(&mut out.real.volume, *direction, before);
                add(&mut out.real_now.volume, *direction, now);
            }
        }
        for part in [&mut out.change, &mut out.real, &mut out.real_now] {
            part.volume
                .iter_mut()
                .for_each(|face| self.fill_inside(face));
        }
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
    surfels: &Surfels,
    directions: &Directions,
    region: &Region,
    beside: f32,
) -> Probe {
    let mut probe = Probe {
        virtual_points: Vec::new(),
        ground: Vec::new(),
        phantoms: Vec::new(),
        window: region.window(point),
        is_outside: false,
    };
    let mut nearest = f32::INFINITY;
    for (i, d) in directions.all.iter().enumerate() {
        match obstacles.first_hit(point, *d) {
            FirstHit::Virtual(hit) => {
                nearest = nearest.min(hit.point.distance(point));
                let hidden = match obstacles.hidden_side(point, *d) {
                    Some(side) => Hidden::Phantom(side),
                    None if obstacles.floor.is_some() && d.z < 0.0 => Hidden::Ground,
                    None => Hidden::Sky,
                };
                if let Hidden::Phantom(side) = hidden {
                    probe.phantoms.push((i, side));
                }
                let virtual_point = surfels.reflecting_point(&hit, *d, obstacles, region);
                probe
                    .virtual_points
                    .extend(virtual_point.map(|p| (i, p, hidden)));
            }
            FirstHit::Ground(p) => {
                probe.is_outside = true;
                let texel = ground_texel(region, p);
                if texel != u32::MAX {
                    probe.ground.push((i, texel));
                }
            }
            FirstHit::Sky => probe.is_outside = true,
            FirstHit::Phantom(side) => probe.phantoms.push((i, side)),
        }
    }
    probe.is_outside &= nearest >= beside;
    probe
}
