//! Where in the real scene the light of virtual objects arrives.

use super::sides::Sides;
use super::surfels::{Sighting, Surfels};
use super::{Directions, GROUND_SIDE, Light, Met, NearLight, Obstacles, Region, VOLUME_SIZE};
use glam::{UVec3, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Rays from each ground texel that look for virtual surfaces.
const GATHERED: usize = 48;

/// The ground around the objects.
pub struct GroundGrid {
    texels: Vec<Texel>,
    /// Share of the dome's light that virtual objects leave to each texel.
    shares: Vec<f32>,
    side: u32,
}

struct Texel {
    /// Directions in which virtual objects are in the way.
    behind_virtual: u128,
    /// Directions in which phantoms are.
    behind_real: u128,
    /// Virtual surfaces in sight, and the phantom sides that they hide; each stands for the
    /// same form factor.
    sightings: Vec<(Sighting, Option<u32>)>,
    /// Phantom sides in sight were nothing virtual there, likewise.
    phantoms: Vec<u32>,
    window: f32,
}

impl GroundGrid {
    pub(super) fn new(
        obstacles: &Obstacles,
        surfels: &Surfels,
        directions: &Directions,
        region: &Region,
    ) -> Self {
        let side = if obstacles.floor.is_some() {
            GROUND_SIDE
        } else {
            0
        };
        let size = (region.high - region.low).truncate();
        let texels: Vec<Texel> = (0..side * side)
            .map(|i| {
                let at = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / side as f32;
                let point = (region.low.truncate() + at * size).extend(region.floor);
                texel(point, i, obstacles, surfels, directions, region)
            })
            .collect();
        Self {
            shares: vec![1.0; texels.len()],
            texels,
            side,
        }
    }

    /// Number of the texel around a ground point; `u32::MAX` beyond the grid.
    pub(super) fn texel(region: &Region, p: Vec3) -> u32 {
        let at = (p - region.low).truncate() / (region.high - region.low).truncate();
        if at.min_element() < 0.0 || at.max_element() >= 1.0 {
            return u32::MAX;
        }
        let cell = (at * GROUND_SIDE as f32).as_uvec2();
        cell.y * GROUND_SIDE + cell.x
    }

    /// Share of the light that arrives at a texel in spite of the virtual objects.
    pub(super) fn share(&self, texel: u32) -> f32 {
        self.shares.get(texel as usize).copied().unwrap_or(1.0)
    }

    /// Finds the shares under a new state of the dome.
    pub(super) fn shade(&mut self, directions: &Directions) {
        for (texel, share) in self.texels.iter().zip(&mut self.shares) {
            let all = directions
                .irradiance(Vec3::Z, !texel.behind_real)
                .element_sum();
            let lost = texel.behind_virtual & !texel.behind_real;
            let lost = directions.irradiance(Vec3::Z, lost).element_sum();
            *share = if all > 0.0 { 1.0 - lost / all } else { 1.0 };
        }
    }

    /// Irradiance on every texel.
    pub(super) fn lit(
        &self,
        surfels: &Surfels,
        sides: &Sides,
        light: &Light<'_>,
        near: &mut NearLight,
    ) {
        let factor = |texel: &Texel| texel.window * PI / GATHERED as f32;
        let before = |side: u32| light.of_phantom(side);
        let now = |side: u32| sides.radiance(side, light);
        // Sides that are hidden now are among the phantoms' too, so what is taken away for
        // them is what they would throw now.
        let change = |texel: &Texel| {
            let sightings = texel.sightings.iter().map(|(s, side)| {
                surfels.radiance(s, self, sides, light) - side.map_or(Vec3::ZERO, now)
            });
            let dimmed = texel.phantoms.iter().map(|s| now(*s) - before(*s));
            (sightings.sum::<Vec3>() + dimmed.sum::<Vec3>()) * factor(texel)
        };
        let thrown = |radiance: &dyn Fn(u32) -> Vec3| {
            let each = |texel: &Texel| {
                texel.phantoms.iter().map(|s| radiance(*s)).sum::<Vec3>() * factor(texel)
            };
            self.smoothed(&self.texels.iter().map(each).collect::<Vec<_>>())
        };
        near.change.ground = self.smoothed(&self.texels.iter().map(change).collect::<Vec<_>>());
        near.real.ground = thrown(&before);
        near.real_now.ground = thrown(&now);
    }

    fn smoothed(&self, raw: &[Vec3]) -> Vec<Vec3> {
        let once = |raw: &[Vec3]| -> Vec<Vec3> {
            let texels = 0..self.side * self.side;
            texels
                .map(|i| self.smooth(raw, i % self.side, i / self.side))
                .collect()
        };
        once(&once(raw))
    }

    /// A tent over 3×3 texels, taken twice: the rays of one texel are few.
    fn smooth(&self, raw: &[Vec3], x: u32, y: u32) -> Vec3 {
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
        for (dx, dy) in (0..9).map(|k| (k % 3, k / 3)) {
            let (u, v) = ((x + dx).wrapping_sub(1), (y + dy).wrapping_sub(1));
            if u < self.side && v < self.side {
                let w = [1.0, 2.0, 1.0][dx as usize] * [1.0, 2.0, 1.0][dy as usize];
                sum += raw[(v * self.side + u) as usize] * w;
                weight += w;
            }
        }
        sum / f32::max(weight, 1.0)
    }
}

fn texel(
    point: Vec3,
    number: u32,
    obstacles: &Obstacles,
    surfels: &Surfels,
    directions: &Directions,
    region: &Region,
) -> Texel {
    let origin = point + Vec3::Z * region.off();
    let (mut behind_virtual, mut behind_real) = (0, 0);
    for (i, d) in directions.all.iter().enumerate().filter(|(_, d)| d.z > 0.0) {
        match obstacles.meet(origin, *d) {
            Met::Virtual(_) => {
                behind_virtual |= 1 << i;
                let both = obstacles.behind(origin, *d).is_some();
                behind_real |= u128::from(both) << i;
            }
            Met::Phantom(_) => behind_real |= 1 << i,
            Met::Ground(_) | Met::Sky => (),
        }
    }
    let turn = TAU * (f64::from(number) * 0.618_033_988_749_895).fract() as f32;
    let (mut sightings, mut phantoms) = (Vec::new(), Vec::new());
    for d in (0..GATHERED).map(|k| cosine_direction(k, turn)) {
        match obstacles.meet(origin, d) {
            Met::Virtual(hit) => {
                let behind = obstacles.behind(origin, d);
                phantoms.extend(behind);
                sightings.extend(
                    surfels
                        .sight(&hit, d, obstacles, region)
                        .map(|s| (s, behind)),
                );
            }
            Met::Phantom(side) => phantoms.push(side),
            Met::Ground(_) | Met::Sky => (),
        }
    }
    Texel {
        behind_virtual,
        behind_real,
        sightings,
        phantoms,
        window: region.window(point),
    }
}

/// One of `GATHERED` directions around +Z, as dense as the cosine.
fn cosine_direction(k: usize, turn: f32) -> Vec3 {
    let u = (k as f32 + 0.5) / GATHERED as f32;
    let phi = turn + TAU * (k as f64 * 0.618_033_988_749_895).fract() as f32;
    let (sin, cos) = phi.sin_cos();
    let r = u.sqrt();
    Vec3::new(r * cos, r * sin, (1.0 - u).sqrt())
}

/// The air around the objects.
pub struct Volume {
    probes: Vec<Probe>,
}

struct Probe {
    /// By direction: a virtual surface and what it hides.
    sightings: Vec<(usize, Sighting, Hidden)>,
    /// Ground in sight.
    ground: Vec<(usize, u32)>,
    /// Phantom sides in sight.
    phantoms: Vec<(usize, u32)>,
    window: f32,
    /// It is not inside of something.
    outside: bool,
}

#[derive(Clone, Copy)]
enum Hidden {
    Sky,
    Ground,
    Phantom(u32),
}

impl Volume {
    pub(super) fn new(
        obstacles: &Obstacles,
        surfels: &Surfels,
        directions: &Directions,
        region: &Region,
    ) -> Self {
        let [nx, ny, nz] = VOLUME_SIZE;
        let size = region.high - region.low;
        let counts = Vec3::new(nx as f32, ny as f32, nz as f32);
        let probes = (0..nx * ny * nz)
            .map(|i| {
                let cell = UVec3::new(i % nx, i / nx % ny, i / (nx * ny)).as_vec3();
                let point = region.low + size * (cell + 0.5) / counts;
                probe(point, obstacles, surfels, directions, region)
            })
            .collect();
        Self { probes }
    }

    /// Irradiance at every probe on surfaces that face the six axes.
    pub(super) fn lit(
        &self,
        surfels: &Surfels,
        ground: &GroundGrid,
        sides: &Sides,
        directions: &Directions,
        light: &Light<'_>,
        near: &mut NearLight,
    ) {
        for part in [&mut near.change, &mut near.real, &mut near.real_now] {
            for face in &mut part.volume {
                face.clear();
                face.resize(self.probes.len(), Vec3::ZERO);
            }
        }
        for (i, probe) in self.probes.iter().enumerate() {
            let add = |volume: &mut [Vec<Vec3>; 6], direction: usize, radiance: Vec3| {
                let d = directions.all[direction];
                for (face, axis) in volume.iter_mut().zip(super::AXES) {
                    let weight = d.dot(axis).max(0.0) * Directions::solid_angle();
                    face[i] += radiance * (weight * probe.window);
                }
            };
            for (direction, sighting, hidden) in &probe.sightings {
                let before = match hidden {
                    Hidden::Sky => Vec3::ZERO,
                    Hidden::Ground => light.floor,
                    // Hidden sides are among the probe's phantoms too; see the ground.
                    Hidden::Phantom(side) => sides.radiance(*side, light),
                };
                let now = surfels.radiance(sighting, ground, sides, light);
                add(&mut near.change.volume, *direction, now - before);
            }
            for (direction, texel) in &probe.ground {
                let lost = light.floor * (ground.share(*texel) - 1.0);
                add(&mut near.change.volume, *direction, lost);
            }
            for (direction, side) in &probe.phantoms {
                let (before, now) = (light.of_phantom(*side), sides.radiance(*side, light));
                add(&mut near.change.volume, *direction, now - before);
                add(&mut near.real.volume, *direction, before);
                add(&mut near.real_now.volume, *direction, now);
            }
        }
        for part in [&mut near.change, &mut near.real, &mut near.real_now] {
            part.volume.iter_mut().for_each(|face| self.fill(face));
        }
    }

    /// Probes inside of things take the mean of their neighbours, so that surfaces beside
    /// them are not dimmed.
    fn fill(&self, face: &mut [Vec3]) {
        let [nx, ny, nz] = VOLUME_SIZE.map(|n| n as usize);
        let strides = [(1, nx), (nx, ny), (nx * ny, nz)];
        for i in (0..face.len()).filter(|i| !self.probes[*i].outside) {
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for (stride, n) in strides {
                let at = i / stride % n;
                let before = (at > 0).then(|| i - stride);
                let after = (at + 1 < n).then(|| i + stride);
                for j in [before, after]
                    .into_iter()
                    .flatten()
                    .filter(|j| self.probes[*j].outside)
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
) -> Probe {
    let mut probe = Probe {
        sightings: Vec::new(),
        ground: Vec::new(),
        phantoms: Vec::new(),
        window: region.window(point),
        outside: false,
    };
    for (i, d) in directions.all.iter().enumerate() {
        match obstacles.meet(point, *d) {
            Met::Virtual(hit) => {
                let hidden = match obstacles.behind(point, *d) {
                    Some(side) => Hidden::Phantom(side),
                    None if obstacles.floor.is_some() && d.z < 0.0 => Hidden::Ground,
                    None => Hidden::Sky,
                };
                if let Hidden::Phantom(side) = hidden {
                    probe.phantoms.push((i, side));
                }
                let sighting = surfels.sight(&hit, *d, obstacles, region);
                probe.sightings.extend(sighting.map(|s| (i, s, hidden)));
            }
            Met::Ground(p) => {
                probe.outside = true;
                let texel = GroundGrid::texel(region, p);
                if texel != u32::MAX {
                    probe.ground.push((i, texel));
                }
            }
            Met::Sky => probe.outside = true,
            Met::Phantom(side) => probe.phantoms.push((i, side)),
        }
    }
    probe
}
