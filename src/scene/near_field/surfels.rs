//! Points on the virtual objects that receive and throw back light.

use super::receivers::GroundGrid;
use super::sides::Sides;
use super::{Directions, Light, Met, Obstacles, Region, SurfacePoint};
use crate::{Material, Part, SceneTexture};
use glam::Vec3;
use penumbra_lighting::lobes;
use penumbra_lighting::lobes::Family;
use std::f32::consts::PI;

/// Points on all objects together.
const COUNT: usize = 512;
/// F0 of what is no metal (a refractive index of 1.5).
const DIELECTRIC: f32 = 0.04;
/// Highlights are taken no sharper than this: a few rays cannot follow them.
const SHARPEST: f32 = 0.09;

/// A point of a virtual surface.
struct Surfel {
    position: Vec3,
    normal: Vec3,
    surface: Surface,
    /// Directions in which it sees the sky.
    sky: u128,
    /// Ground texels (`u32::MAX` beyond the grid) that it sees, and their form factors · π.
    ground: Vec<(u32, f32)>,
    /// Other surfels, likewise.
    others: Vec<(u32, f32)>,
    /// Sides of phantoms, likewise.
    phantoms: Vec<(u32, f32)>,
}

/// A part's material, averaged over its textures.
#[derive(Clone, Copy, Debug)]
struct Surface {
    diffuse: Vec3,
    f0: Vec3,
    /// Width of its lobe.
    gloss: f32,
    emissive: Vec3,
}

impl Surface {
    fn of(material: &Material) -> Self {
        let texture = material
            .base_colour_texture
            .as_deref()
            .map_or(Vec3::ONE, mean_colour);
        let base = material.base_colour.truncate() * texture;
        let metallic = material.metallic.clamp(0.0, 1.0);
        let dielectric = DIELECTRIC * material.specular;
        if let Some(phong) = &material.phong {
            let parameter = lobes::phong_parameter(phong.exponent);
            return Self {
                diffuse: base,
                f0: phong.specular,
                gloss: lobes::own_width(Family::Phong, parameter).max(SHARPEST),
                emissive: material.emissive,
            };
        }
        Self {
            diffuse: base * (1.0 - metallic) * (1.0 - dielectric),
            f0: Vec3::splat(dielectric).lerp(base, metallic),
            gloss: lobes::own_width(Family::Ggx, material.roughness).max(SHARPEST),
            emissive: material.emissive,
        }
    }
}

/// Mean linear colour of an sRGB texture, from at most 64² of its texels.
fn mean_colour(texture: &SceneTexture) -> Vec3 {
    let texels = texture.rgba.len() / 4;
    let step = (texels / 4096).max(1);
    let linear = |c: u8| penumbra_camera::linear_from_srgb(f32::from(c) / 255.0);
    let colours = texture.rgba.chunks_exact(4).step_by(step);
    let (sum, count) = colours.fold((Vec3::ZERO, 0.0f32), |(sum, n), c| {
        (
            sum + Vec3::new(linear(c[0]), linear(c[1]), linear(c[2])),
            n + 1.0,
        )
    });
    sum / count.max(1.0)
}

/// What a ray from the real scene meets on a virtual object.
pub struct Sighting {
    surfel: u32,
    /// Where the mirrored ray goes.
    mirror: Vec3,
    /// What it meets there.
    behind: Behind,
}

/// What a mirrored ray meets.
enum Behind {
    Sky,
    /// Ground texel, see [`GroundGrid::texel`].
    Ground(u32),
    Surfel(u32),
    /// Side of a phantom.
    Phantom(u32),
}

/// All of them.
pub struct Surfels {
    all: Vec<Surfel>,
    /// Radiance thrown back diffusely, and emitted.
    radiance: Vec<Vec3>,
    /// The same with what is mirrored, as if it were spread evenly: for further bounces.
    spread: Vec<Vec3>,
    before: Vec<Vec3>,
}

