//! Selects, among candidates, the planes that together see most of the surface.
//!
//! The value of a plane for a fragment rises with the cosine between their normals (from 0.8 to 1)
//! and is zero if the fragment is hidden. The value of a set of planes is the sum over the fragments
//! of their area times the best plane's value. This function is submodular: greedy selection
//! reaches at least 1 − 1/e of the optimum (Nemhauser et al. 1978).

use super::depth::visible_from;
use super::hull::hull_faces;
use super::rectangle::{Axes, plane_around};
use super::surface::Fragment;
use super::{Layer, ShadowingPlane};
use glam::DVec3;
use std::collections::HashSet;

/// Maximum number of directions of a cluster from its hull and from its surface.
const MAX_DIRECTIONS: [usize; 2] = [14, 8];
/// Directions with at least this cosine (20°) are merged.
const SAME: f64 = 0.94;
/// Minimum cosine between a fragment's normal and that of a plane that serves it.
pub(super) const MIN_COSINE: f64 = 0.2;
/// Maximum number of parallel planes behind one another for one cluster and direction.
const LAYERS: usize = 3;
/// Thickness of the layers in which hidden fragments are searched, as a share of a cluster's depth.
const LAYER: f64 = 0.06;
/// Minimum Z of a plane's normal: planes below a surface are left out.
const MIN_NORMAL_Z: f64 = -0.95;

/// A plane that can be selected.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// The plane.
    pub plane: ShadowingPlane,
    /// Fragments that it serves, and its value for each.
    pub serves: Vec<(u32, f32)>,
}

/// Returns candidates around the clusters of a layer that are `wanted`.
pub(super) fn candidates(
    fragments: &[Fragment],
    clusters: u32,
    wanted: impl Fn(u32) -> bool,
    layer: Layer,
    offset_m: f64,
) -> Vec<Candidate> {
    let mut out = Vec::new();
    for cluster in (0..clusters).filter(|c| wanted(*c)) {
        let own: Vec<&Fragment> = fragments.iter().filter(|f| f.cluster == cluster).collect();
        let (low, high) = super::surface::bounds(own.iter().flat_map(|f| f.corners));
        let extent = (high - low).max_element();
        for direction in directions(&own) {
            let facing: Vec<&Fragment> = own
                .iter()
                .filter(|f| f.normal.dot(direction) > MIN_COSINE)
                .copied()
                .collect();
            let mut seen = HashSet::new();
            let (mut stretch, mut front) = (facing.clone(), front(&own, direction));
            for inward in 0..LAYERS {
                let plane = plane_of(&stretch, direction, front, layer, offset_m);
                let Some(plane) = plane else { break };
                let serves = served_by(&plane, fragments);
                seen.extend(serves.iter().map(|s| s.0));
                let thick = plane.depth.max(0.5 * extent) * LAYER;
                // Another cluster may hide everything from the outermost plane; planes farther in are
                // tried nevertheless.
                if !serves.is_empty() {
                    out.push(Candidate { plane, serves });
                } else if inward > 0 {
                    break;
                }
                stretch = covered(&facing, &seen, direction, thick);
                front = self::front(&stretch, direction);
            }
        }
    }
    weigh(&mut out, fragments, clusters);
    out
}

/// Returns existing planes as candidates, with their values for a layer's clusters.
pub(super) fn serving(
    planes: impl Iterator<Item = ShadowingPlane>,
    fragments: &[Fragment],
    clusters: u32,
) -> Vec<Candidate> {
    let candidate = |plane: ShadowingPlane| Candidate {
        serves: served_by(&plane, fragments),
        plane,
    };
    let mut out: Vec<Candidate> = planes.map(candidate).collect();
    weigh(&mut out, fragments, clusters);
    out
}

/// Weights the values by area. Clusters count by the square root of their area, so that small ones
/// get planes too.
fn weigh(candidates: &mut [Candidate], fragments: &[Fragment], clusters: u32) {
    let mut areas = vec![0.0; clusters as usize];
    for f in fragments {
        if let Some(area) = areas.get_mut(f.cluster as usize) {
            *area += f.area;
        }
    }
    for (i, share) in candidates.iter_mut().flat_map(|c| &mut c.serves) {
        if let Some(f) = fragments.get(*i as usize) {
            let area: f64 = areas.get(f.cluster as usize).copied().unwrap_or(0.0);
            *share *= (f.area / area.max(f64::MIN_POSITIVE).sqrt()) as f32;
        }
    }
}

/// Normals of the hull's faces and of the surface, largest area first, similar ones merged.
fn directions(own: &[&Fragment]) -> Vec<DVec3> {
    let corners: Vec<DVec3> = own.iter().flat_map(|f| f.corners).collect();
    let faces = merged(hull_faces(&corners), MAX_DIRECTIONS[0]);
    let surface = own.iter().map(|f| (f.normal, f.area)).collect();
    let mut out = faces;
    for direction in merged(surface, MAX_DIRECTIONS[1]) {
        if out.iter().all(|d| d.dot(direction) < SAME) {
            out.push(direction);
        }
    }
    out.retain(|d| d.z > MIN_NORMAL_Z);
    out
}

