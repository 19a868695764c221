//! How a model is divided: first into objects, which are groups of parts that interlock (a
//! building's materials are parts, too); then each that is not convex by decomposition.

use super::hull::{Clusters, hull_faces};
use super::surface::{Fragment, bounds};
use crate::mesh::Scene;
use glam::DVec3;

/// Parts whose boxes share this much of the smaller one are one object.
const INTERLOCKED: f64 = 0.25;
/// Convex is what lies within this share of its extent of a face of its hull,
const ON_HULL: f64 = 0.03;
/// that faces the same way up to this cosine,
const FACING: f64 = 0.8;
/// but for this share of its area.
const OFF_HULL: f64 = 0.05;

/// Gives each fragment its cluster; says how many there are, at most `most` of them.
pub(super) fn divide(fragments: &mut [Fragment], scene: &Scene, most: u32) -> u32 {
    let most = most.max(1);
    let objects = objects(fragments, scene.virtual_parts.len());
    let count = objects.iter().max().map_or(1, |o| o + 1);
    let object = |f: &Fragment| objects.get(f.part as usize).copied().unwrap_or(0);
    if count > most {
        // More objects than clusters: neighbours come together.
        return decompose(fragments, |_| true, 0, most);
    }
    let areas = areas(fragments, count, object);
    let whole: f64 = areas.iter().sum();
    let mut first = 0;
    let mut spare = most - count;
    for (i, area) in areas.iter().enumerate() {
        let extra = (f64::from(most - count) * area / whole.max(f64::MIN_POSITIVE)).round() as u32;
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

/// Divides those fragments that are `within` into at most `most` clusters, numbered from
/// `first`; says into how many.
fn decompose(
    fragments: &mut [Fragment],
    within: impl Fn(&Fragment) -> bool,
    first: u32,
    most: u32,
) -> u32 {
    let own: Vec<[DVec3; 3]> = fragments
        .iter()
        .filter(|f| within(f))
        .map(|f| f.corners)
        .collect();
    let clusters = (most > 1 && !is_convex(&own))
        .then(|| Clusters::divide(&own, most))
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
    let whole: f64 = triangles.iter().map(area).sum();
    triangles.iter().filter(is_off).map(area).sum::<f64>() <= whole * OFF_HULL
}

/// The number of each part's object: parts whose bounding boxes interlock have the same.
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
            if group[a] != group[b] && interlock(boxes[a], boxes[b]) {
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

fn interlock(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> bool {
    // Flat parts have no volume; a little thickness gives them one.
    let volume = |(low, high): (DVec3, DVec3)| {
        let size = (high - low).max(DVec3::ZERO);
        (size + size.max_element() * 1e-3).element_product()
    };
    let (low, high) = (a.0.max(b.0), a.1.min(b.1));
    high.cmpge(low).all() && volume((low, high)) > INTERLOCKED * volume(a).min(volume(b))
}
