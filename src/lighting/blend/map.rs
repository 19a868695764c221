//! Radiance maps with their compact sources, and the light in the faces of a geodesic dome.

use super::{Shares, toward};
use crate::geodesic::{FaceLight, FaceSource};
use crate::light::{CompactSourceSpecular, CubeMap, MAX_COMPACT_SOURCES, MAX_LEVELS};
use crate::sources::LUMINANCE;
use std::sync::Arc;

/// Maximum movement of a compact source between two pictures, radians, in addition to its radii.
const MAX_MOVEMENT: f32 = 0.3;

/// Blends two maps of the same structure.
pub(super) fn blend_map(from: &CubeMap, to: &CubeMap, shares: Shares, out: &mut CubeMap) {
    (out.size, out.filtering) = (to.size, to.filtering);
    let families = [
        (&from.levels, &to.levels, &mut out.levels),
        (&from.phong, &to.phong, &mut out.phong),
    ];
    for (from, to, out) in families {
        out.resize_with(to.len(), Vec::new);
        for ((a, b), level) in from.iter().zip(to).zip(out) {
            blend_texels(a, b, shares.energy, level);
        }
    }
    blend_sources(
        &from.compact_sources,
        &to.compact_sources,
        shares,
        &mut out.compact_sources,
    );
}

fn blend_texels(from: &[[f32; 3]], to: &[[f32; 3]], weight: f32, out: &mut Vec<[f32; 3]>) {
    out.resize(to.len(), [0.0; 3]);
    let (from, to) = (from.as_flattened(), to.as_flattened());
    let pairs = from.iter().zip(to);
    for (value, (a, b)) in out.as_flattened_mut().iter_mut().zip(pairs) {
        *value = a + (b - a) * weight;
    }
}

/// Blends compact sources. Each source goes to the nearest one of the other end within reach;
/// sources without a partner fade where they are. What each level leaves out is blended linearly,
/// as the level is. Of more than [`MAX_COMPACT_SOURCES`], those without a partner in `from` are
/// left out.
fn blend_sources(
    from: &[CompactSourceSpecular],
    to: &[CompactSourceSpecular],
    shares: Shares,
    out: &mut Vec<CompactSourceSpecular>,
) {
    let weight = shares.energy;
    let mut is_taken = [false; MAX_COMPACT_SOURCES];
    out.clear();
    for a in from.iter().take(MAX_COMPACT_SOURCES) {
        let near = to
            .iter()
            .zip(&is_taken)
            .enumerate()
            .filter_map(|(k, (b, taken))| {
                let angle = a.direction.angle_between(b.direction);
                (!taken && angle <= MAX_MOVEMENT + a.radius + b.radius).then_some((angle, k))
            });
        let partner = near.min_by(|x, y| x.0.total_cmp(&y.0)).map(|(_, k)| k);
        out.push(match partner {
            Some(k) => {
                is_taken[k] = true;
                moved(a, &to[k], shares)
            }
            None => faded(a, 1.0 - weight),
        });
    }
    let alone = to.iter().zip(is_taken).filter(|(_, taken)| !taken);
    let free = MAX_COMPACT_SOURCES.saturating_sub(out.len());
    out.extend(alone.take(free).map(|(b, _)| faded(b, weight)));
}

fn faded(source: &CompactSourceSpecular, factor: f32) -> CompactSourceSpecular {
    CompactSourceSpecular {
        flux: source.flux * factor,
        ..*source
    }
}

fn moved(
    a: &CompactSourceSpecular,
    b: &CompactSourceSpecular,
    shares: Shares,
) -> CompactSourceSpecular {
    let (from, to) = (a.flux.dot(LUMINANCE), b.flux.dot(LUMINANCE));
    let place = shares.place(from, to);
    let share = Shares::moving(shares.energy).place(from, to);
    let mut weights = [0.0; MAX_LEVELS];
    for (out, (wa, wb)) in weights.iter_mut().zip(a.weights.iter().zip(b.weights)) {
        *out = wa + (wb - wa) * share;
    }
    CompactSourceSpecular {
        direction: toward(a.direction, b.direction, place),
        flux: a.flux.lerp(b.flux, shares.energy),
        radius: a.radius + (b.radius - a.radius) * place,
        weights,
        place: a.place.toward(&b.place, place),
    }
}

/// Blends the light in the faces of the same dome.
pub(super) fn blend_faces(
    from: Option<&Arc<FaceLight>>,
    to: Option<&Arc<FaceLight>>,
    shares: Shares,
    out: &mut Option<Arc<FaceLight>>,
) {
    let (Some(from), Some(to)) = (from, to) else {
        *out = None;
        return;
    };
    let out = Arc::make_mut(out.get_or_insert_with(|| Arc::clone(to)));
    out.frequency = to.frequency;
    out.membership.clone_from(&to.membership);
    let radiance = Arc::make_mut(&mut out.radiance);
    blend_texels(&from.radiance, &to.radiance, shares.energy, radiance);
    blend_face_sources(&from.sources, &to.sources, shares, &mut out.sources);
}

/// Blends sources of faces by their numbers: those of `from`, then new ones. Their directions
/// change once, at the middle: the basis images of a direction take several frames to bake.
fn blend_face_sources(
    from: &[FaceSource],
    to: &[FaceSource],
    shares: Shares,
    out: &mut Vec<FaceSource>,
) {
    let weight = shares.energy;
    let is_moved = shares.place.unwrap_or(weight) >= 0.5;
    let is_new = |b: &&FaceSource| from.iter().all(|a| a.id != b.id);
    out.resize_with(
        from.len() + to.iter().filter(is_new).count(),
        FaceSource::default,
    );
    let (kept, added) = out.split_at_mut(from.len());
    for (a, out) in from.iter().zip(kept) {
        let b = to.iter().find(|b| b.id == a.id);
        place(b.filter(|_| is_moved).unwrap_or(a), out);
        add_irradiance(a, 1.0 - weight, out);
        if let Some(b) = b {
            add_irradiance(b, weight, out);
        }
    }
    for (b, out) in to.iter().filter(is_new).zip(added) {
        place(b, out);
        add_irradiance(b, weight, out);
    }
}

fn place(source: &FaceSource, out: &mut FaceSource) {
    (out.id, out.direction) = (source.id, source.direction);
    out.angular_radius = source.angular_radius;
    out.spread.clone_from(&source.spread);
    out.irradiance_in_faces.clear();
}

/// Adds a source's irradiance in each face, times `factor`.
fn add_irradiance(source: &FaceSource, factor: f32, out: &mut FaceSource) {
    let sums = &mut out.irradiance_in_faces;
    for (face, irradiance) in &source.irradiance_in_faces {
        match sums.binary_search_by_key(face, |(f, _)| *f) {
            Ok(at) => sums[at].1 += *irradiance * factor,
            Err(at) => sums.insert(at, (*face, *irradiance * factor)),
        }
    }
}
