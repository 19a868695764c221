//! Builds a map from observations: rejects outliers and computes standard deviations.

use super::bundle::Bundle;
use super::initial_poses::{initialise_poses, tag_corners};
use super::schur::TAG_UNKNOWNS;
use super::{MapTag, View};
use crate::summary::Findings;
use glam::DVec3;
use penumbra_camera::Lens;
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::best_rotation;
use penumbra_numerics::{median, root_mean_square};
use penumbra_rig_model::Grade;

/// An observation is an outlier if its error exceeds this multiple of the median error, and this,
/// pixels.
const OUTLIER: (f64, f64) = (5.0, 1.2);
/// Maximum share of rejected observations of a tag; a tag with more was moved.
const MAX_REJECTED_SHARE: f64 = 0.25;
/// Minimum number of observations of a tag.
const MIN_OBSERVATIONS: usize = 4;
/// Maximum deviation of a tag's size from the given size: share, standard deviations.
/// Only a deviation that exceeds both is reported.
const MAX_SIZE_DEVIATION: (f64, f64) = (0.008, 5.0);
/// Maximum deviation of calibrated tags from their calibrated position: metres plus standard
/// deviations.
const MAX_POSITION_DEVIATION: (f64, f64) = (0.003, 5.0);

/// The estimate of a tag.
#[derive(Clone, Debug)]
pub(super) struct TagEstimate {
    pub tag: MapTag,
    pub pose: RigidTransform,
    /// Standard deviations: rotation about the tag's axes (radians), position along them (metres).
    pub sigma: (DVec3, DVec3),
    /// Number of observations used.
    pub used_observations: usize,
    /// Number of observations.
    pub observations: usize,
    /// Root mean square reprojection error, pixels.
    pub rms: f64,
}

/// The estimate of a map.
pub(super) struct MapEstimate {
    pub tags: Vec<TagEstimate>,
    /// RMS reprojection error, pixels.
    pub rms: f64,
    /// Number of views used, and of all.
    pub views: (usize, usize),
    /// RMS reprojection error of each view, pixels.
    pub view_rms: Vec<f64>,
    pub findings: Findings,
}

/// Builds the map. At least one of `tags` must have an initial pose; calibrated poses are kept if
/// they are consistent.
pub(super) fn build_map(
    camera: &PinholeCamera,
    mut tags: Vec<MapTag>,
    mut views: Vec<View>,
) -> MapEstimate {
    let lens = Lens::from(camera);
    let mut findings = Vec::new();
    let all = views.len();
    let anchors: Vec<usize> = (0..tags.len()).filter(|i| tags[*i].is_fixed).collect();
    // Only one calibrated tag is fixed at first; the others may be inconsistent with it.
    for i in anchors.iter().skip(1) {
        (tags[*i].is_fixed, tags[*i].map_from_tag) = (false, None);
    }
    initialise_poses(camera, &mut tags, &mut views);
    let unlinked: Vec<String> = tags
        .iter()
        .filter(|t| t.map_from_tag.is_none())
        .map(MapTag::name)
        .collect();
    if !unlinked.is_empty() {
        findings.push((
            Grade::Usable,
            format!(
                "no clear picture together with another tag of the map: {}; show them in one picture with tags of the map",
                unlinked.join(", ")
            ),
        ));
    }
    views.retain(|v| v.camera_from_map.is_some());
    let mut bundle = Bundle {
        lens: &lens,
        tags,
        views,
        free_sizes: false,
    };
    bundle.adjust();
    // Before outliers are rejected: a tag of a wrong size is inconsistent in every view.
    findings.extend(check_sizes(&bundle));
    reject_outliers(&mut bundle, &mut findings);
    if anchors.len() > 1 {
        findings.extend(align_with_calibration(&mut bundle, &anchors));
    }
    map_estimate(&bundle, all, findings)
}