impl Surfels {
    pub(super) fn new(
        casters: &[Part],
        obstacles: &Obstacles,
        directions: &Directions,
        region: &Region,
    ) -> Self {
        let mut all = scatter(casters);
        let seen: Vec<_> = all
            .iter()
            .map(|s| look(s, &all, obstacles, directions, region))
            .collect();
        for (surfel, seen) in all.iter_mut().zip(seen) {
            surfel.sky = seen.sky;
            (surfel.ground, surfel.others, surfel.phantoms) =
                (seen.ground, seen.others, seen.phantoms);
        }
        let dark = vec![Vec3::ZERO; all.len()];
        Self {
            all,
            radiance: dark.clone(),
            spread: dark.clone(),
            before: dark,
        }
    }

    /// The sighting at a hit by a ray along `direction`.
    pub(super) fn sight(
        &self,
        hit: &SurfacePoint,
        direction: Vec3,
        obstacles: &Obstacles,
        region: &Region,
    ) -> Option<Sighting> {
        let surfel = nearest(&self.all, hit)?;
        let mirror = direction.normalize().reflect(hit.normal);
        let behind = match obstacles.meet(hit.point + hit.normal * region.off(), mirror) {
            Met::Sky => Behind::Sky,
            Met::Ground(p) => Behind::Ground(GroundGrid::texel(region, p)),
            Met::Virtual(other) => Behind::Surfel(nearest(&self.all, &other)?),
            Met::Phantom(side) => Behind::Phantom(side),
        };
        Some(Sighting {
            surfel,
            mirror,
            behind,
        })
    }

    /// The surfel that stands for a point.
    pub(super) fn nearest(&self, hit: &SurfacePoint) -> Option<u32> {
        nearest(&self.all, hit)
    }

    /// Radiance of a surfel as if all of it were thrown back evenly.
    pub(super) fn spread(&self, i: u32) -> Vec3 {
        self.spread[i as usize]
    }

    /// Light under a new state of the dome; one bounce more of what was before.
    pub(super) fn shade(
        &mut self,
        directions: &Directions,
        ground: &GroundGrid,
        sides: &Sides,
        light: &Light<'_>,
    ) {
        std::mem::swap(&mut self.before, &mut self.spread);
        for (i, surfel) in self.all.iter().enumerate() {
            let sky = directions.irradiance(surfel.normal, surfel.sky);
            let on_ground =
                |(texel, weight): &(u32, f32)| light.floor * ground.share(*texel) * *weight;
            let from_ground: Vec3 = surfel.ground.iter().map(on_ground).sum();
            let on_other = |(k, weight): &(u32, f32)| self.before[*k as usize] * *weight;
            let from_others: Vec3 = surfel.others.iter().map(on_other).sum();
            let on_phantom = |(side, weight): &(u32, f32)| sides.radiance(*side, light) * *weight;
            let from_phantoms: Vec3 = surfel.phantoms.iter().map(on_phantom).sum();
            let arriving = (sky + from_ground + from_others + from_phantoms) / PI;
            let surface = &surfel.surface;
            self.radiance[i] = surface.emissive + surface.diffuse * arriving;
            self.spread[i] = self.radiance[i] + surface.f0 * arriving;
        }
    }

    /// Radiance that leaves towards whoever had this sighting.
    pub(super) fn radiance(
        &self,
        sighting: &Sighting,
        ground: &GroundGrid,
        sides: &Sides,
        light: &Light<'_>,
    ) -> Vec3 {
        let i = sighting.surfel as usize;
        let surface = &self.all[i].surface;
        let mirrored = match sighting.behind {
            Behind::Sky => light.from(sighting.mirror, surface.gloss),
            Behind::Ground(texel) => light.floor * ground.share(texel),
            Behind::Surfel(other) => self.spread[other as usize],
            Behind::Phantom(side) => sides.radiance(side, light),
        };
        self.radiance[i] + surface.f0 * mirrored
    }
}

