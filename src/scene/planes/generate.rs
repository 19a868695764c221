//! Generates shadowing planes from the model.

use super::choose::{Candidate, candidates, choose, serving};
use super::clusters::divide;
use super::ground::Ground;
use super::surface::{Fragment, Surface};
use super::{Layer, Receiver, ShadowingPlane};
use crate::mesh::Part;
use crate::raycast::RayCaster;
use crate::scene::Scene;
use glam::DVec3;
use thiserror::Error;

/// Number and position of planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneSettings {
    /// Maximum number of planes, including those of the ground and of phantoms.
    pub count: u32,
    /// Maximum number of clusters into which the model is divided.
    pub clusters: u32,
    /// Distance of planes from the surfaces that they cover, metres; less for small surfaces.
    pub offset_m: f64,
    /// Receiver of planes over parts. Planes on the ground are always their own receivers.
    pub receiver: Receiver,
}

impl Default for PlaneSettings {
    fn default() -> Self {
        Self {
            count: 38,
            clusters: 6,
            offset_m: 0.02,
            receiver: Receiver::Surface,
        }
    }
}

/// Why planes cannot be generated.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PlaneError {
    /// A vertex is not finite, or too far from the origin.
    #[error(
        "{part}: a vertex is more than 10000 km from the world's origin or not finite; check the model's units and its position"
    )]
    FarAway {
        /// Name of the part.
        part: String,
    },
    /// There are virtual parts, but no triangle with area.
    #[error(
        "the virtual objects have no surface (all triangles have zero area); check their scale"
    )]
    NoSurface,
    /// Too few planes for the ground and the model.
    #[error("{count} shadowing planes are too few; expected from 2 to 1000")]
    Count {
        /// Requested number.
        count: u32,
    },
}

/// Shortfall of an existing ground plane, as a share of the new plane's size, up to which it is kept.
const MAX_SHORTFALL: f64 = 0.04;
/// Maximum ratio of the area of an existing ground plane that is kept to that of the new plane.
const MAX_AREA_RATIO: f64 = 1.7;
/// Maximum of [`PlaneSettings::count`].
const MAX_PLANES: u32 = 1000;
/// Minimum gain of a plane as a share of the best plane's gain.
const MIN_GAIN: f32 = 0.002;
/// Maximum distance of a phantom that the model shadows, in extents of the model.
const MAX_DISTANCE: f64 = 6.25;
/// Weight of phantoms relative to the model: shadows need not fall on them.
const PHANTOM_WEIGHT: f32 = 0.3;

/// Generates planes for virtual objects, for the ground and for the phantoms around the model; those
/// of the real layer first. Returns none without virtual objects.
///
/// # Errors
///
/// The model has no surface or vertices that are not finite, or [`PlaneSettings::count`] is out of
/// range.
pub fn generate(
    scene: &Scene,
    settings: &PlaneSettings,
) -> Result<Vec<ShadowingPlane>, PlaneError> {
    generate_additional(scene, settings, &Kept::default())
}

/// Planes of an earlier bake that are still valid.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    /// Planes over parts and on the ground.
    pub planes: Vec<ShadowingPlane>,
    /// Indices of virtual and real parts that need new planes; `None` if all do.
    pub changed: Option<[Vec<u32>; 2]>,
}

impl Kept {
    /// Whether a part of a layer needs new planes.
    fn needs_planes(&self, layer: Layer, part: u32) -> bool {
        let of_layer = usize::from(layer == Layer::Real);
        let changed = self.changed.as_ref().map(|c| &c[of_layer]);
        changed.is_none_or(|parts| parts.contains(&part))
    }

    /// Planes of a layer that are not on the ground.
    fn over_parts(
        &self,
        layer: Layer,
        ground: Option<u32>,
    ) -> impl Iterator<Item = ShadowingPlane> {
        let ground: Vec<u32> = ground.into_iter().collect();
        let own = move |p: &&ShadowingPlane| p.layer == layer && !is_on(p, &ground);
        self.planes.iter().filter(own).cloned()
    }
}

/// Whether a plane is on that ground.
fn is_on(plane: &ShadowingPlane, ground: &[u32]) -> bool {
    plane.layer == Layer::Real && plane.parts == ground
}

