//! Surfels: points on the virtual objects that receive and reflect light.

use super::compact_sources::CompactSources;
use super::directions::Directions;
use super::lamplight::Lamplight;
use super::obstacles::{FirstHit, Obstacles, SurfacePoint};
use super::region::Region;
use super::result::NearbyRadiance;
use super::sampling::{point_in, world_triangles};
use super::shares::{DistantLight, GroundShares, TileShares, ground_texel};
use super::surface::Surface;
use super::surfel_index::SurfelIndex;
use crate::lamps::PlacedLamp;
use crate::mesh::Part;
use glam::Vec3;
use penumbra_interface::threads;
use std::f32::consts::PI;
use std::sync::Arc;

/// Number of surfels on all objects together.
const COUNT: usize = 4096;
/// The same where something moves, and rays are cast again every half second.
const COUNT_MOVING: usize = 512;
/// Surfels that a thread looks from at a time.
const CHUNK: usize = 32;

/// Distance, in sides of the squares that surfels stand for, from which a surfel stands for another surface.
const FAR_APART: f32 = 4.0;

/// A point of a virtual surface.
struct Surfel {
    position: Vec3,
    normal: Vec3,
    surface: Surface,
    /// Directions in which the sky is visible, one bit each.
    sky: u128,
    /// Visible ground texels (`u32::MAX` outside the grid) and their form factors · π.
    ground: Vec<(u32, f32)>,
    /// Visible surfels and their form factors · π.
    others: Vec<(u32, f32)>,
    /// Visible tiles of phantoms and their form factors · π.
    phantoms: Vec<(u32, f32)>,
}

/// A point of a virtual object that a ray hits.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct ReflectingPoint {
    surfel: u32,
    /// The reflected ray: its direction, and what it hits. `None` where the surface mirrors so
    /// little that this counts as diffuse.
    mirrored: Option<(Vec3, Source)>,
}

/// What a reflected ray hits.
#[derive(Clone, Copy, PartialEq)]
enum Source {
    Sky,
    /// Index of a ground texel, see [`ground_texel`].
    Ground(u32),
    Surfel(u32),
    /// Index of a tile of a phantom.
    Phantom(u32),
}

/// The surfels of all virtual objects and their radiance.
pub(super) struct Surfels {
    all: Vec<Surfel>,
    index: Arc<SurfelIndex>,
    /// Radiance that is reflected diffusely or emitted.
    radiance: Vec<Vec3>,
    /// The same with specular reflection as if it were diffuse: for further bounces.
    total: Vec<Vec3>,
    /// `total` of the last update.
    previous: Vec<Vec3>,
    compact: CompactSources,
    lamplight: Lamplight,
    /// Side of the square that a surfel stands for, metres.
    spacing: f32,
}

impl Surfels {
    pub(super) fn new(
        casters: &[Part],
        obstacles: &Obstacles,
        directions: &Directions,
        region: &Region,
        moves: bool,
    ) -> Self {
        let (mut all, share) = distribute(casters, if moves { COUNT_MOVING } else { COUNT });
        let spacing = share.sqrt();
        let look = Look {
            obstacles,
            directions,
            region,
            spacing,
        };
        let index = SurfelIndex::new(places(&all), spacing);
        let is_inside = threads::map(&all, CHUNK, |_, s| look.is_inside(s, &all, &index));
        let mut outside = is_inside.iter().map(|inside| !inside);
        all.retain(|_| outside.next().unwrap_or(true));
        let index = SurfelIndex::new(places(&all), spacing);
        let visible = threads::map(&all, CHUNK, |_, s| look.find_visible(s, &index));
        for (surfel, visible) in all.iter_mut().zip(visible) {
            surfel.sky = visible.sky;
            (surfel.ground, surfel.others, surfel.phantoms) =
                (visible.ground, visible.others, visible.phantoms);
        }
        let dark = vec![Vec3::ZERO; all.len()];
        let lamplight = Lamplight::new(places(&all).into_iter(), region.offset());
        let compact = CompactSources::new(places(&all).into_iter(), region.offset());
        Self {
            all,
            index: Arc::new(index),
            radiance: dark.clone(),
            total: dark.clone(),
            previous: dark,
            compact,
            lamplight,
            spacing,
        }
    }

    /// The surfels by their places.
    pub fn index(&self) -> Arc<SurfelIndex> {
        Arc::clone(&self.index)
    }