/// Rejects outlying observations and adjusts again; removes tags that were moved or observed too
/// seldom.
fn reject_outliers(bundle: &mut Bundle, findings: &mut Findings) {
    for _ in 0..3 {
        if !mark_outliers(bundle) {
            break;
        }
        bundle.adjust();
    }
    let moved: Vec<usize> = (0..bundle.tags.len())
        .filter(|t| {
            let (used, all) = count_observations(bundle, *t);
            !bundle.tags[*t].is_fixed
                && all >= MIN_OBSERVATIONS
                && (all - used) as f64 > MAX_REJECTED_SHARE * all as f64
        })
        .collect();
    for tag in &moved {
        let (used, all) = count_observations(bundle, *tag);
        findings.push((
            Grade::Usable,
            format!(
                "{}: {} of {all} observations are inconsistent with the others: it was moved, is bent or half hidden; it was left out",
                bundle.tags[*tag].name(),
                all - used
            ),
        ));
    }
    let few = (0..bundle.tags.len()).filter(|t| {
        let tag = &bundle.tags[*t];
        tag.map_from_tag.is_some()
            && !tag.is_fixed
            && count_observations(bundle, *t).0 < MIN_OBSERVATIONS
    });
    let few: Vec<usize> = few.filter(|t| !moved.contains(t)).collect();
    for tag in &few {
        findings.push((
            Grade::Usable,
            format!(
                "{}: seen together with other tags in fewer than {MIN_OBSERVATIONS} pictures; it was left out",
                bundle.tags[*tag].name()
            ),
        ));
    }
    let removed: Vec<usize> = moved.into_iter().chain(few).collect();
    if !removed.is_empty() {
        remove_tags(bundle, &removed);
        bundle.adjust();
        if mark_outliers(bundle) {
            bundle.adjust();
        }
    }
}

fn remove_tags(bundle: &mut Bundle, removed: &[usize]) {
    for tag in removed {
        bundle.tags[*tag].map_from_tag = None;
    }
    for view in &mut bundle.views {
        view.observations.retain(|o| !removed.contains(&o.tag));
        // Observations rejected because of a moved tag are assessed again.
        view.observations.iter_mut().for_each(|o| o.is_used = true);
    }
    bundle.views.retain(|v| !v.observations.is_empty());
}

/// Returns the number of a tag's used observations, and of all.
fn count_observations(bundle: &Bundle, tag: usize) -> (usize, usize) {
    let (mut used, mut all) = (0, 0);
    for observation in bundle.views.iter().flat_map(|v| &v.observations) {
        if observation.tag == tag {
            all += 1;
            used += usize::from(observation.is_used);
        }
    }
    (used, all)
}

/// Marks observations with large errors as outliers; returns whether there were any.
fn mark_outliers(bundle: &mut Bundle) -> bool {
    let mut squares: Vec<(usize, usize, f64)> = Vec::new();
    for (view, i, residual) in bundle.residuals() {
        match squares.last_mut() {
            Some((v, o, sum)) if (*v, *o) == (view, i) => *sum += residual.length_squared(),
            _ => squares.push((view, i, residual.length_squared())),
        }
    }
    let rms = |sum: f64| (0.25 * sum).sqrt();
    let typical = median(squares.iter().map(|s| rms(s.2))).unwrap_or(0.0);
    let limit = (OUTLIER.0 * typical).max(OUTLIER.1);
    let mut has_outliers = false;
    for (view, i, sum) in squares {
        if rms(sum) > limit {
            bundle.views[view].observations[i].is_used = false;
            has_outliers = true;
        }
    }
    // A camera without a consistent tag has no pose.
    for view in &mut bundle.views {
        if view.observations.iter().all(|o| !o.is_used) {
            view.camera_from_map = None;
        }
    }
    has_outliers
}

