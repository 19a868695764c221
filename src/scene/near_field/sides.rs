//! How much light virtual objects leave to the sides of phantoms: what is in a virtual
//! shadow throws less light at the things beside it than the picture, which does not know
//! of the shadow, says.

use super::receivers::GroundGrid;
use super::surfels::{Surfels, point_in, world_triangles};
use super::{Directions, Light, Met, Obstacles, Region, side_of};
use crate::Part;
use glam::Vec3;

/// Points on each side of a phantom.
const POINTS: usize = 8;
/// No side throws more than so many times its light of before: beyond it the picture and
/// the light disagree.
const MOST: f32 = 2.0;

/// Points on the phantoms' sides and what they see.
pub struct Sides {
    /// Six a phantom, in the order of the scene; empty where virtual objects do not reach.
    points: Vec<Vec<Point>>,
    /// Irradiance on each side over that without virtual objects.
    shares: Vec<Vec3>,
}

/// For each direction in front of the surface: its number, its cosine times the solid angle
/// it stands for, what is there without virtual objects and with them.
struct Point {
    views: Vec<(usize, f32, View, View)>,
}

#[derive(Clone, Copy, PartialEq)]
enum View {
    Sky,
    /// Ground texel, see [`GroundGrid::texel`].
    Ground(u32),
    Phantom(u32),
    Surfel(u32),
}

impl Sides {
    pub(super) fn new(
        phantoms: &[Part],
        surfels: &Surfels,
        obstacles: &Obstacles,
        directions: &Directions,
        region: &Region,
    ) -> Self {
        let points: Vec<Vec<Point>> = phantoms
            .iter()
            .flat_map(|part| spread(part, region))
            .map(|places| {
                let look =
                    |(p, n): &(Vec3, Vec3)| look(*p, *n, surfels, obstacles, directions, region);
                let points: Vec<Point> = places.iter().map(look).collect();
                let changed = |p: &Point| p.views.iter().any(|(_, _, before, now)| before != now);
                let reached = points.iter().any(changed);
                if reached { points } else { Vec::new() }
            })
            .collect();
        Self {
            shares: vec![Vec3::ONE; points.len()],
            points,
        }
    }

    /// Finds the shares under a new state of the light, with the bounces of before.
    pub(super) fn shade(
        &mut self,
        surfels: &Surfels,
        ground: &GroundGrid,
        directions: &Directions,
        light: &Light<'_>,
    ) {
        let old = &self.shares;
        let radiance = |view: View, now: bool| match view {
            View::Sky => Vec3::ZERO,
            View::Ground(texel) if now => light.floor * ground.share(texel),
            View::Ground(_) => light.floor,
            View::Phantom(side) if now => light.of_phantom(side) * share(old, side),
            View::Phantom(side) => light.of_phantom(side),
            View::Surfel(i) => surfels.spread(i),
        };
        let arriving = |(direction, weight, view, now): (usize, f32, View, bool)| match view {
            View::Sky => directions.light[direction] * (weight / Directions::solid_angle()),
            other => radiance(other, now) * weight,
        };
        let shares = self.points.iter().map(|points| {
            let views = || points.iter().flat_map(|p| &p.views);
            let before: Vec3 = views().map(|v| arriving((v.0, v.1, v.2, false))).sum();
            let now: Vec3 = views().map(|v| arriving((v.0, v.1, v.3, true))).sum();
            let known = before.min_element() > 1e-6;
            if known {
                (now / before).clamp(Vec3::ZERO, Vec3::splat(MOST))
            } else {
                Vec3::ONE
            }
        });
        self.shares = shares.collect();
    }

    /// Radiance that leaves a side, as virtual objects leave it.
    pub(super) fn radiance(&self, side: u32, light: &Light<'_>) -> Vec3 {
        light.of_phantom(side) * share(&self.shares, side)
    }
}

fn share(shares: &[Vec3], side: u32) -> Vec3 {
    shares.get(side as usize).copied().unwrap_or(Vec3::ONE)
}

/// Places and normals on a part's six sides, evenly by area, inside of the region.
fn spread(part: &Part, region: &Region) -> [Vec<(Vec3, Vec3)>; 6] {
    let mut triangles: [Vec<([Vec3; 3], Vec3)>; 6] = Default::default();
    for t in world_triangles(part) {
        let normal = (t[1] - t[0]).cross(t[2] - t[0]);
        triangles[side_of(normal) as usize].push((t, normal));
    }
    triangles.map(|side| {
        let total: f32 = side.iter().map(|(_, n)| n.length()).sum();
        let step = total / POINTS as f32;
        let (mut places, mut passed) = (Vec::with_capacity(POINTS), 0.5 * step);
        for (t, normal) in side {
            passed -= normal.length();
            while passed < 0.0 && step > 0.0 {
                passed += step;
                let p = point_in(&t, places.len());
                places.push((p, normal.normalize_or(Vec3::Z)));
            }
        }
        places.retain(|(p, _)| p.cmpge(region.low).all() && p.cmple(region.high).all());
        places
    })
}

fn look(
    point: Vec3,
    normal: Vec3,
    surfels: &Surfels,
    obstacles: &Obstacles,
    directions: &Directions,
    region: &Region,
) -> Point {
    let origin = point + normal * region.off();
    let in_front = directions.all.iter().enumerate();
    let in_front = in_front.filter(|(_, d)| d.dot(normal) > 0.0);
    let views = in_front.filter_map(|(i, d)| {
        let weight = d.dot(normal) * Directions::solid_angle();
        let view = |met: Met| match met {
            Met::Sky => Some(View::Sky),
            Met::Ground(p) => Some(View::Ground(GroundGrid::texel(region, p))),
            Met::Phantom(side) => Some(View::Phantom(side)),
            Met::Virtual(hit) => surfels.nearest(&hit).map(View::Surfel),
        };
        let now = view(obstacles.meet(origin, *d))?;
        let before = match now {
            View::Surfel(_) => view(obstacles.meet_real(origin, *d))?,
            other => other,
        };
        Some((i, weight, before, now))
    });
    Point {
        views: views.collect(),
    }
}
