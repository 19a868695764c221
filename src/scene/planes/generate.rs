//! Shadowing planes from the model itself.

use super::choose::{Candidate, candidates, choose, serving};
use super::clusters::divide;
use super::ground::Ground;
use super::surface::{Fragment, Surface};
use super::{Layer, Receiver, ShadowingPlane};
use crate::mesh::{Part, Scene};
use crate::raycast::RayCaster;
use glam::DVec3;
use thiserror::Error;

/// How many planes, and how they lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneSettings {
    /// Planes at most, those of the ground and of phantoms among them.
    pub count: u32,
    /// Clusters at most that the model is divided into.
    pub clusters: u32,
    /// How far planes stand off what they cover, metres; less for what is small.
    pub offset_m: f64,
    /// Where planes over parts catch their shadows. Those of the ground always catch them
    /// themselves.
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

/// Why no planes can be made.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PlaneError {
    /// A vertex is not finite, or too far from the origin.
    #[error(
        "{part}: a vertex lies more than 10000 km from the world's origin or is no number; check the model's units and its position"
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
        /// What was asked for.
        count: u32,
    },
}

/// Planes on the ground have room to spare beyond the shadows, a share of their own size that
/// they may lack and still be kept.
const SPARE: f64 = 0.04;
/// Planes on the ground may be kept that are larger than needed by this factor.
const COARSER: f64 = 1.7;
/// Planes that one call may make.
const MOST_PLANES: u32 = 1000;
/// A plane that gains less than this share of what the best one gains is not worth its images.
const LEAST_GAIN: f32 = 0.002;
/// Phantoms farther from the model than this many times its extent take no shadow of it.
const REACH: f64 = 6.25;
/// What phantoms count beside the model of the same size: a shadow need not fall on them.
const PHANTOM_SHARE: f32 = 0.3;

/// Planes for everything virtual, for the ground and for the phantoms about the model; those
/// of the real layer first. Nothing virtual needs no planes.
///
/// # Errors
///
/// Models without any surface, with vertices that are no numbers, and a useless
/// [`PlaneSettings::count`].
pub fn generate(
    scene: &Scene,
    settings: &PlaneSettings,
) -> Result<Vec<ShadowingPlane>, PlaneError> {
    generate_beside(scene, settings, &Kept::default())
}

/// Planes of an earlier bake that still stand for what they cover.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    /// Over parts, and those on the ground.
    pub planes: Vec<ShadowingPlane>,
    /// Virtual and real parts that need planes anew, by index; none where all do.
    pub changed: Option<[Vec<u32>; 2]>,
}

impl Kept {
    /// Whether a layer's part needs planes.
    fn wants(&self, layer: Layer, part: u32) -> bool {
        let of_layer = usize::from(layer == Layer::Real);
        let changed = self.changed.as_ref().map(|c| &c[of_layer]);
        changed.is_none_or(|parts| parts.contains(&part))
    }

