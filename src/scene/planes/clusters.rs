//! Divides a model into clusters: first into objects, groups of parts that overlap (each material of a
//! building is a part); then objects that are not convex by convex decomposition.

use super::hull::{Clusters, hull_faces};
use super::surface::{Fragment, bounds};
use crate::scene::Scene;
use glam::DVec3;

/// Minimum overlap of two parts' boxes, as a share of the smaller one, that makes them one object.
const MIN_OVERLAP: f64 = 0.25;
/// A convex object lies within this share of its extent of a face of its hull …
const ON_HULL: f64 = 0.03;
/// … whose normal has at least this cosine with its own …
const FACING: f64 = 0.8;
/// … except for at most this share of its area.
const MAX_OFF_HULL: f64 = 0.05;

/// Assigns each fragment to one of at most `max_clusters` clusters; returns their number.
pub(super) fn divide(fragments: &mut [Fragment], scene: &Scene, max_clusters: u32) -> u32 {
    let max = max_clusters.max(1);
    let objects = objects(fragments, scene.virtual_parts.len());
    let count = objects.iter().max().map_or(1, |o| o + 1);
    let object = |f: &Fragment| objects.get(f.part as usize).copied().unwrap_or(0);
    if count > max {
        // More objects than clusters: neighbours are merged.
        return decompose(fragments, |_| true, 0, max);
    }
    let areas = areas(fragments, count, object);
    let total: f64 = areas.iter().sum();
    let mut first = 0;
    let mut spare = max - count;
    for (i, area) in areas.iter().enumerate() {
        let extra = (f64::from(max - count) * area / total.max(f64::MIN_POSITIVE)).round() as u32;
        let extra = extra.min(spare);
        let made = decompose(fragments, |f| object(f) == i as u32, first, 1 + extra);
        spare -= (made - 1).min(spare);
        first += made;
    }
    first
}

fn areas(fragments: &[Fragment], count: u32, object: impl Fn(&Fragment) -> u32) -> Vec<f64> {
    let mut areas = vec![0.0; count as usize];
    for f in fragments {
        if let Some(area) = areas.get_mut(object(f) as usize) {
            *area += f.area;
        }
    }
    areas
}

/// Divides the fragments that are `within` into at most `max` clusters, numbered from `first`;
/// returns their number.
fn decompose(
    fragments: &mut [Fragment],
    within: impl Fn(&Fragment) -> bool,
    first: u32,
    max: u32,
) -> u32 {
    let own: Vec<[DVec3; 3]> = fragments
        .iter()
        .filter(|f| within(f))
        .map(|f| f.corners)
        .collect();
    let clusters = (max > 1 && !is_convex(&own))
        .then(|| Clusters::divide(&own, max))
        .flatten();
    for f in fragments.iter_mut().filter(|f| within(f)) {
        f.cluster = first + clusters.as_ref().map_or(0, |c| c.at(f.centre));
    }
    clusters.map_or(1, |c| c.count)
}

fn is_convex(triangles: &[[DVec3; 3]]) -> bool {
    let corners: Vec<DVec3> = triangles.iter().flatten().copied().collect();
    let (low, high) = bounds(corners.iter().copied());
    let near = (high - low).max_element() * ON_HULL;
    let supports: Vec<(DVec3, f64)> = hull_faces(&corners)
        .iter()
        .map(|(n, _)| {
            (
                *n,
                corners
                    .iter()
                    .map(|p| p.dot(*n))
                    .fold(f64::NEG_INFINITY, f64::max),
            )
        })
        .collect();
    let area = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a).length();
    let is_off = |[a, b, c]: &&[DVec3; 3]| {
        let middle = (*a + *b + *c) / 3.0;
        let normal = (*b - *a).cross(*c - *a).normalize_or_zero();
        let mut facing = supports.iter().filter(|(n, _)| n.dot(normal) > FACING);
        facing.all(|(n, support)| support - middle.dot(*n) > near)
    };
    let total: f64 = triangles.iter().map(area).sum();
    triangles.iter().filter(is_off).map(area).sum::<f64>() <= total * MAX_OFF_HULL
}

/// Index of each part's object: parts whose bounding boxes overlap have the same.
fn objects(fragments: &[Fragment], parts: usize) -> Vec<u32> {
    let mut boxes = vec![(DVec3::INFINITY, DVec3::NEG_INFINITY); parts];
    for f in fragments {
        if let Some((low, high)) = boxes.get_mut(f.part as usize) {
            for p in f.corners {
                (*low, *high) = (low.min(p), high.max(p));
            }
        }
    }
    let mut group: Vec<usize> = (0..parts).collect();
    for a in 0..parts {
        for b in 0..a {
            if group[a] != group[b] && do_overlap(boxes[a], boxes[b]) {
                let (from, to) = (group[a].max(group[b]), group[a].min(group[b]));
                group
                    .iter_mut()
                    .filter(|g| **g == from)
                    .for_each(|g| *g = to);
            }
        }
    }
    let mut names: Vec<usize> = group.clone();
    names.sort_unstable();
    names.dedup();
    group
        .iter()
        .map(|g| names.binary_search(g).unwrap_or(0) as u32)
        .collect()
}

fn do_overlap(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> bool {
    // Flat parts get a small thickness, so that they have a volume.
    let volume = |(low, high): (DVec3, DVec3)| {
        let size = (high - low).max(DVec3::ZERO);
        (size + size.max_element() * 1e-3).element_product()
    };
    let (low, high) = (a.0.max(b.0), a.1.min(b.1));
    high.cmpge(low).all() && volume((low, high)) > MIN_OVERLAP * volume(a).min(volume(b))
}
