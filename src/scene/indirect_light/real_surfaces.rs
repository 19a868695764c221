//! Irradiance of indirect light on the surfaces of phantoms, by points on them as on virtual surfaces
//! ([`super::receivers`]).

use super::obstacles::{FirstHit, Obstacles};
use super::receivers::{CHUNK, count, distribute, rays_from};
use super::region::Region;
use super::result::IndirectLight;
use super::sampling::world_triangles;
use super::shares::{DistantLight, GroundShares, TileShares, ground_texel};
use super::surface_grid::{Splat, SurfaceGrid};
use super::surfels::{ReflectingPoint, Surfels};
use crate::mesh::Part;
use glam::Vec3;
use penumbra_interface::threads;
use std::f32::consts::PI;
use std::sync::Arc;

/// Number of points on all phantoms near the virtual objects.
const COUNT: usize = 3072;
/// The same where something moves, and rays are cast again every half second.
const COUNT_MOVING: usize = 768;
/// Cells of their grid along each axis.
const SIDE: u32 = 24;
/// Number of rays from each point.
const GATHERED: usize = 96;
/// The same where something moves.
const GATHERED_MOVING: usize = 48;

/// Least width of the lobe in which a point sees a mirror's surroundings, radians: about twice the distance of its
/// rays. A narrower one makes single points as bright as a window, which the eye sees as a spot on
/// the wall.
const MIRRORED: f32 = 0.4;

/// Points on real surfaces, and what they see.
pub(super) struct RealPoints {
    points: Vec<RealPoint>,
    grid: Arc<SurfaceGrid>,
    splats: Vec<Splat>,
}

/// What a point sees, each with the number of rays that meet it.
struct RealPoint {
    /// Points of virtual surfaces and what they hide.
    virtual_points: Vec<((ReflectingPoint, Behind), f32)>,
    /// Surfaces that virtual objects do not hide.
    visible: Vec<(Behind, f32)>,
    /// Share of the irradiance of one ray.
    weight: f32,
}

/// A real surface.
#[derive(Clone, Copy, PartialEq)]
enum Behind {
    Sky,
    /// Index of a ground texel, see [`ground_texel`].
    Ground(u32),
    /// Index of a tile of a phantom.
    Phantom(u32),
}

impl RealPoints {
    pub fn new(
        phantoms: &[Part],
        surfels: &Surfels,
        obstacles: &Obstacles,
        region: &Region,
        moves: bool,
    ) -> Self {
        let (wanted, rays) = if moves {
            (COUNT_MOVING, GATHERED_MOVING)
        } else {
            (COUNT, GATHERED)
        };
        let (places, area) = places(phantoms, region, wanted);
        let points = threads::map(&places, CHUNK, |i, place| {
            look(*place, (i, rays), surfels, obstacles, region)
        });
        let (grid, splats) = SurfaceGrid::around(&places, area, SIDE);
        Self {
            points,
            grid: Arc::new(grid),
            splats,
        }
    }

    /// Computes the irradiance under a new state of the light.
    pub fn gather(
        &self,
        surfels: &Surfels,
        ground: &GroundShares,
        tiles: &TileShares,
        light: &DistantLight<'_>,
        out: &mut IndirectLight,
    ) {
        let before = |behind: Behind| match behind {
            Behind::Sky => Vec3::ZERO,
            Behind::Ground(texel) => light.ground_radiance(texel),
            Behind::Phantom(tile) => light.phantom_radiance(tile),
        };
        let now = |behind: Behind| match behind {
            Behind::Sky => Vec3::ZERO,
            Behind::Ground(texel) => light.ground_now(texel, ground),
            Behind::Phantom(tile) => tiles.radiance(tile, light),
        };
        // Surfaces receive the mean light of the ground already.
        let besides_mean = |behind: Behind| match behind {
            Behind::Ground(_) => before(behind) - light.mean_ground,
            Behind::Sky | Behind::Phantom(_) => before(behind),
        };
        let change = |point: &RealPoint| {
            let gained = point.virtual_points.iter().map(|((point, behind), rays)| {
                let gained = surfels.radiance(point, (MIRRORED, MIRRORED), ground, tiles, light);
                (gained - before(*behind)) * *rays
            });
            let dimmed = point.visible.iter();
            let dimmed = dimmed.map(|(behind, rays)| (now(*behind) - before(*behind)) * *rays);
            gained.chain(dimmed).sum::<Vec3>() * point.weight
        };
        let real = |point: &RealPoint| {
            let hidden = point.virtual_points.iter();
            let hidden = hidden.map(|((_, behind), rays)| besides_mean(*behind) * *rays);
            let visible = point.visible.iter();
            let visible = visible.map(|(behind, rays)| besides_mean(*behind) * *rays);
            hidden.chain(visible).sum::<Vec3>() * point.weight
        };
        for part in [&mut out.change, &mut out.real] {
            part.surfaces.grid = Arc::clone(&self.grid);
        }
        let (splats, points) = (&self.splats, self.points.iter());
        (out.change.surfaces).set(splats, points.clone().map(change));
        out.real.surfaces.set(splats, points.map(real));
    }
}

