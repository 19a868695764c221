//! Initial poses of tags and cameras: tags are linked by pairs that were seen together.

use super::{Seen, View};
use glam::DVec3;
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::{Match, candidate_poses, refine};
use penumbra_interface::RigidTransform;
use std::collections::BTreeMap;

/// Maximum number of views of a pair that are compared.
const MOST_VIEWS: usize = 40;
/// Two relative poses are the same when they differ by less: radians, and share of the tags'
/// distance or size.
const SAME: (f64, f64) = (0.14, 0.15);
/// Minimum number of views with a consistent relative pose of two tags.
const LEAST_SUPPORT: usize = 2;

/// Relative pose of two tags.
struct Link {
    a_from_b: RigidTransform,
    support: usize,
}

/// Returns the tag's corners in its own frame.
pub(super) fn square(size: f64) -> [DVec3; 4] {
    let h = 0.5 * size;
    [(-h, -h), (h, -h), (h, h), (-h, h)].map(|(x, y)| DVec3::new(x, y, 0.0))
}

/// Computes a pose for every tag that is linked to a tag with a pose, and every view's camera
/// pose.
pub(super) fn start(camera: &PinholeCamera, tags: &mut [Seen], views: &mut [View]) {
    let links = links(camera, tags, views);
    // The link with the most support from a tag with a pose to one without (Prim).
    loop {
        let next = links
            .iter()
            .filter(|((a, b), _)| {
                tags[*a].map_from_tag.is_some() != tags[*b].map_from_tag.is_some()
            })
            .max_by_key(|(_, link)| link.support);
        let Some(((a, b), link)) = next else { break };
        match (tags[*a].map_from_tag, tags[*b].map_from_tag) {
            (Some(a), None) => tags[*b].map_from_tag = Some(a * link.a_from_b),
            (None, Some(b)) => tags[*a].map_from_tag = Some(b * link.a_from_b.inverse()),
            _ => break,
        }
    }
    for view in views {
        view.camera_from_map = place(camera, tags, view);
    }
}

/// Returns the links between tags, by indices a < b.
fn links(camera: &PinholeCamera, tags: &[Seen], views: &[View]) -> BTreeMap<(usize, usize), Link> {
    let mut said: BTreeMap<(usize, usize), Vec<Vec<RigidTransform>>> = BTreeMap::new();
    for view in views {
        let poses: Vec<(usize, Vec<RigidTransform>)> = view
            .sights
            .iter()
            .map(|s| (s.tag, candidate_poses(camera, &s.corners, tags[s.tag].size)))
            .collect();
        for (a, of_a) in &poses {
            for (b, of_b) in poses.iter().filter(|(b, _)| b > a) {
                let each = |a: &RigidTransform| {
                    let a = a.inverse();
                    of_b.iter().map(move |b| a * *b).collect::<Vec<_>>()
                };
                let all = of_a.iter().flat_map(each).collect();
                said.entry((*a, *b)).or_default().push(all);
            }
        }
    }
    let link = |((a, b), said): ((usize, usize), Vec<Vec<RigidTransform>>)| {
        let size = tags[a].size.max(tags[b].size);
        Some(((a, b), agreed(&said, size)?))
    };
    said.into_iter().filter_map(link).collect()
}

/// Returns the relative pose that is consistent with the most views.
fn agreed(said: &[Vec<RigidTransform>], size: f64) -> Option<Link> {
    let every = said.len().div_ceil(MOST_VIEWS);
    let said: Vec<_> = said.iter().step_by(every).collect();
    let agrees = |one: &RigidTransform, other: &RigidTransform| {
        let far = one.translation.length().max(size);
        one.rotation.angle_between(other.rotation) < SAME.0
            && one.translation.distance(other.translation) < SAME.1 * far
    };
    let support = |one: &RigidTransform| {
        said.iter()
            .filter(|view| view.iter().any(|other| agrees(one, other)))
            .count()
    };
    let best = said
        .iter()
        .flat_map(|v| v.iter())
        .map(|one| Link {
            a_from_b: *one,
            support: support(one),
        })
        .max_by_key(|l| l.support)?;
    (best.support >= LEAST_SUPPORT).then_some(best)
}

/// Returns the camera pose of a view, from the tags that have a pose.
fn place(camera: &PinholeCamera, tags: &[Seen], view: &View) -> Option<RigidTransform> {
    let placed = || {
        view.sights
            .iter()
            .filter_map(|s| Some((s, tags[s.tag].map_from_tag?)))
    };
    let matches: Vec<Match> = placed()
        .flat_map(|(s, map_from_tag)| {
            let points = square(tags[s.tag].size).map(|c| map_from_tag.transform_point(c));
            points.into_iter().zip(s.corners)
        })
        .map(|(point, pixel)| Match { point, pixel })
        .collect();
    placed()
        .flat_map(|(s, map_from_tag)| {
            let poses = candidate_poses(camera, &s.corners, tags[s.tag].size);
            poses.into_iter().map(move |c| c * map_from_tag.inverse())
        })
        .filter_map(|start| refine(camera, start, &matches))
        .min_by(|a, b| a.rms.total_cmp(&b.rms))
        .map(|found| found.camera_from_frame)
}