    /// Those that are no ground.
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

/// Whether a plane is one of those on that ground.
fn is_on(plane: &ShadowingPlane, ground: &[u32]) -> bool {
    plane.layer == Layer::Real && plane.parts == ground
}

/// The same beside planes that are `kept`, which are among what is returned.
pub(super) fn generate_beside(
    scene: &Scene,
    settings: &PlaneSettings,
    kept: &Kept,
) -> Result<Vec<ShadowingPlane>, PlaneError> {
    if !(2..=MOST_PLANES).contains(&settings.count) {
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
    planes.extend(made(scene, model, settings, left, wanted, kept)?);
    planes.sort_by_key(|p| p.layer != Layer::Real);
    Ok(planes)
}

fn model(scene: &Scene) -> Result<Surface, PlaneError> {
    let mut model = Surface::new(&scene.virtual_parts, &all(&scene.virtual_parts))?;
    if model.fragments.is_empty() {
        return Err(PlaneError::NoSurface);
    }
    let extent = longest(model.bounds());
    model.weigh(&RayCaster::from_parts(&scene.virtual_parts), extent);
    Ok(model)
}

/// At most `count` planes of those layers (real, virtual) that are `wanted`.
fn made(
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
    let ground = Ground::of(scene, &real.fragments).filter(|_| on_real);
    let mut planes = ground.as_ref().map_or_else(Vec::new, |g| {
        g.planes(&model.fragments, (count / 4).clamp(1, 3), settings.offset_m)
    });
    let extent = longest(model.bounds());
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

/// Planes on the ground that were there stay where they hold what the new ones would, and are
/// not much coarser.
fn keep_ground(planes: &mut [ShadowingPlane], kept: &Kept, ground: Option<u32>) {
    let ground: Vec<u32> = ground.into_iter().collect();
    let old: Vec<&ShadowingPlane> = kept.planes.iter().filter(|p| is_on(p, &ground)).collect();
    let area = |p: &ShadowingPlane| p.half_size.x * p.half_size.y;
    let holds = |old: &ShadowingPlane, new: &ShadowingPlane| {
        let off = new.centre - old.centre;
        let (x, y) = (off.dot(old.right).abs(), off.dot(old.up).abs());
        let spare = new.half_size.max_element() * SPARE;
        let room = old.half_size - new.half_size + spare;
        let lies_in = off.dot(old.normal()).abs() < old.depth / 2.0
            && x <= room.x + 1e-6
            && y <= room.y + 1e-6;
        lies_in && area(old) <= COARSER * area(new)
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

fn longest((low, high): (DVec3, DVec3)) -> f64 {
    (high - low).max_element()
}

/// Leaves those phantoms in `real` on which shadows of the model can fall, each a cluster; says
/// how many.
fn near_phantoms(real: &mut Surface, model: &Surface, ground: Option<u32>, extent: f64) -> u32 {
    let (low, high) = model.bounds();
    let off = |p: DVec3| p.distance(p.clamp(low, high)) / extent;
    real.fragments.retain(|f| {
        // All light comes from above, and falls on what faces it: a surface that has the
        // whole model behind itself, or beneath, never lies in its shadow.
        let corner = DVec3::select(f.normal.cmpgt(DVec3::ZERO), high, low);
        let faces_it = (corner - f.centre).dot(f.normal) > 0.0 && f.centre.z < high.z;
        Some(f.part) != ground && off(f.centre) < REACH && faces_it
    });
    real.renumber();
    let mut parts: Vec<u32> = real.fragments.iter().map(|f| f.part).collect();
    parts.dedup();
    for f in &mut real.fragments {
        let near = off(f.centre);
        f.area /= 1.0 + near * near;
        f.cluster = parts.iter().position(|p| *p == f.part).unwrap_or(0) as u32;
    }
    parts.len() as u32
}

/// Planes over phantoms, then those over the model, together at most `most`. `surfaces` are
/// those of the model and of phantoms, with the numbers of their clusters.
fn over_parts(
    surfaces: [(&Surface, u32); 2],
    most: usize,
    settings: &PlaneSettings,
    kept: &Kept,
    ground: Option<u32>,
) -> Vec<ShadowingPlane> {
    let [(model, _), (real, _)] = surfaces;
    let first = model.fragments.len() as u32;
    let of_layer = |at: usize, layer: Layer| {
        let (surface, clusters) = surfaces[at];
        let fragments = &surface.fragments;
        let changed = |f: &Fragment| kept.wants(layer, f.part);
        let mut wanted = vec![false; clusters as usize];
        for f in fragments.iter().filter(|f| changed(f)) {
            if let Some(wanted) = wanted.get_mut(f.cluster as usize) {
                *wanted = true;
            }
        }
        let wanted = |c: u32| wanted.get(c as usize).is_some_and(|w| *w);
        let new = candidates(fragments, clusters, wanted, layer, settings.offset_m);
        // A layer whose planes stand by hand has no clusters.
        let old = kept.over_parts(layer, ground).filter(|_| clusters > 0);
        let old = serving(old, fragments, clusters);
        [new, old].map(|mut all| {
            if layer == Layer::Real {
                all.iter_mut().for_each(|c| of_phantoms(c, first));
            }
            all
        })
    };
    let [mut new, mut old] = of_layer(0, Layer::Virtual);
    let [new_real, old_real] = of_layer(1, Layer::Real);
    new.extend(new_real);
    old.extend(old_real);
    let count = model.fragments.len() + real.fragments.len();
    let taken = choose(new, &old, count, most.saturating_sub(old.len()), LEAST_GAIN);
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

/// Numbers a candidate's fragments after the model's, of which there are `first`.
fn of_phantoms(candidate: &mut Candidate, first: u32) {
    for (i, share) in &mut candidate.serves {
        *i += first;
        *share *= PHANTOM_SHARE;
    }
}

#[cfg(test)]
mod tests;
