//! Irradiance on the tiles of phantoms in the presence of virtual objects: a real surface in a
//! virtual shadow reflects less light than the camera's picture, which lacks the shadow, shows.

use super::compact_sources::{Arriving, CompactSources};
use super::directions::{Directions, side_of};
use super::lamplight::Lamplight;
use super::obstacles::{FirstHit, Obstacles, SurfacePoint};
use super::region::Region;
use super::sampling::{point_in, world_triangles};
use super::shares::{DistantLight, GroundShares, TileShares, ground_texel};
use super::surfels::Surfels;
use super::tiles::TILES;
use crate::lamps::PlacedLamp;
use crate::mesh::Part;
use glam::Vec3;
use penumbra_interface::threads;

/// Number of points on each tile.
const POINTS: usize = 3;
/// The same where something moves, and they are found again every half second.
const POINTS_MOVING: usize = 1;
/// Number of points of a side from which those of its tiles are chosen.
const CANDIDATES: usize = 32 * TILES as usize;
/// Tiles that a thread looks from at a time.
const CHUNK: usize = 16;
/// Maximum ratio of a tile's irradiance with virtual objects to that without, virtual lights aside;
/// a larger one shows that picture and light are inconsistent.
const MAX_SHARE: f32 = 2.0;

/// Points on the phantoms' tiles and what is visible from them.
pub(super) struct Sides {
    /// By tile; `None` without a surface near the virtual objects, empty where these have no effect.
    points: Vec<Option<Vec<Point>>>,
    /// At all points, tile by tile.
    lamplight: Lamplight,
    compact: CompactSources,
    /// By side: whether it is a mirror.
    mirrors: Vec<bool>,
    pub shares: TileShares,
}

/// A point, by directions in front of the surface: index of the direction, cosine times solid
/// angle, and what is visible without and with virtual objects.
struct Point {
    views: Vec<(usize, f32, View, View)>,
}

#[derive(Clone, Copy, PartialEq)]
enum View {
    Sky,
    /// Index of a ground texel, see [`ground_texel`].
    Ground(u32),
    /// Index of a tile, see [`super::tiles`].
    Phantom(u32),
    Surfel(u32),
}

impl Sides {
    /// `lit`: whether there are virtual lights, which have an effect on every tile. `moves`: whether anything
    /// virtual moves.
    pub(super) fn new(
        phantoms: &[Part],
        (lit, moves): (bool, bool),
        surfels: &Surfels,
        obstacles: &Obstacles,
        directions: &Directions,
        region: &Region,
    ) -> Self {
        let count = if moves { POINTS_MOVING } else { POINTS };
        let places: Vec<Vec<(Vec3, Vec3)>> = (0..)
            .zip(phantoms)
            .flat_map(|(i, part)| distribute((i, part), count, obstacles, region))
            .collect();
        let seen = threads::map(&places, CHUNK, |_, places| {
            let find = |(p, n): &(Vec3, Vec3)| {
                find_visible(*p, *n, surfels, obstacles, directions, region)
            };
            let points: Vec<Point> = places.iter().map(find).collect();
            let changed = |p: &Point| p.views.iter().any(|(_, _, before, now)| before != now);
            let is_affected = lit || points.iter().any(changed);
            (!places.is_empty()).then(|| if is_affected { points } else { Vec::new() })
        });
        let is_affected =
            |points: &Option<Vec<Point>>| points.as_ref().is_some_and(|p| !p.is_empty());
        let affected = places
            .iter()
            .zip(&seen)
            .filter(|(_, points)| is_affected(points));
        let affected: Vec<(Vec3, Vec3)> =
            affected.flat_map(|(places, _)| places).copied().collect();
        let mirrors = phantoms.iter().flat_map(|part| [part.mirror; 6]);
        Self {
            mirrors: mirrors.collect(),
            shares: TileShares(vec![Vec3::ONE; seen.len()]),
            compact: CompactSources::new(affected.iter().copied(), region.offset()),
            lamplight: Lamplight::new(affected.into_iter(), region.offset()),
            points: seen,
        }
    }

    /// Finds what `lamps` reach, before [`Self::update`].
    pub fn light_up(&mut self, lamps: &[PlacedLamp], obstacles: &Obstacles) {
        self.lamplight.update(lamps, obstacles);
    }

    /// Computes the shares under a new state of the light, with the last update's bounces.
    pub fn update(
        &mut self,
        surfels: &Surfels,
        ground: &GroundShares,
        directions: &Directions,
        light: &DistantLight<'_>,
        obstacles: &Obstacles,
    ) {
        self.compact.update(&directions.compact, obstacles);
        let previous = &self.shares;
        let radiance = |view: View, now: bool| match view {
            View::Sky => Vec3::ZERO,
            View::Ground(texel) if now => light.ground_now(texel, ground),
            View::Ground(texel) => light.ground_radiance(texel),
            View::Phantom(tile) if now => previous.radiance(tile, light),
            View::Phantom(tile) => light.phantom_radiance(tile),
            View::Surfel(i) => surfels.total_radiance(i),
        };
        let irradiance = |(direction, weight, view, now): (usize, f32, View, bool)| match view {
            View::Sky => directions.cells[direction] * (weight / Directions::solid_angle()),
            other => radiance(other, now) * weight,
        };
        let mut first = 0;
        let mut irradiance_of = |points: &Vec<Point>| {
            let all = first..first + points.len();
            first = all.end;
            let lamps: Vec3 = all.clone().map(|i| self.lamplight.at(i)).sum();
            let compact = |of: fn(Arriving) -> Vec3| -> Vec3 {
                all.clone().map(|i| of(self.compact.at(i))).sum()
            };
            let views = || points.iter().flat_map(|p| &p.views);
            let before: Vec3 = views().map(|v| irradiance((v.0, v.1, v.2, false))).sum();
            let now: Vec3 = views().map(|v| irradiance((v.0, v.1, v.3, true))).sum();
            let each = 1.0 / points.len().max(1) as f32;
            Irradiance {
                before: (before + compact(|arriving| arriving.before)) * each,
                now: (now + compact(|arriving| arriving.now)) * each,
                lamps: lamps * each,
            }
        };
        let found: Vec<Option<Irradiance>> = (self.points.iter())
            .map(|points| points.as_ref().map(&mut irradiance_of))
            .collect();
        let sides = found.chunks(TILES as usize).zip(&self.mirrors);
        let shares = sides.flat_map(|(tiles, mirrors)| shares_of(tiles, *mirrors));
        self.shares = TileShares(shares.collect());
    }
}

