//! Completes lamps of which something real hides a part from the environment camera.
//!
//! Where the edge of a source that ends at unseen pixels lies on a circle, the rest of that circle is as bright as
//! what is seen of it.

use super::round::{Cone, Edge};
use super::sources::{LUMINANCE, SampleGrid, Source};
use glam::Vec3;
use std::f32::consts::PI;

/// Share of the greatest radiance from which a sample shows the lamp alone.
const CORE: f32 = 0.75;

/// Adds to a source what is hidden of it. `radiance` is that of the grid's samples.
pub(super) fn complete(source: &mut Source, grid: SampleGrid, radiance: &[Vec3]) {
    let Some(core) = core(source, grid) else {
        return;
    };
    let above = |i: usize| (radiance[i] - source.background).dot(LUMINANCE);
    let parts = source.parts.iter().map(|(i, _)| *i);
    let edge = Edge::of(grid, parts, 0.5 * core.dot(LUMINANCE), above);
    let cut = edge.filter(|edge| edge.is_cut);
    let Some(cone) = cut.and_then(|edge| Cone::through(&edge.points)) else {
        return;
    };
    let size = PI * cone.radius.powi(2);
    let flux = core * (cone.certainty * size / Cone::POINTS as f32);
    let reach = 0.75 * mean_size(source, grid).sqrt();
    let is_seen = |d: Vec3| {
        let near = |(i, _): &(u32, Vec3)| grid.directions[*i as usize].distance(d) < reach;
        source.parts.iter().any(near)
    };
    let hidden = cone.points().filter(|d| !is_seen(*d)).map(|d| (d, flux));
    source.hidden = hidden.collect();
    let mut centre = source.direction * source.flux.dot(LUMINANCE);
    for (direction, flux) in &source.hidden {
        source.flux += *flux;
        centre += *direction * flux.dot(LUMINANCE);
    }
    source.direction = centre.try_normalize().unwrap_or(source.direction);
    source.solid_angle += (size.max(source.solid_angle) - source.solid_angle) * cone.certainty;
}

/// Radiance of a source above its background, without the samples on its edge.
fn core(source: &Source, grid: SampleGrid) -> Option<Vec3> {
    let radiance = |(i, flux): &(u32, Vec3)| *flux / grid.solid_angles[*i as usize];
    let most = source.parts.iter().map(|p| radiance(p).dot(LUMINANCE));
    let least = CORE * most.fold(0.0, f32::max);
    let inside = source.parts.iter().map(radiance);
    let (sum, count) = inside
        .filter(|l| l.dot(LUMINANCE) > least)
        .fold((Vec3::ZERO, 0.0), |(sum, count), l| (sum + l, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

fn mean_size(source: &Source, grid: SampleGrid) -> f32 {
    let sizes = source
        .parts
        .iter()
        .map(|(i, _)| grid.solid_angles[*i as usize]);
    sizes.sum::<f32>() / source.parts.len().max(1) as f32
}