/// The directions of the largest areas; directions similar to an earlier one are added to it.
fn merged(mut faces: Vec<(DVec3, f64)>, max: usize) -> Vec<DVec3> {
    faces.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut groups: Vec<(DVec3, DVec3, f64)> = Vec::new();
    for (normal, area) in faces {
        if let Some(group) = groups.iter_mut().find(|g| g.0.dot(normal) > SAME) {
            group.1 += normal * area;
            group.2 += area;
        } else if groups.len() < 4 * max {
            groups.push((normal, normal * area, area));
        }
    }
    groups.sort_by(|a, b| b.2.total_cmp(&a.2));
    groups.truncate(max);
    groups.iter().map(|g| g.1.normalize_or(g.0)).collect()
}

/// Maximum coordinate of the fragments along `direction`, metres.
fn front(fragments: &[&Fragment], direction: DVec3) -> f64 {
    let along = |f: &&Fragment| f.corners.map(|p| p.dot(direction));
    fragments
        .iter()
        .flat_map(along)
        .fold(f64::NEG_INFINITY, f64::max)
}

/// The largest layer of `facing` fragments that are not `seen` by planes farther out because they are
/// hidden (a floor beneath a roof): it gets its own plane inside the model.
fn covered<'a>(
    facing: &[&'a Fragment],
    seen: &HashSet<u32>,
    direction: DVec3,
    thick: f64,
) -> Vec<&'a Fragment> {
    let depth = |f: &Fragment| -f.centre.dot(direction);
    let mut unseen: Vec<&Fragment> = facing
        .iter()
        .filter(|f| f.area > 0.0 && !seen.contains(&f.number))
        .copied()
        .collect();
    unseen.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
    let (mut start, mut sum, mut best) = (0, 0.0, (0.0, 0..0));
    for (end, last) in unseen.iter().enumerate() {
        sum += last.area;
        while depth(last) - depth(unseen[start]) > thick {
            sum -= unseen[start].area;
            start += 1;
        }
        if sum > best.0 {
            best = (sum, start..end + 1);
        }
    }
    unseen[best.1].to_vec()
}

/// The plane in front of `facing`, at `front` metres along its normal.
fn plane_of(
    facing: &[&Fragment],
    direction: DVec3,
    front: f64,
    layer: Layer,
    offset_m: f64,
) -> Option<ShadowingPlane> {
    let points: Vec<DVec3> = facing.iter().flat_map(|f| f.corners).collect();
    let back = points
        .iter()
        .map(|p| p.dot(direction))
        .fold(f64::INFINITY, f64::min);
    if points.is_empty() || !(front - back).is_finite() {
        return None;
    }
    let (low, high) = super::surface::bounds(points.iter().copied());
    // The offset is limited by the size of the surface.
    let offset = offset_m.min((high - low).length() * 0.05).max(1e-6);
    let depth = (front - back) * 1.01 + 2.0 * offset;
    let axes = Axes::around(direction);
    Some(plane_around(axes, &points, front + offset, depth, layer))
}

fn served_by(plane: &ShadowingPlane, fragments: &[Fragment]) -> Vec<(u32, f32)> {
    let normal = plane.normal();
    let share = |i: &u32| {
        let f = fragments.get(*i as usize)?;
        let cosine = f.normal.dot(normal);
        let serves = cosine > MIN_COSINE && f.area > 0.0;
        serves.then_some((*i, (0.75 + 0.25 * cosine) as f32))
    };
    let seen = visible_from(plane, fragments);
    seen.iter().filter_map(share).collect()
}

/// Selects greedily at most `count` candidates in addition to those that are `kept`, until the gain
/// falls below `min_share` times that of the best candidate. Returns them in the order of
/// selection.
pub(super) fn choose(
    candidates: Vec<Candidate>,
    kept: &[Candidate],
    fragments: usize,
    count: usize,
    min_share: f32,
) -> Vec<Candidate> {
    let mut best = vec![0.0f32; fragments];
    let gain = |c: &Candidate, best: &[f32]| -> f32 {
        let more =
            |(i, s): &(u32, f32)| (s - best.get(*i as usize).copied().unwrap_or(0.0)).max(0.0);
        c.serves.iter().map(more).sum()
    };
    let everything = candidates.iter().chain(kept);
    let all = everything.fold(0.0f32, |max, c| max.max(gain(c, &best)));
    kept.iter().for_each(|c| serve(&mut best, c));
    let mut waiting: Vec<(f32, Candidate)> = candidates
        .into_iter()
        .map(|c| (gain(&c, &best), c))
        .collect();
    let mut out: Vec<Candidate> = Vec::new();
    while out.len() < count {
        // Gains only decrease, so that an old gain is an upper bound (lazy greedy).
        let Some(next) = top(&waiting) else { break };
        let fresh = gain(&waiting[next].1, &best);
        waiting[next].0 = fresh;
        if top(&waiting) != Some(next) {
            continue;
        }
        if fresh <= all * min_share {
            break;
        }
        let (_, taken) = waiting.remove(next);
        serve(&mut best, &taken);
        out.push(taken);
    }
    out
}

/// Updates each fragment's best value.
fn serve(best: &mut [f32], candidate: &Candidate) {
    for (i, share) in &candidate.serves {
        if let Some(slot) = best.get_mut(*i as usize) {
            *slot = slot.max(*share);
        }
    }
}

/// Index of the first largest gain.
fn top(waiting: &[(f32, Candidate)]) -> Option<usize> {
    let gains = waiting.iter().map(|w| w.0).enumerate();
    gains
        .fold(None, |best: Option<(usize, f32)>, (i, g)| match best {
            Some((_, max)) if max >= g => best,
            _ => Some((i, g)),
        })
        .map(|(i, _)| i)
}