/// Distributes `count` points (position, normal) over the surfaces of phantoms near the virtual objects
/// by area; returns them with the area of each, square metres. What lies flat on the ground has the ground's
/// grid.
fn places(phantoms: &[Part], region: &Region, count: usize) -> (Vec<(Vec3, Vec3)>, f32) {
    let [low, high] = region.beside_objects;
    let is_ground = |t: &[Vec3; 3]| {
        let n = (t[1] - t[0]).cross(t[2] - t[0]).normalize_or_zero();
        n.z > 0.99 && t[0].z < region.floor + region.offset()
    };
    let all = phantoms.iter().flat_map(world_triangles);
    let near = all.filter(|t| !is_ground(t)).flat_map(|t| {
        let polygon = clipped(t.to_vec(), low, high);
        (2..polygon.len()).map(move |k| [polygon[0], polygon[k - 1], polygon[k]])
    });
    distribute(&near.collect::<Vec<_>>(), count)
}

/// The part of a polygon within a box (Sutherland and Hodgman 1974).
fn clipped(mut polygon: Vec<Vec3>, low: Vec3, high: Vec3) -> Vec<Vec3> {
    for axis in 0..3 {
        let beyond_low = |p: Vec3| p[axis] - low[axis];
        let beyond_high = |p: Vec3| high[axis] - p[axis];
        polygon = half_of(&polygon, beyond_low);
        polygon = half_of(&polygon, beyond_high);
    }
    polygon
}

/// The part of a polygon where `height`, which is linear, is not negative.
fn half_of(polygon: &[Vec3], height: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    let mut half = Vec::with_capacity(polygon.len() + 1);
    let next = polygon.iter().cycle().skip(1);
    for (a, b) in polygon.iter().zip(next) {
        let (from, to) = (height(*a), height(*b));
        if from >= 0.0 {
            half.push(*a);
        }
        if (from >= 0.0) != (to >= 0.0) {
            half.push(a.lerp(*b, from / (from - to)));
        }
    }
    half
}

/// Finds what a point sees.
fn look(
    (position, normal): (Vec3, Vec3),
    (index, rays): (usize, usize),
    surfels: &Surfels,
    obstacles: &Obstacles,
    region: &Region,
) -> RealPoint {
    let origin = position + normal * region.offset();
    let mut point = RealPoint {
        virtual_points: Vec::new(),
        visible: Vec::new(),
        weight: region.window_beside_objects(position) * PI / rays as f32,
    };
    let behind = |hit: FirstHit| match hit {
        FirstHit::Ground(p) => Behind::Ground(ground_texel(region, p)),
        FirstHit::Phantom(tile) => Behind::Phantom(tile),
        FirstHit::Sky | FirstHit::Virtual(_) => Behind::Sky,
    };
    for d in rays_from(normal, index, rays) {
        match obstacles.first_hit(origin, d) {
            FirstHit::Virtual(hit) => {
                if let Some(met) = surfels.reflecting_point(&hit, d, obstacles, region) {
                    let hidden = behind(obstacles.first_real_hit(origin, d));
                    count(&mut point.virtual_points, (met, hidden));
                }
            }
            FirstHit::Sky => (),
            seen => count(&mut point.visible, behind(seen)),
        }
    }
    point
}