/// Returns a finding for each tag whose size, relative to the first tag's, differs from the given
/// one.
fn check_sizes(bundle: &Bundle) -> Findings {
    let mut free = bundle.clone();
    free.free_sizes = true;
    free.adjust();
    if mark_outliers(&mut free) {
        free.adjust();
    }
    let Some(sigma) = standard_deviations(&free) else {
        return Vec::new();
    };
    let mut out = Vec::new();
    for (i, (tag, sigma)) in free.tags.iter().zip(sigma).enumerate() {
        let Some(sigma) = sigma else { continue };
        let (used, all) = count_observations(&free, i);
        if ((all - used) as f64) > MAX_REJECTED_SHARE * all as f64 {
            continue;
        }
        let deviation = (tag.scale - 1.0).abs();
        if deviation > MAX_SIZE_DEVIATION.0 && deviation > MAX_SIZE_DEVIATION.1 * sigma[6] {
            out.push((
                Grade::Refused,
                format!(
                    "the pictures give {} a size of {:.1} ± {:.1} mm relative to the others, not {:.1} mm; measure its black border and give --size-of {}=METRES",
                    tag.name(),
                    1e3 * tag.size * tag.scale,
                    1e3 * tag.size * sigma[6],
                    1e3 * tag.size,
                    tag.id
                ),
            ));
        }
    }
    // If several deviate, one wrong size is the likely cause of most.
    if out.len() > 2 && 2 * out.len() > bundle.tags.len() {
        let text = "the first tag's size may be wrong: most others are inconsistent with it";
        out.push((Grade::Refused, text.to_owned()));
    }
    out
}

/// Returns the standard deviations of each tag's unknowns, `None` for tags that are fixed or have no
/// pose; `None` if the unknowns are undetermined. Residuals over 2 px count as 2 px.
fn standard_deviations(bundle: &Bundle) -> Option<Vec<Option<[f64; TAG_UNKNOWNS]>>> {
    let covariance = bundle.reduced(0.0)?.covariance()?;
    let mut squares = 0.0;
    let mut count = 0.0;
    for (.., residual) in bundle.residuals() {
        squares += residual.length_squared().min(4.0);
        count += 2.0;
    }
    let cameras = bundle.views.iter().filter(|v| v.camera_from_map.is_some());
    let free = bundle
        .tags
        .iter()
        .filter(|t| !t.is_fixed && t.map_from_tag.is_some());
    let unknowns = 6 * (cameras.count() + free.count());
    let variance = squares / (count - unknowns as f64).max(1.0);
    let mut next = 0;
    let of_tag = |tag: &MapTag| {
        if tag.is_fixed || tag.map_from_tag.is_none() {
            return None;
        }
        let base = next * TAG_UNKNOWNS;
        next += 1;
        let at = |i: usize| (variance * covariance[(base + i, base + i)].max(0.0)).sqrt();
        Some(std::array::from_fn(at))
    };
    Some(bundle.tags.iter().map(of_tag).collect())
}

/// Aligns the map with the calibrated tags, and fixes those at their calibrated poses if all of
/// them are consistent.
fn align_with_calibration(bundle: &mut Bundle, anchors: &[usize]) -> Findings {
    let sigma = standard_deviations(bundle).unwrap_or_default();
    let pairs: Vec<(usize, RigidTransform, RigidTransform)> = anchors
        .iter()
        .filter_map(|i| {
            let tag = &bundle.tags[*i];
            Some((*i, tag.map_from_tag?, tag.calibrated_pose?))
        })
        .collect();
    let corners = |pose: RigidTransform, i: usize| {
        tag_corners(bundle.tags[i].size).map(|c| pose.transform_point(c))
    };
    let points: Vec<(DVec3, DVec3)> = pairs
        .iter()
        .flat_map(|(i, found, calibrated)| {
            corners(*calibrated, *i)
                .into_iter()
                .zip(corners(*found, *i))
        })
        .collect();
    let Some(calibrated_from_map) = best_transform(&points) else {
        return Vec::new();
    };
    let mut findings = Vec::new();
    for (i, found, calibrated) in &pairs {
        let deviation = corners(calibrated_from_map * *found, *i)
            .into_iter()
            .zip(corners(*calibrated, *i))
            .map(|(a, b)| a.distance(b))
            .fold(0.0, f64::max);
        let sigma = sigma
            .get(*i)
            .copied()
            .flatten()
            .map_or(0.0, |s| s[3].max(s[4]).max(s[5]));
        if deviation > MAX_POSITION_DEVIATION.0 + MAX_POSITION_DEVIATION.1 * sigma {
            findings.push((
                Grade::Refused,
                format!(
                    "{} is {:.1} mm from its calibrated position; remove it from rig.json, or start a new map with --origin",
                    bundle.tags[*i].name(),
                    1e3 * deviation
                ),
            ));
        }
    }
    for tag in &mut bundle.tags {
        tag.map_from_tag = tag.map_from_tag.map(|p| calibrated_from_map * p);
    }
    for view in &mut bundle.views {
        view.camera_from_map = view
            .camera_from_map
            .map(|c| c * calibrated_from_map.inverse());
    }
    if findings.is_empty() {
        for (i, _, calibrated) in pairs {
            (bundle.tags[i].map_from_tag, bundle.tags[i].is_fixed) = (Some(calibrated), true);
        }
        bundle.adjust();
    }
    findings
}