/// Generates planes as [`generate`] in addition to planes that are `kept`; returns both.
pub(super) fn generate_additional(
    scene: &Scene,
    settings: &PlaneSettings,
    kept: &Kept,
) -> Result<Vec<ShadowingPlane>, PlaneError> {
    if !(2..=MAX_PLANES).contains(&settings.count) {
        return Err(PlaneError::Count {
            count: settings.count,
        });
    }
    let mut planes = scene.planes.clone();
    planes.sort_by_key(|p| p.layer != Layer::Real);
    let wanted = [Layer::Real, Layer::Virtual].map(|l| planes.iter().all(|p| p.layer != l));
    if scene.virtual_parts.is_empty() || wanted == [false, false] {
        return Ok(planes);
    }
    let model = model(scene)?;
    let left = (settings.count as usize).saturating_sub(planes.len());
    planes.extend(new_planes(scene, model, settings, left, wanted, kept)?);
    planes.sort_by_key(|p| p.layer != Layer::Real);
    Ok(planes)
}

fn model(scene: &Scene) -> Result<Surface, PlaneError> {
    let mut model = Surface::new(&scene.virtual_parts, &all(&scene.virtual_parts))?;
    if model.fragments.is_empty() {
        return Err(PlaneError::NoSurface);
    }
    let extent = max_extent(model.bounds());
    model.weigh(&RayCaster::from_parts(&scene.virtual_parts), extent);
    Ok(model)
}

/// Generates at most `count` planes of the requested layers (real, virtual).
fn new_planes(
    scene: &Scene,
    mut model: Surface,
    settings: &PlaneSettings,
    count: usize,
    [on_real, on_virtual]: [bool; 2],
    kept: &Kept,
) -> Result<Vec<ShadowingPlane>, PlaneError> {
    let mut real = if on_real {
        Surface::new(&scene.phantom_parts, &no_mirrors(scene))?
    } else {
        Surface::default()
    };
    let ground = Ground::find(scene, &real.fragments).filter(|_| on_real);
    let mut planes = ground.as_ref().map_or_else(Vec::new, |g| {
        g.planes(&model.fragments, (count / 4).clamp(1, 3), settings.offset_m)
    });
    let extent = max_extent(model.bounds());
    let ground = ground.and_then(|g| g.part);
    keep_ground(&mut planes, kept, ground);
    let phantoms = near_phantoms(&mut real, &model, ground, extent);
    let clusters = if on_virtual {
        divide(&mut model.fragments, scene, settings.clusters)
    } else {
        0
    };
    let left = count.saturating_sub(planes.len());
    let surfaces = [(&model, clusters), (&real, phantoms)];
    planes.extend(over_parts(surfaces, left, settings, kept, ground));
    Ok(planes)
}

/// Replaces new planes on the ground by existing ones that contain them and are not much larger.
fn keep_ground(planes: &mut [ShadowingPlane], kept: &Kept, ground: Option<u32>) {
    let ground: Vec<u32> = ground.into_iter().collect();
    let old: Vec<&ShadowingPlane> = kept.planes.iter().filter(|p| is_on(p, &ground)).collect();
    let area = |p: &ShadowingPlane| p.half_size.x * p.half_size.y;
    let holds = |old: &ShadowingPlane, new: &ShadowingPlane| {
        let offset = new.centre - old.centre;
        let (x, y) = (offset.dot(old.right).abs(), offset.dot(old.up).abs());
        let spare = new.half_size.max_element() * MAX_SHORTFALL;
        let room = old.half_size - new.half_size + spare;
        let lies_in = offset.dot(old.normal()).abs() < old.depth / 2.0
            && x <= room.x + 1e-6
            && y <= room.y + 1e-6;
        lies_in && area(old) <= MAX_AREA_RATIO * area(new)
    };
    if old.len() == planes.len() && old.iter().zip(planes.iter()).all(|(o, n)| holds(o, n)) {
        planes.iter_mut().zip(old).for_each(|(n, o)| *n = o.clone());
    }
}

fn all(parts: &[Part]) -> Vec<u32> {
    (0..parts.len() as u32).collect()
}

fn no_mirrors(scene: &Scene) -> Vec<u32> {
    let parts = (0..).zip(&scene.phantom_parts);
    parts.filter(|(_, p)| !p.mirror).map(|(i, _)| i).collect()
}

