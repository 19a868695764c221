//! Initial poses of tags and cameras, from the relative poses of tags seen together.

use super::{MapTag, View};
use glam::DVec3;
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::{Match, candidate_poses, refine};
use penumbra_interface::RigidTransform;
use std::collections::BTreeMap;

/// Maximum number of views of a pair of tags that are compared.
const MAX_VIEWS: usize = 40;
/// Maximum difference of consistent relative poses: rotation, radians; translation, as a share of
/// the tags' distance or size, whichever is larger.
const MAX_DIFFERENCE: (f64, f64) = (0.14, 0.15);
/// Minimum number of views with a consistent relative pose of two tags.
const MIN_SUPPORT: usize = 2;

/// Relative pose of two tags.
struct Link {
    a_from_b: RigidTransform,
    /// Number of views that are consistent with it.
    support: usize,
}

/// Returns the tag's corners in its own frame.
pub(super) fn tag_corners(size: f64) -> [DVec3; 4] {
    let h = 0.5 * size;
    [(-h, -h), (h, -h), (h, h), (-h, h)].map(|(x, y)| DVec3::new(x, y, 0.0))
}

/// Computes a pose for every tag that is linked to a tag with a pose, and every view's camera
/// pose.
pub(super) fn initialise_poses(camera: &PinholeCamera, tags: &mut [MapTag], views: &mut [View]) {
    let links = links(camera, tags, views);
    // Maximum spanning tree (Prim 1957): the next link is the one with the most support that
    // connects a tag with a pose to a tag without.
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
        view.camera_from_map = camera_pose(camera, tags, view);
    }
}

/// Returns the links between tags, by indices a < b.
fn links(
    camera: &PinholeCamera,
    tags: &[MapTag],
    views: &[View],
) -> BTreeMap<(usize, usize), Link> {
    let mut candidates: BTreeMap<(usize, usize), Vec<Vec<RigidTransform>>> = BTreeMap::new();
    for view in views {
        let poses: Vec<(usize, Vec<RigidTransform>)> = view
            .observations
            .iter()
            .map(|o| (o.tag, candidate_poses(camera, &o.corners, tags[o.tag].size)))
            .collect();
        for (a, of_a) in &poses {
            for (b, of_b) in poses.iter().filter(|(b, _)| b > a) {
                let each = |a: &RigidTransform| {
                    let a = a.inverse();
                    of_b.iter().map(move |b| a * *b).collect::<Vec<_>>()
                };
                let all = of_a.iter().flat_map(each).collect();
                candidates.entry((*a, *b)).or_default().push(all);
            }
        }
    }
    let link = |((a, b), candidates): ((usize, usize), Vec<Vec<RigidTransform>>)| {
        let size = tags[a].size.max(tags[b].size);
        Some(((a, b), best_supported(&candidates, size)?))
    };
    candidates.into_iter().filter_map(link).collect()
}

/// Returns the relative pose that is consistent with the most views; `candidates` holds the
/// possible relative poses of each view.
fn best_supported(candidates: &[Vec<RigidTransform>], size: f64) -> Option<Link> {
    let every = candidates.len().div_ceil(MAX_VIEWS);
    let views: Vec<_> = candidates.iter().step_by(every).collect();
    let are_consistent = |one: &RigidTransform, other: &RigidTransform| {
        let scale = one.translation.length().max(size);
        one.rotation.angle_between(other.rotation) < MAX_DIFFERENCE.0
            && one.translation.distance(other.translation) < MAX_DIFFERENCE.1 * scale
    };
    let support = |one: &RigidTransform| {
        views
            .iter()
            .filter(|view| view.iter().any(|other| are_consistent(one, other)))
            .count()
    };
    let best = views
        .iter()
        .flat_map(|v| v.iter())
        .map(|one| Link {
            a_from_b: *one,
            support: support(one),
        })
        .max_by_key(|l| l.support)?;
    (best.support >= MIN_SUPPORT).then_some(best)
}

/// Returns the camera pose of a view, from the tags that have a pose.
fn camera_pose(camera: &PinholeCamera, tags: &[MapTag], view: &View) -> Option<RigidTransform> {
    let posed = || {
        view.observations
            .iter()
            .filter_map(|o| Some((o, tags[o.tag].map_from_tag?)))
    };
    let matches: Vec<Match> = posed()
        .flat_map(|(o, map_from_tag)| {
            let points = tag_corners(tags[o.tag].size).map(|c| map_from_tag.transform_point(c));
            points.into_iter().zip(o.corners)
        })
        .map(|(point, pixel)| Match { point, pixel })
        .collect();
    posed()
        .flat_map(|(o, map_from_tag)| {
            let poses = candidate_poses(camera, &o.corners, tags[o.tag].size);
            poses.into_iter().map(move |c| c * map_from_tag.inverse())
        })
        .filter_map(|start| refine(camera, start, &matches))
        .min_by(|a, b| a.rms.total_cmp(&b.rms))
        .map(|found| found.camera_from_frame)
}