/// Returns the rigid transform A that best satisfies a ≈ A b over point pairs (a, b), in the sense of
/// least squares (Horn 1987); `None` without pairs.
fn best_transform(points: &[(DVec3, DVec3)]) -> Option<RigidTransform> {
    let count = points.len().max(1) as f64;
    let centroid = |of: fn(&(DVec3, DVec3)) -> DVec3| points.iter().map(of).sum::<DVec3>() / count;
    let (a_centre, b_centre) = (centroid(|p| p.0), centroid(|p| p.1));
    let centred = points.iter().map(|p| (p.1 - b_centre, p.0 - a_centre, 1.0));
    let rotation = best_rotation(centred)?.rotation;
    Some(RigidTransform::new(
        rotation,
        a_centre - rotation * b_centre,
    ))
}

/// Returns the result; `all` is the number of views before any was rejected.
fn map_estimate(bundle: &Bundle, all: usize, mut findings: Findings) -> MapEstimate {
    let residuals: Vec<_> = bundle.residuals().collect();
    let rms = root_mean_square(residuals.iter().map(|r| r.2.length()));
    let sigma = standard_deviations(bundle);
    if sigma.is_none() {
        let text = "the pictures do not determine the tags' poses; take more, from more sides";
        findings.push((Grade::Refused, text.to_owned()));
    }
    let sigma = sigma.unwrap_or_else(|| vec![None; bundle.tags.len()]);
    let tag_estimate = |(i, tag): (usize, &MapTag)| {
        let of_tag = residuals
            .iter()
            .filter(|(v, o, _)| bundle.views[*v].observations[*o].tag == i);
        let s = sigma[i].unwrap_or_default();
        let (used_observations, observations) = count_observations(bundle, i);
        Some(TagEstimate {
            pose: tag.map_from_tag?,
            sigma: (DVec3::new(s[0], s[1], s[2]), DVec3::new(s[3], s[4], s[5])),
            used_observations,
            observations,
            rms: root_mean_square(of_tag.map(|r| r.2.length())),
            tag: tag.clone(),
        })
    };
    let of_view = |v: usize| {
        let own = residuals.iter().filter(move |r| r.0 == v);
        root_mean_square(own.map(|r| r.2.length()))
    };
    MapEstimate {
        tags: bundle
            .tags
            .iter()
            .enumerate()
            .filter_map(tag_estimate)
            .collect(),
        rms,
        views: (
            bundle
                .views
                .iter()
                .filter(|v| v.camera_from_map.is_some())
                .count(),
            all,
        ),
        view_rms: (0..bundle.views.len()).map(of_view).collect(),
        findings,
    }
}

/// Returns the figures, one line each.
pub(super) fn lines(estimate: &MapEstimate) -> Vec<String> {
    let mut lines = vec![format!(
        "{} tags from {} of {} views; reprojection error {:.3} px RMS",
        estimate.tags.len(),
        estimate.views.0,
        estimate.views.1,
        estimate.rms
    )];
    lines.extend(estimate.tags.iter().map(|t| {
        let p = t.pose.translation * 1e3;
        let uncertainty = if t.tag.is_fixed {
            "held fixed".to_owned()
        } else {
            format!(
                "± {:.2} mm, {:.3} degrees",
                1e3 * t.sigma.1.max_element(),
                t.sigma.0.max_element().to_degrees()
            )
        };
        format!(
            "{}: {:.2}, {:.2}, {:.2} mm, {uncertainty}; {} of {} observations used",
            t.tag.name(),
            p.x,
            p.y,
            p.z,
            t.used_observations,
            t.observations
        )
    }));
    lines
}