/// Points spread over the triangles by area.
fn scatter(parts: &[Part]) -> Vec<Surfel> {
    let corners: Vec<(usize, [Vec3; 3])> = parts
        .iter()
        .enumerate()
        .flat_map(|(i, part)| world_triangles(part).map(move |t| (i, t)))
        .collect();
    let area = |t: &[Vec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
    let total: f32 = corners.iter().map(|(_, t)| area(t)).sum();
    let step = total / COUNT as f32;
    let surfaces: Vec<Surface> = parts.iter().map(|p| Surface::of(&p.material)).collect();
    let (mut surfels, mut passed) = (Vec::with_capacity(COUNT), 0.5 * step);
    for (part, triangle) in &corners {
        passed -= area(triangle);
        while passed < 0.0 && step > 0.0 {
            passed += step;
            surfels.push(surfel(triangle, surfels.len(), surfaces[*part]));
        }
    }
    surfels
}

/// A part's triangles in the world.
pub fn world_triangles(part: &Part) -> impl Iterator<Item = [Vec3; 3]> {
    let corner = |i: &u32| {
        let vertex = part.mesh.vertices.get(*i as usize)?;
        Some(
            part.world_from_part
                .transform_point3(vertex.position.as_dvec3())
                .as_vec3(),
        )
    };
    // A mirroring placement turns the winding round.
    let (second, third) = if part.world_from_part.determinant() < 0.0 {
        (2, 1)
    } else {
        (1, 2)
    };
    let triangle = move |c: &[u32]| Some([corner(&c[0])?, corner(&c[second])?, corner(&c[third])?]);
    part.mesh.indices.chunks_exact(3).filter_map(triangle)
}

/// The `k`th of points that fill a triangle evenly (Roberts' R2).
pub fn point_in(t: &[Vec3; 3], k: usize) -> Vec3 {
    let at = |step: f64| (0.5 + step * k as f64).fract() as f32;
    let (u, v) = (at(0.754_877_666_246_693), at(0.569_840_290_998_053));
    let (u, v) = if u + v > 1.0 {
        (1.0 - u, 1.0 - v)
    } else {
        (u, v)
    };
    t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v
}

fn surfel(t: &[Vec3; 3], index: usize, surface: Surface) -> Surfel {
    Surfel {
        position: point_in(t, index),
        normal: (t[1] - t[0]).cross(t[2] - t[0]).normalize_or(Vec3::Z),
        surface,
        sky: 0,
        ground: Vec::new(),
        others: Vec::new(),
        phantoms: Vec::new(),
    }
}

fn nearest(all: &[Surfel], hit: &SurfacePoint) -> Option<u32> {
    let badness = |s: &Surfel| {
        let turned = 1.0 - s.normal.dot(hit.normal);
        s.position.distance_squared(hit.point) * (1.0 + 8.0 * turned * turned)
    };
    let all = all.iter().enumerate().map(|(i, s)| (i, badness(s)));
    all.min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(i, _)| i as u32)
}

/// What a surfel sees; see [`Surfel`].
#[derive(Default)]
struct Seen {
    sky: u128,
    ground: Vec<(u32, f32)>,
    others: Vec<(u32, f32)>,
    phantoms: Vec<(u32, f32)>,
}

fn look(
    surfel: &Surfel,
    all: &[Surfel],
    obstacles: &Obstacles,
    directions: &Directions,
    region: &Region,
) -> Seen {
    let origin = surfel.position + surfel.normal * region.off();
    let mut seen = Seen::default();
    for (i, d) in directions.all.iter().enumerate() {
        let weight = d.dot(surfel.normal) * Directions::solid_angle();
        if weight <= 0.0 {
            continue;
        }
        match obstacles.meet(origin, *d) {
            Met::Sky => seen.sky |= 1 << i,
            Met::Ground(p) => seen.ground.push((GroundGrid::texel(region, p), weight)),
            Met::Virtual(hit) => seen.others.extend(nearest(all, &hit).map(|s| (s, weight))),
            Met::Phantom(side) => seen.phantoms.push((side, weight)),
        }
    }
    seen
}
