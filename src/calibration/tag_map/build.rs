//! From sightings to a map: rejects outliers, and computes standard deviations from the rest.

use super::bundle::Bundle;
use super::schur::OF_TAG;
use super::start::{square, start};
use super::{Seen, View};
use crate::hand_eye::best_rotation;
use glam::DVec3;
use penumbra_camera::Lens;
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::{median, root_mean_square};
use penumbra_rig_model::Grade;

/// A sighting is left out when it is so many times the usual distance off, and at least so far,
/// pixels.
const OUTLIER: (f64, f64) = (5.0, 1.2);
/// Maximum share of rejected sightings; a tag with more was moved.
const MOVED: f64 = 0.25;
/// Minimum number of sightings of a tag.
const LEAST_SIGHTS: usize = 4;
/// A size deviates if it does so by this share and by this number of standard deviations.
const OTHER_SIZE: (f64, f64) = (0.008, 5.0);
/// Maximum deviation of known tags from their calibrated position: metres, standard deviations.
const KNOWN: (f64, f64) = (0.003, 5.0);

/// A tag of the map.
#[derive(Clone, Debug)]
pub(super) struct Mapped {
    pub seen: Seen,
    pub pose: RigidTransform,
    /// Standard deviations: rotation about the tag's axes (radians), position along them (metres).
    pub sigma: (DVec3, DVec3),
    /// Number of consistent sightings, and of all.
    pub sights: (usize, usize),
    /// Root mean square reprojection error, pixels.
    pub rms: f64,
}

/// The map.
pub(super) struct Built {
    pub tags: Vec<Mapped>,
    pub rms: f64,
    /// Number of views used, and of all.
    pub views: (usize, usize),
    /// RMS reprojection error of each view, pixels.
    pub view_rms: Vec<f64>,
    pub findings: Vec<(Grade, String)>,
}