    /// Writes the radiance of all surfels.
    pub fn write(&self, to: &mut NearbyRadiance) {
        to.diffuse.clone_from(&self.radiance);
        to.total.clone_from(&self.total);
    }

    /// Returns the reflecting point at `hit` of a ray along `direction`.
    pub fn reflecting_point(
        &self,
        hit: &SurfacePoint,
        direction: Vec3,
        obstacles: &Obstacles,
        region: &Region,
    ) -> Option<ReflectingPoint> {
        let surfel = self.nearest(hit)?;
        if !self.all[surfel as usize].surface.is_glossy() {
            return Some(ReflectingPoint {
                surfel,
                mirrored: None,
            });
        }
        let reflected = direction.normalize().reflect(hit.normal);
        let source = match obstacles.first_hit(hit.point + hit.normal * region.offset(), reflected)
        {
            FirstHit::Sky => Source::Sky,
            FirstHit::Ground(p) => Source::Ground(ground_texel(region, p)),
            FirstHit::Virtual(other) => Source::Surfel(self.nearest(&other)?),
            FirstHit::Phantom(tile) => Source::Phantom(tile),
        };
        Some(ReflectingPoint {
            surfel,
            mirrored: Some((reflected, source)),
        })
    }

    /// Whether `hit` is on the front of the surface at `point`; its back is inside an object.
    pub fn is_front(&self, point: &ReflectingPoint, hit: &SurfacePoint) -> bool {
        is_front(&self.all[point.surfel as usize], hit, self.spacing)
    }

    /// Returns the surfel that represents a point.
    pub fn nearest(&self, hit: &SurfacePoint) -> Option<u32> {
        self.index.nearest(hit)
    }

    /// Radiance of a surfel, with specular reflection as if it were diffuse.
    pub fn total_radiance(&self, i: u32) -> Vec3 {
        self.total[i as usize]
    }

    /// Finds what `lamps` reach, before [`Self::update`].
    pub fn light_up(&mut self, lamps: &[PlacedLamp], obstacles: &Obstacles) {
        self.lamplight.update(lamps, obstacles);
    }

    /// Computes the radiance under a new state of the light, with one more bounce of the last
    /// update's radiance.
    pub fn update(
        &mut self,
        directions: &Directions,
        ground: &GroundShares,
        tiles: &TileShares,
        light: &DistantLight<'_>,
        obstacles: &Obstacles,
    ) {
        std::mem::swap(&mut self.previous, &mut self.total);
        self.compact.update(&directions.compact, obstacles);
        for (i, surfel) in self.all.iter().enumerate() {
            let sky =
                directions.irradiance_of_cells(surfel.normal, surfel.sky) + self.compact.at(i).now;
            let on_ground =
                |(texel, weight): &(u32, f32)| light.ground_now(*texel, ground) * *weight;
            let from_ground: Vec3 = surfel.ground.iter().map(on_ground).sum();
            let on_other = |(k, weight): &(u32, f32)| self.previous[*k as usize] * *weight;
            let from_others: Vec3 = surfel.others.iter().map(on_other).sum();
            let on_phantom = |(tile, weight): &(u32, f32)| tiles.radiance(*tile, light) * *weight;
            let from_phantoms: Vec3 = surfel.phantoms.iter().map(on_phantom).sum();
            let direct = sky + self.lamplight.at(i);
            let arriving = (direct + from_ground + from_others + from_phantoms) / PI;
            let surface = &surfel.surface;
            self.radiance[i] = surface.emissive + surface.diffuse * arriving;
            self.total[i] = self.radiance[i] + surface.f0 * arriving;
        }
    }

    /// Radiance of a reflecting point towards the origin of its ray, which sees what it mirrors in lobes of at least
    /// these widths, radians: everything, and lamps.
    pub fn radiance(
        &self,
        point: &ReflectingPoint,
        (width, lamps): (f32, f32),
        ground: &GroundShares,
        tiles: &TileShares,
        light: &DistantLight<'_>,
    ) -> Vec3 {
        let i = point.surfel as usize;
        let Some((direction, source)) = point.mirrored else {
            return self.total[i];
        };
        let surface = &self.all[i].surface;
        let reflected = match source {
            Source::Sky => {
                let Surfel {
                    position, normal, ..
                } = self.all[i];
                let n = normal * normal.dot(direction).signum();
                light.sky_radiance((position, n), direction, surface.gloss.max(width), lamps)
            }
            Source::Ground(texel) => light.ground_now(texel, ground),
            Source::Surfel(other) => self.total[other as usize],
            Source::Phantom(tile) => tiles.radiance(tile, light),
        };
        self.radiance[i] + surface.f0 * reflected
    }
}

