//! Irradiance of indirect light on the virtual surfaces that stand still.
//!
//! In the directions of other surfaces, the other light of a virtual surface, the unshadowed dome
//! minus the lights behind obstacles, has nothing (above the horizon) or the mean radiance L_b from
//! below. With the radiance L of the surface that is visible in direction ω from a point with normal n,
//! virtual, phantom or ground in the shadow of virtual objects, the missing irradiance is (Kajiya 1986; S:
//! directions in which surfaces are visible)
//!
//! ```text
//! ΔE = ∫_S (L(ω) − L_b [ω below]) n·ω dω ≈ π/N Σ_k …
//! ```
//!
//! for N directions ω_k with a density of n·ω/π. Rays start at the surface, so it does not see itself and
//! a convex object sees no virtual surface; L is the surfels' radiosity, which has all bounces.

use super::obstacles::{FirstHit, Obstacles};
use super::region::Region;
use super::sampling::{cosine_direction, point_in, world_triangles};
use super::shares::{DistantLight, GroundShares, TileShares, ground_texel};
use super::surface_grid::{GRID_SIDE, Splat, SurfaceGrid, SurfaceIrradiance};
use super::surfels::{ReflectingPoint, Surfels};
use crate::mesh::Part;
use glam::{Mat3, Vec3};
use penumbra_interface::threads;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Number of points on all parts together.
const COUNT: usize = 12288;
/// Number of rays from each point.
const GATHERED: usize = 64;
/// Least width of the lobe in which a point sees a mirror's surroundings, radians; a narrower one makes single points
/// as bright as the lamp that one of their rays finds in a golden ball.
const MIRRORED: f32 = 0.2;
/// Points that a thread looks from at a time.
pub(super) const CHUNK: usize = 64;

/// Points on virtual surfaces that gather indirect light.
pub(super) struct Receivers {
    points: Vec<Receiver>,
    grid: Arc<SurfaceGrid>,
    splats: Vec<Splat>,
}

/// What a point sees.
struct Receiver {
    /// Points of virtual surfaces, and the number of rays that meet each.
    virtual_points: Vec<(ReflectingPoint, f32)>,
    /// Tiles of phantoms, and the number of rays that meet each.
    phantoms: Vec<(u32, f32)>,
    /// Ground texels, and the number of rays that meet each.
    ground: Vec<(u32, f32)>,
    /// Number of rays below the horizon of a scene with a ground.
    below: f32,
}

impl Receivers {
    pub fn new<'a>(
        parts: impl Iterator<Item = &'a Part>,
        surfels: &Surfels,
        obstacles: &Obstacles,
        region: &Region,
    ) -> Self {
        let triangles: Vec<[Vec3; 3]> = parts.flat_map(world_triangles).collect();
        let (places, area) = distribute(&triangles, COUNT);
        let seen = threads::map(&places, CHUNK, |i, place| {
            look(*place, i, surfels, obstacles, region)
        });
        let outside = places.into_iter().zip(seen);
        let (places, points): (Vec<_>, Vec<_>) = outside
            .filter_map(|(place, seen)| Some((place, seen?)))
            .unzip();
        let (grid, splats) = SurfaceGrid::around(&places, area, GRID_SIDE);
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
        out: &mut SurfaceIrradiance,
    ) {
        let irradiance = self.points.iter().map(|point| {
            let points = point.virtual_points.iter();
            let from_virtual = points.map(|(p, rays)| {
                surfels.radiance(p, (MIRRORED, MIRRORED), ground, tiles, light) * *rays
            });
            let real = point.phantoms.iter();
            let from_real = real.map(|(tile, rays)| tiles.radiance(*tile, light) * *rays);
            let on_ground = point.ground.iter();
            let from_ground =
                on_ground.map(|(texel, rays)| light.ground_now(*texel, ground) * *rays);
            let arriving = from_virtual
                .chain(from_real)
                .chain(from_ground)
                .sum::<Vec3>();
            (arriving - light.below * point.below) * (PI / GATHERED as f32)
        });
        out.grid = Arc::clone(&self.grid);
        out.set(&self.splats, irradiance);
    }
}

/// Distributes `count` points (position, normal) over triangles by area; returns them with the area of
/// each, square metres.
pub(super) fn distribute(triangles: &[[Vec3; 3]], count: usize) -> (Vec<(Vec3, Vec3)>, f32) {
    let doubled = |t: &[Vec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]);
    let total: f32 = triangles.iter().map(|t| 0.5 * doubled(t).length()).sum();
    let step = total / count as f32;
    let (mut places, mut passed) = (Vec::with_capacity(count), 0.5 * step);
    for t in triangles {
        passed -= 0.5 * doubled(t).length();
        while passed < 0.0 && step > 0.0 {
            passed += step;
            places.push((point_in(t, places.len()), doubled(t).normalize_or(Vec3::Z)));
        }
    }
    (places, step)
}

/// Finds what a point sees; `None` if it is inside another object.
fn look(
    (position, normal): (Vec3, Vec3),
    index: usize,
    surfels: &Surfels,
    obstacles: &Obstacles,
    region: &Region,
) -> Option<Receiver> {
    let origin = position + normal * region.offset();
    let mut seen = Receiver {
        virtual_points: Vec::new(),
        phantoms: Vec::new(),
        ground: Vec::new(),
        below: 0.0,
    };
    let mut inside = 0;
    for d in rays_from(normal, index, GATHERED) {
        let is_below = obstacles.floor.is_some() && d.z < 0.0;
        seen.below += f32::from(u8::from(is_below));
        match obstacles.first_hit(origin, d) {
            FirstHit::Sky => (),
            FirstHit::Ground(p) => count(&mut seen.ground, ground_texel(region, p)),
            FirstHit::Phantom(tile) => count(&mut seen.phantoms, tile),
            FirstHit::Virtual(hit) => match surfels.reflecting_point(&hit, d, obstacles, region) {
                Some(point) if surfels.is_front(&point, &hit) => {
                    count(&mut seen.virtual_points, point);
                }
                _ => {
                    inside += 1;
                    seen.below -= f32::from(u8::from(is_below));
                }
            },
        }
    }
    (2 * inside < GATHERED).then_some(seen)
}

/// Directions of `count` rays from the point number `index`, with a density proportional to the cosine.
pub(super) fn rays_from(normal: Vec3, index: usize, count: usize) -> impl Iterator<Item = Vec3> {
    let azimuth = TAU * (index as f64 * 0.618_033_988_749_895).fract() as f32;
    let (tangent, other) = normal.any_orthonormal_pair();
    let world_from_local = Mat3::from_cols(tangent, other, normal);
    (0..count).map(move |k| world_from_local * cosine_direction(k, count, azimuth))
}

/// Counts one more ray that meets `what`.
pub(super) fn count<T: PartialEq>(met: &mut Vec<(T, f32)>, what: T) {
    match met.iter_mut().find(|(other, _)| *other == what) {
        Some((_, rays)) => *rays += 1.0,
        None => met.push((what, 1.0)),
    }
}
