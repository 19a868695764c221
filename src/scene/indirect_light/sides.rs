//! Irradiance on the sides of phantoms in the presence of virtual objects: a real surface in a
//! virtual shadow reflects less light than the camera's picture, which lacks the shadow, shows.

use super::compact_sources::{Arriving, CompactSources};
use super::directions::{Directions, side_of};
use super::lamplight::Lamplight;
use super::obstacles::{FirstHit, Obstacles};
use super::region::Region;
use super::sampling::{point_in, world_triangles};
use super::shares::{DistantLight, GroundShares, SideShares, ground_texel};
use super::surfels::Surfels;
use crate::lamps::PlacedLamp;
use crate::mesh::Part;
use glam::Vec3;

/// Number of points on each side of a phantom.
const POINTS: usize = 8;
/// Maximum ratio of a side's irradiance with virtual objects to that without, virtual lights aside;
/// a larger one shows that picture and light are inconsistent.
const MAX_SHARE: f32 = 2.0;

/// Points on the phantoms' sides and what is visible from them.
pub(super) struct Sides {
    /// By side (6 × phantom + side, in the order of the scene); empty where no virtual object has
    /// an effect.
    points: Vec<Vec<Point>>,
    /// At all points, side by side.
    lamplight: Lamplight,
    compact: CompactSources,
    pub shares: SideShares,
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
    Phantom(u32),
    Surfel(u32),
}

impl Sides {
    /// `lit`: whether there are virtual lights, which have an effect on every side.
    pub(super) fn new(
        phantoms: &[Part],
        lit: bool,
        surfels: &Surfels,
        obstacles: &Obstacles,
        directions: &Directions,
        region: &Region,
    ) -> Self {
        let mut places = Vec::new();
        let points: Vec<Vec<Point>> = phantoms
            .iter()
            .flat_map(|part| distribute(part, region))
            .map(|positions| {
                let find = |(p, n): &(Vec3, Vec3)| {
                    find_visible(*p, *n, surfels, obstacles, directions, region)
                };
                let points: Vec<Point> = positions.iter().map(find).collect();
                let changed = |p: &Point| p.views.iter().any(|(_, _, before, now)| before != now);
                let is_affected = lit || points.iter().any(changed);
                if !is_affected {
                    return Vec::new();
                }
                places.extend(positions);
                points
            })
            .collect();
        Self {
            shares: SideShares(vec![Vec3::ONE; points.len()]),
            compact: CompactSources::new(places.iter().copied(), region.offset()),
            lamplight: Lamplight::new(places.into_iter(), region.offset()),
            points,
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
            View::Phantom(side) if now => previous.radiance(side, light),
            View::Phantom(side) => light.phantom_radiance(side),
            View::Surfel(i) => surfels.total_radiance(i),
        };
        let irradiance = |(direction, weight, view, now): (usize, f32, View, bool)| match view {
            View::Sky => directions.cells[direction] * (weight / Directions::solid_angle()),
            other => radiance(other, now) * weight,
        };
        let mut first = 0;
        let shares = self.points.iter().map(|points| {
            let all = first..first + points.len();
            first = all.end;
            let lamps: Vec3 = all.clone().map(|i| self.lamplight.at(i)).sum();
            let compact = |of: fn(Arriving) -> Vec3| -> Vec3 {
                all.clone().map(|i| of(self.compact.at(i))).sum()
            };
            let views = || points.iter().flat_map(|p| &p.views);
            let before: Vec3 = views().map(|v| irradiance((v.0, v.1, v.2, false))).sum();
            let before = before + compact(|arriving| arriving.before);
            let now: Vec3 = views().map(|v| irradiance((v.0, v.1, v.3, true))).sum();
            let now = now + compact(|arriving| arriving.now);
            if before.min_element() > 1e-6 {
                let share = (now / before).clamp(Vec3::ZERO, Vec3::splat(MAX_SHARE));
                share + lamps / before
            } else {
                Vec3::ONE
            }
        });
        self.shares = SideShares(shares.collect());
    }
}

/// Distributes points (position, normal) over a part's six sides by area, inside the region.
fn distribute(part: &Part, region: &Region) -> [Vec<(Vec3, Vec3)>; 6] {
    let mut triangles: [Vec<([Vec3; 3], Vec3)>; 6] = Default::default();
    for t in world_triangles(part) {
        let normal = (t[1] - t[0]).cross(t[2] - t[0]);
        triangles[side_of(normal) as usize].push((t, normal));
    }
    triangles.map(|side| {
        let total: f32 = side.iter().map(|(_, n)| n.length()).sum();
        let step = total / POINTS as f32;
        let (mut points, mut passed) = (Vec::with_capacity(POINTS), 0.5 * step);
        for (t, normal) in side {
            passed -= normal.length();
            while passed < 0.0 && step > 0.0 {
                passed += step;
                let p = point_in(&t, points.len());
                points.push((p, normal.normalize_or(Vec3::Z)));
            }
        }
        points.retain(|(p, _)| p.cmpge(region.low).all() && p.cmple(region.high).all());
        points
    })
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
            FirstHit::Phantom(side) => Some(View::Phantom(side)),
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