fn max_extent((low, high): (DVec3, DVec3)) -> f64 {
    (high - low).max_element()
}

/// Removes from `real` the phantoms that the model cannot shadow, makes each of the others a cluster,
/// and returns their number.
fn near_phantoms(real: &mut Surface, model: &Surface, ground: Option<u32>, extent: f64) -> u32 {
    let (low, high) = model.bounds();
    let distance = |p: DVec3| p.distance(p.clamp(low, high)) / extent;
    real.fragments.retain(|f| {
        // Light comes from above and from in front of a surface: a surface with the entire model
        // behind or below it is never in its shadow.
        let corner = DVec3::select(f.normal.cmpgt(DVec3::ZERO), high, low);
        let faces_it = (corner - f.centre).dot(f.normal) > 0.0 && f.centre.z < high.z;
        Some(f.part) != ground && distance(f.centre) < MAX_DISTANCE && faces_it
    });
    real.renumber();
    let mut parts: Vec<u32> = real.fragments.iter().map(|f| f.part).collect();
    parts.dedup();
    for f in &mut real.fragments {
        let near = distance(f.centre);
        f.area /= 1.0 + near * near;
        f.cluster = parts.iter().position(|p| *p == f.part).unwrap_or(0) as u32;
    }
    parts.len() as u32
}

/// Selects at most `most` planes over phantoms and over the model, in this order. `surfaces` are those
/// of the model and of the phantoms, with their numbers of clusters.
fn over_parts(
    surfaces: [(&Surface, u32); 2],
    max: usize,
    settings: &PlaneSettings,
    kept: &Kept,
    ground: Option<u32>,
) -> Vec<ShadowingPlane> {
    let [(model, _), (real, _)] = surfaces;
    let first = model.fragments.len() as u32;
    let of_layer = |at: usize, layer: Layer| {
        let (surface, clusters) = surfaces[at];
        let fragments = &surface.fragments;
        let changed = |f: &Fragment| kept.needs_planes(layer, f.part);
        let mut wanted = vec![false; clusters as usize];
        for f in fragments.iter().filter(|f| changed(f)) {
            if let Some(wanted) = wanted.get_mut(f.cluster as usize) {
                *wanted = true;
            }
        }
        let wanted = |c: u32| wanted.get(c as usize).is_some_and(|w| *w);
        let new = candidates(fragments, clusters, wanted, layer, settings.offset_m);
        // A layer with planes placed by hand has no clusters.
        let old = kept.over_parts(layer, ground).filter(|_| clusters > 0);
        let old = serving(old, fragments, clusters);
        [new, old].map(|mut all| {
            if layer == Layer::Real {
                all.iter_mut().for_each(|c| renumber_phantom(c, first));
            }
            all
        })
    };
    let [mut new, mut old] = of_layer(0, Layer::Virtual);
    let [new_real, old_real] = of_layer(1, Layer::Real);
    new.extend(new_real);
    old.extend(old_real);
    let count = model.fragments.len() + real.fragments.len();
    let taken = choose(new, &old, count, max.saturating_sub(old.len()), MIN_GAIN);
    let part = |i: u32| {
        model
            .fragments
            .get(i as usize)
            .map_or_else(|| real.fragments.get((i - first) as usize), Some)
            .map(|f| f.part)
    };
    let finish = |c: &Candidate| {
        let mut parts: Vec<u32> = c.serves.iter().filter_map(|(i, _)| part(*i)).collect();
        parts.sort_unstable();
        parts.dedup();
        ShadowingPlane {
            parts,
            receiver: settings.receiver,
            ..c.plane.clone()
        }
    };
    let mut planes: Vec<ShadowingPlane> = old.into_iter().map(|c| c.plane).collect();
    planes.extend(taken.iter().map(finish));
    planes.sort_by_key(|p| p.layer != Layer::Real);
    planes
}

/// Numbers a candidate's fragments after the `first` fragments of the model, and weights them.
fn renumber_phantom(candidate: &mut Candidate, first: u32) {
    for (i, share) in &mut candidate.serves {
        *i += first;
        *share *= PHANTOM_WEIGHT;
    }
}

#[cfg(test)]
mod tests;