/// Mean irradiance of a tile.
#[derive(Clone, Copy)]
struct Irradiance {
    /// Without virtual objects and virtual lights.
    before: Vec3,
    /// With virtual objects.
    now: Vec3,
    /// Of virtual lights.
    lamps: Vec3,
}

/// The shares of a side's tiles. What a tile loses or gains counts by the mean light of its side, whose radiance is
/// known: on a curved side, tiles that hardly have light would throw as much as the others. Mirrors throw what comes
/// from elsewhere; all tiles have their side's mean.
fn shares_of(tiles: &[Option<Irradiance>], is_mirror: bool) -> impl Iterator<Item = Vec3> {
    let lit = tiles
        .iter()
        .flatten()
        .filter(|tile| tile.before != Vec3::ZERO);
    let (sum, count) = lit.fold((Vec3::ZERO, 0.0), |(sum, count), tile| {
        (sum + tile.before, count + 1.0)
    });
    let mean = sum / f32::max(count, 1.0);
    let is_lit = mean.min_element() > 1e-6;
    let share = move |tile: &Irradiance| {
        if !is_lit {
            return Vec3::ONE;
        }
        let change = Vec3::ONE + (tile.now - tile.before) / mean;
        change.clamp(Vec3::ZERO, Vec3::splat(MAX_SHARE)) + tile.lamps / mean
    };
    let shares = || tiles.iter().flatten().map(share);
    let average = shares().sum::<Vec3>() / shares().count().max(1) as f32;
    let average = if shares().next().is_some() {
        average
    } else {
        Vec3::ONE
    };
    let share = move |tile: &Irradiance| if is_mirror { average } else { share(tile) };
    tiles
        .iter()
        .map(move |tile| tile.as_ref().map_or(average, share))
}

/// Distributes points (position, normal) over a phantom's surface by area, inside the region; returns up to
/// `count` of them for each tile.
fn distribute(
    (phantom, part): (u32, &Part),
    count: usize,
    obstacles: &Obstacles,
    region: &Region,
) -> Vec<Vec<(Vec3, Vec3)>> {
    let mut triangles: [Vec<([Vec3; 3], Vec3)>; 6] = Default::default();
    for t in world_triangles(part) {
        let normal = (t[1] - t[0]).cross(t[2] - t[0]);
        triangles[side_of(normal) as usize].push((t, normal));
    }
    let mut tiles = vec![Vec::new(); 6 * TILES as usize];
    for side in triangles {
        let total: f32 = side.iter().map(|(_, n)| n.length()).sum();
        let step = total / CANDIDATES as f32;
        let (mut found, mut passed) = (0, 0.5 * step);
        for (t, normal) in side {
            passed -= normal.length();
            while passed < 0.0 && step > 0.0 {
                passed += step;
                let point = point_in(&t, found);
                found += 1;
                let normal = normal.normalize_or(Vec3::Z);
                let is_near = point.cmpge(region.low).all() && point.cmple(region.high).all();
                let tile = obstacles
                    .tiles
                    .tile(phantom, SurfacePoint { point, normal });
                let tile = &mut tiles[(tile - 6 * TILES * phantom) as usize];
                if is_near && tile.len() < count {
                    tile.push((point, normal));
                }
            }
        }
    }
    tiles
}

fn find_visible(
    point: Vec3,
    normal: Vec3,
    surfels: &Surfels,
    obstacles: &Obstacles,
    directions: &Directions,
    region: &Region,
) -> Point {
    let origin = point + normal * region.offset();
    let in_front = directions.all.iter().enumerate();
    let in_front = in_front.filter(|(_, d)| d.dot(normal) > 0.0);
    let views = in_front.filter_map(|(i, d)| {
        let weight = d.dot(normal) * Directions::solid_angle();
        let view = |hit: FirstHit| match hit {
            FirstHit::Sky => Some(View::Sky),
            FirstHit::Ground(p) => Some(View::Ground(ground_texel(region, p))),
            FirstHit::Phantom(tile) => Some(View::Phantom(tile)),
            FirstHit::Virtual(hit) => surfels.nearest(&hit).map(View::Surfel),
        };
        let now = view(obstacles.first_hit(origin, *d))?;
        let before = match now {
            View::Surfel(_) => view(obstacles.first_real_hit(origin, *d))?,
            other => other,
        };
        Some((i, weight, before, now))
    });
    Point {
        views: views.collect(),
    }
}