/// Distributes surfels over the triangles by area; also returns the area of each, m².
fn distribute(parts: &[Part], count: usize) -> (Vec<Surfel>, f32) {
    let corners: Vec<(usize, [Vec3; 3])> = parts
        .iter()
        .enumerate()
        .flat_map(|(i, part)| world_triangles(part).map(move |t| (i, t)))
        .collect();
    let area = |t: &[Vec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
    let total: f32 = corners.iter().map(|(_, t)| area(t)).sum();
    let step = total / count as f32;
    let surfaces: Vec<Surface> = parts
        .iter()
        .map(|p| Surface::from_material(&p.material))
        .collect();
    let (mut surfels, mut passed) = (Vec::with_capacity(count), 0.5 * step);
    for (part, triangle) in &corners {
        passed -= area(triangle);
        while passed < 0.0 && step > 0.0 {
            passed += step;
            surfels.push(surfel(triangle, surfels.len(), surfaces[*part]));
        }
    }
    (surfels, step)
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

fn places(surfels: &[Surfel]) -> Vec<(Vec3, Vec3)> {
    surfels.iter().map(|s| (s.position, s.normal)).collect()
}

/// Whether `hit` is on the front of the surface that a surfel stands for. Of a back, the surfel nearest to
/// it may be one of the opposite wall.
fn is_front(surfel: &Surfel, hit: &SurfacePoint, spacing: f32) -> bool {
    let is_near = surfel.position.distance(hit.point) < FAR_APART * spacing;
    is_near && surfel.normal.dot(hit.normal) > 0.0
}

/// What is visible from a surfel; see [`Surfel`].
#[derive(Clone, Default)]
struct Visible {
    sky: u128,
    ground: Vec<(u32, f32)>,
    others: Vec<(u32, f32)>,
    phantoms: Vec<(u32, f32)>,
}

/// Finds what surfels see.
struct Look<'a> {
    obstacles: &'a Obstacles,
    directions: &'a Directions,
    region: &'a Region,
    /// See [`Surfels::spacing`].
    spacing: f32,
}

impl Look<'_> {
    /// Whether a surfel is on a hidden surface: below the ground, as what an object stands on is, or inside
    /// another object, from where most rays hit the backs of surfaces. It must not stand for visible points
    /// nearby.
    fn is_inside(&self, surfel: &Surfel, all: &[Surfel], index: &SurfelIndex) -> bool {
        let origin = surfel.position + surfel.normal * self.region.offset();
        if self.obstacles.floor.is_some_and(|floor| origin.z < floor) {
            return true;
        }
        let in_front = |d: &&Vec3| d.dot(surfel.normal) > 0.0;
        let each = self.directions.all.iter().step_by(4).filter(in_front);
        let (mut backs, mut count) = (0, 0);
        for d in each {
            count += 1;
            if let FirstHit::Virtual(hit) = self.obstacles.first_hit(origin, *d) {
                let front = |i: u32| is_front(&all[i as usize], &hit, self.spacing);
                backs += i32::from(!index.nearest(&hit).is_some_and(front));
            }
        }
        2 * backs > count
    }

    fn find_visible(&self, surfel: &Surfel, index: &SurfelIndex) -> Visible {
        let origin = surfel.position + surfel.normal * self.region.offset();
        let mut visible = Visible::default();
        for (i, d) in self.directions.all.iter().enumerate() {
            let weight = d.dot(surfel.normal) * Directions::solid_angle();
            if weight <= 0.0 {
                continue;
            }
            match self.obstacles.first_hit(origin, *d) {
                FirstHit::Sky => visible.sky |= 1 << i,
                FirstHit::Ground(p) => {
                    visible.ground.push((ground_texel(self.region, p), weight));
                }
                FirstHit::Virtual(hit) => {
                    let other = index.nearest(&hit);
                    visible.others.extend(other.map(|s| (s, weight)));
                }
                FirstHit::Phantom(tile) => visible.phantoms.push((tile, weight)),
            }
        }
        visible
    }
}