/// Builds the map. At least one of `tags` must have an initial pose; known poses are kept where
/// they are consistent.
pub(super) fn build(camera: &PinholeCamera, mut tags: Vec<Seen>, mut views: Vec<View>) -> Built {
    let lens = Lens::from(camera);
    let mut findings = Vec::new();
    let all = views.len();
    let anchors: Vec<usize> = (0..tags.len()).filter(|i| tags[*i].fixed).collect();
    // Only one known tag is fixed at first; the others may be inconsistent with it.
    for i in anchors.iter().skip(1) {
        (tags[*i].fixed, tags[*i].map_from_tag) = (false, None);
    }
    start(camera, &mut tags, &mut views);
    let unlinked: Vec<String> = tags
        .iter()
        .filter(|t| t.map_from_tag.is_none())
        .map(Seen::name)
        .collect();
    if !unlinked.is_empty() {
        findings.push((
            Grade::Usable,
            format!(
                "never seen clearly together with the others: {}; show them in one picture with tags of the map",
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
    findings.extend(sizes(&bundle));
    settle(&mut bundle, &mut findings);
    if anchors.len() > 1 {
        findings.extend(keep_known(&mut bundle, &anchors));
    }
    describe(&bundle, all, findings)
}

/// Adjusts, rejects outliers, and adjusts again.
fn settle(bundle: &mut Bundle, findings: &mut Vec<(Grade, String)>) {
    for _ in 0..3 {
        if !leave_out(bundle) {
            break;
        }
        bundle.adjust();
    }
    let moved: Vec<usize> = (0..bundle.tags.len())
        .filter(|t| {
            let (used, all) = sights(bundle, *t);
            !bundle.tags[*t].fixed
                && all >= LEAST_SIGHTS
                && (all - used) as f64 > MOVED * all as f64
        })
        .collect();
    for tag in &moved {
        let (used, all) = sights(bundle, *tag);
        findings.push((
            Grade::Usable,
            format!(
                "{}: {} of {all} sightings contradict the others: it was moved, is bent or half hidden; it was left out",
                bundle.tags[*tag].name(),
                all - used
            ),
        ));
    }
    let few = (0..bundle.tags.len()).filter(|t| {
        let tag = &bundle.tags[*t];
        tag.map_from_tag.is_some() && !tag.fixed && sights(bundle, *t).0 < LEAST_SIGHTS
    });
    let few: Vec<usize> = few.filter(|t| !moved.contains(t)).collect();
    for tag in &few {
        findings.push((
            Grade::Usable,
            format!(
                "{}: seen too seldom together with others; it was left out",
                bundle.tags[*tag].name()
            ),
        ));
    }
    let out: Vec<usize> = moved.into_iter().chain(few).collect();
    if !out.is_empty() {
        drop_tags(bundle, &out);
        bundle.adjust();
        if leave_out(bundle) {
            bundle.adjust();
        }
    }
}

fn drop_tags(bundle: &mut Bundle, out: &[usize]) {
    for tag in out {
        bundle.tags[*tag].map_from_tag = None;
    }
    for view in &mut bundle.views {
        view.sights.retain(|s| !out.contains(&s.tag));
        // Sightings rejected because of a moved tag are assessed again.
        view.sights.iter_mut().for_each(|s| s.used = true);
    }
    bundle.views.retain(|v| !v.sights.is_empty());
}

/// Returns the number of a tag's consistent sightings, and of all.
fn sights(bundle: &Bundle, tag: usize) -> (usize, usize) {
    let (mut used, mut all) = (0, 0);
    for sight in bundle.views.iter().flat_map(|v| &v.sights) {
        if sight.tag == tag {
            all += 1;
            used += usize::from(sight.used);
        }
    }
    (used, all)
}

/// Marks sightings with large errors as outliers; returns whether there were any.
fn leave_out(bundle: &mut Bundle) -> bool {
    let mut off: Vec<(usize, usize, f64)> = Vec::new();
    for (view, sight, residual) in bundle.residuals() {
        match off.last_mut() {
            Some((v, s, sum)) if (*v, *s) == (view, sight) => *sum += residual.length_squared(),
            _ => off.push((view, sight, residual.length_squared())),
        }
    }
    let distance = |sum: f64| (0.25 * sum).sqrt();
    let usual = median(off.iter().map(|o| distance(o.2))).unwrap_or(0.0);
    let limit = (OUTLIER.0 * usual).max(OUTLIER.1);
    let mut any = false;
    for (view, sight, sum) in off {
        if distance(sum) > limit {
            bundle.views[view].sights[sight].used = false;
            any = true;
        }
    }
    // A camera without a consistent tag has no pose.
    for view in &mut bundle.views {
        if view.sights.iter().all(|s| !s.used) {
            view.camera_from_map = None;
        }
    }
    any
}

/// Reports tags whose size, relative to the first tag's, differs from the given one.
fn sizes(bundle: &Bundle) -> Vec<(Grade, String)> {
    let mut free = bundle.clone();
    free.free_sizes = true;
    free.adjust();
    if leave_out(&mut free) {
        free.adjust();
    }
    let Some(sigma) = sigmas(&free) else {
        return Vec::new();
    };
    let mut out = Vec::new();
    for (i, (tag, sigma)) in free.tags.iter().zip(sigma).enumerate() {
        let Some(sigma) = sigma else { continue };
        let (used, all) = sights(&free, i);
        if ((all - used) as f64) > MOVED * all as f64 {
            continue;
        }
        let off = (tag.scale - 1.0).abs();
        if off > OTHER_SIZE.0 && off > OTHER_SIZE.1 * sigma[6] {
            out.push((
                Grade::Refused,
                format!(
                    "{} is {:.1} ± {:.1} mm by its pictures beside the others, not {:.1} mm; measure the black border, and say it with --size-of {}=METRES",
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
        let other = "the first tag's own size may be the wrong one: most others contradict it";
        out.push((Grade::Refused, other.to_owned()));
    }
    out
}

/// σ of every tag's unknowns, each from residuals of usual size; `None` of those that are fixed
/// or have no place.
fn sigmas(bundle: &Bundle) -> Option<Vec<Option<[f64; OF_TAG]>>> {
    let covariance = bundle.reduced(0.0)?.covariance()?;
    let mut squares = 0.0;
    let mut count = 0.0;
    for (.., off) in bundle.residuals() {
        squares += off.length_squared().min(4.0);
        count += 2.0;
    }
    let cameras = bundle.views.iter().filter(|v| v.camera_from_map.is_some());
    let free = bundle
        .tags
        .iter()
        .filter(|t| !t.fixed && t.map_from_tag.is_some());
    let unknowns = 6 * (cameras.count() + free.count());
    let variance = squares / (count - unknowns as f64).max(1.0);
    let mut next = 0;
    let of_tag = |tag: &Seen| {
        if tag.fixed || tag.map_from_tag.is_none() {
            return None;
        }
        let base = next * OF_TAG;
        next += 1;
        let at = |i: usize| (variance * covariance[(base + i, base + i)].max(0.0)).sqrt();
        Some(std::array::from_fn(at))
    };
    Some(bundle.tags.iter().map(of_tag).collect())
}

/// Aligns the map with the tags that the calibration knows, and fixes those at their calibrated
/// poses if they are consistent.
fn keep_known(bundle: &mut Bundle, anchors: &[usize]) -> Vec<(Grade, String)> {
    let sigma = sigmas(bundle).unwrap_or_default();
    let pairs: Vec<(usize, RigidTransform, RigidTransform)> = anchors
        .iter()
        .filter_map(|i| {
            let tag = &bundle.tags[*i];
            Some((*i, tag.map_from_tag?, tag.known?))
        })
        .collect();
    let corners = |pose: RigidTransform, i: usize| {
        square(bundle.tags[i].size).map(|c| pose.transform_point(c))
    };
    let points: Vec<(DVec3, DVec3)> = pairs
        .iter()
        .flat_map(|(i, found, known)| corners(*known, *i).into_iter().zip(corners(*found, *i)))
        .collect();
    let count = points.len().max(1) as f64;
    let middle = |of: fn(&(DVec3, DVec3)) -> DVec3| points.iter().map(of).sum::<DVec3>() / count;
    let (there, here) = (middle(|p| p.0), middle(|p| p.1));
    let Some(turn) = best_rotation(points.iter().map(|p| (p.0 - there, p.1 - here))) else {
        return Vec::new();
    };
    let known_from_map = RigidTransform::new(turn, there - turn * here);
    let mut findings = Vec::new();
    for (i, found, known) in &pairs {
        let far = corners(known_from_map * *found, *i)
            .into_iter()
            .zip(corners(*known, *i))
            .map(|(a, b)| a.distance(b))
            .fold(0.0, f64::max);
        let sure = sigma
            .get(*i)
            .copied()
            .flatten()
            .map_or(0.0, |s| s[3].max(s[4]).max(s[5]));
        if far > KNOWN.0 + KNOWN.1 * sure {
            findings.push((
                Grade::Refused,
                format!(
                    "{} is {:.1} mm from where the calibration says; take it out of rig.json, or begin a new map with --origin",
                    bundle.tags[*i].name(),
                    1e3 * far
                ),
            ));
        }
    }
    for tag in &mut bundle.tags {
        tag.map_from_tag = tag.map_from_tag.map(|p| known_from_map * p);
    }
    for view in &mut bundle.views {
        view.camera_from_map = view.camera_from_map.map(|c| c * known_from_map.inverse());
    }
    if findings.is_empty() {
        for (i, _, known) in pairs {
            (bundle.tags[i].map_from_tag, bundle.tags[i].fixed) = (Some(known), true);
        }
        bundle.adjust();
    }
    findings
}

fn describe(bundle: &Bundle, all: usize, mut findings: Vec<(Grade, String)>) -> Built {
    let residuals: Vec<_> = bundle.residuals().collect();
    let rms = root_mean_square(residuals.iter().map(|r| r.2.length()));
    let sigma = sigmas(bundle);
    if sigma.is_none() {
        let text = "the pictures leave the tags' places open; take more, from more sides";
        findings.push((Grade::Refused, text.to_owned()));
    }
    let sigma = sigma.unwrap_or_else(|| vec![None; bundle.tags.len()]);
    let mapped = |(i, tag): (usize, &Seen)| {
        let of_tag = residuals
            .iter()
            .filter(|(v, s, _)| bundle.views[*v].sights[*s].tag == i);
        let s = sigma[i].unwrap_or_default();
        Some(Mapped {
            pose: tag.map_from_tag?,
            sigma: (DVec3::new(s[0], s[1], s[2]), DVec3::new(s[3], s[4], s[5])),
            sights: sights(bundle, i),
            rms: root_mean_square(of_tag.map(|r| r.2.length())),
            seen: tag.clone(),
        })
    };
    let of_view = |v: usize| {
        let own = residuals.iter().filter(move |r| r.0 == v);
        root_mean_square(own.map(|r| r.2.length()))
    };
    Built {
        tags: bundle.tags.iter().enumerate().filter_map(mapped).collect(),
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
pub(super) fn lines(built: &Built) -> Vec<String> {
    let mut lines = vec![format!(
        "{} tags by {} of {} views; reprojection {:.3} px RMS",
        built.tags.len(),
        built.views.0,
        built.views.1,
        built.rms
    )];
    lines.extend(built.tags.iter().map(|t| {
        let p = t.pose.translation * 1e3;
        let sure = if t.seen.fixed {
            "kept".to_owned()
        } else {
            format!(
                "± {:.2} mm, {:.3} degrees",
                1e3 * t.sigma.1.max_element(),
                t.sigma.0.max_element().to_degrees()
            )
        };
        format!(
            "{}: {:.2}, {:.2}, {:.2} mm, {sure}; {} of {} sightings",
            t.seen.name(),
            p.x,
            p.y,
            p.z,
            t.sights.0,
            t.sights.1
        )
    }));
    lines
}
