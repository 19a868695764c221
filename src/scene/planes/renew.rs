//! What of a bake still holds after some of its scene's parts were changed: planes that do not
//! stand for them stay, and so do images on which their shadows, the old ones and the new ones,
//! cannot fall.

use super::generate::{Kept, PlaneError, PlaneSettings, generate_beside};
use super::surface::bounds;
use super::{Bake, Layer, ShadowingPlane};
use crate::change::is_same;
use crate::mesh::{Part, Scene};
use glam::DVec3;
use penumbra_lighting::geodesic::{Face, GeodesicDome};

/// A bake that is to be mended.
#[derive(Clone, Debug, PartialEq)]
pub struct Renewal {
    /// All planes of the new bake; those of the real layer come first.
    pub planes: Vec<ShadowingPlane>,
    /// For each the same plane of the old bake, whose receiver and images it can take.
    pub from: Vec<Option<usize>>,
    /// For each plane all lights: whether the image has to be drawn anew.
    pub drawn: Vec<bool>,
}

impl Renewal {
    /// Planes that are not in the old bake, and images to be drawn.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        let new = self.from.iter().filter(|f| f.is_none()).count();
        (new, self.drawn.iter().filter(|d| **d).count())
    }
}

/// Planes that there must be room for beside those that are kept.
const LEAST_NEW: usize = 3;

/// What has to be baked for `scene`, where `old` is the bake of `old_scene`.
///
/// # Errors
/// A scene that no planes can be made for.
pub fn renew(
    old: &Bake,
    old_scene: &Scene,
    scene: &Scene,
    settings: &PlaneSettings,
) -> Result<Renewal, PlaneError> {
    let parts = [Layer::Virtual, Layer::Real]
        .map(|layer| Matched::new(parts_of(old_scene, layer), parts_of(scene, layer)));
    let matched = |layer: Layer| &parts[usize::from(layer == Layer::Real)];
    let carried: Vec<Option<ShadowingPlane>> = old
        .planes
        .iter()
        .map(|plane| matched(plane.layer).carried(plane))
        .collect();
    let planes = planes(&carried, &parts, scene, settings)?;
    let same = |plane: &ShadowingPlane| carried.iter().position(|c| c.as_ref() == Some(plane));
    let from: Vec<Option<usize>> = planes.iter().map(same).collect();
    let casters: Vec<Extent> = parts.iter().flat_map(|p| p.boxes.iter().copied()).collect();
    let dome = GeodesicDome::new(old.settings.frequency);
    let lights: Vec<Vec<DVec3>> = dome
        .iter()
        .flat_map(|dome| &dome.faces)
        .map(|face| directions(face, old.settings.samples))
        .collect();
    let drawn = planes
        .iter()
        .zip(&from)
        .flat_map(|(plane, from)| {
            let casters = &casters;
            let anew = from.is_none();
            lights
                .iter()
                .map(move |towards| anew || casters.iter().any(|c| may_shadow(c, towards, plane)))
        })
        .collect();
    Ok(Renewal {
        planes,
        from,
        drawn,
    })
}

/// The planes of the new bake, in its order.
fn planes(
    carried: &[Option<ShadowingPlane>],
    parts: &[Matched; 2],
    scene: &Scene,
    settings: &PlaneSettings,
) -> Result<Vec<ShadowingPlane>, PlaneError> {
    let stay: Vec<ShadowingPlane> = carried.iter().flatten().cloned().collect();
    let changed = [parts[0].changed.clone(), parts[1].changed.clone()];
    let room = settings.count as usize >= stay.len() + LEAST_NEW;
    let kept = if room || changed.iter().all(Vec::is_empty) {
        Kept {
            planes: stay,
            changed: Some(changed),
        }
    } else {
        // What was added has no plane to itself.
        Kept::default()
    };
    let mut planes = generate_beside(scene, settings, &kept)?;
    // The order that the baker leaves.
    planes.sort_by_key(|plane| plane.layer == Layer::Virtual);
    Ok(planes)
}

fn parts_of(scene: &Scene, layer: Layer) -> &[Part] {
    match layer {
        Layer::Virtual => &scene.virtual_parts,
        Layer::Real => &scene.phantom_parts,
    }
}

/// Parts of a layer before and after.
struct Matched {
    /// For each old part the number of the same new one.
    new_from_old: Vec<Option<u32>>,
    /// New parts that were not there.
    changed: Vec<u32>,
    /// Extentes of what was changed, before and after.
    boxes: Vec<Extent>,
}

impl Matched {
    fn new(old: &[Part], new: &[Part]) -> Self {
        let mut taken = vec![false; new.len()];
        let new_from_old: Vec<Option<u32>> = old
            .iter()
            .map(|a| {
                let free = |(b, taken): (&Part, &bool)| !taken && is_same(a, b);
                let at = new.iter().zip(&taken).position(free)?;
                taken[at] = true;
                Some(at as u32)
            })
            .collect();
        let numbered = (0..).zip(&taken);
        let changed: Vec<u32> = numbered.filter(|(_, t)| !**t).map(|(i, _)| i).collect();
        let gone = old.iter().zip(&new_from_old).filter(|(_, n)| n.is_none());
        let come = changed.iter().filter_map(|i| new.get(*i as usize));
        let boxes = gone.map(|(part, _)| part).chain(come);
        Self {
            boxes: boxes.map(Extent::around).collect(),
            new_from_old,
            changed,
        }
    }

    /// The plane with its parts' new numbers; none where one of them was changed.
    fn carried(&self, plane: &ShadowingPlane) -> Option<ShadowingPlane> {
        let number = |i: &u32| self.new_from_old.get(*i as usize).copied().flatten();
        let mut parts: Vec<u32> = plane.parts.iter().map(number).collect::<Option<_>>()?;
        parts.sort_unstable();
        Some(ShadowingPlane {
            parts,
            ..plane.clone()
        })
    }
}

/// A box along the world's axes.
#[derive(Clone, Copy, Debug)]
struct Extent {
    low: DVec3,
    high: DVec3,
}

impl Extent {
    fn around(part: &Part) -> Self {
        let place =
            |v: &crate::mesh::Vertex| part.world_from_part.transform_point3(v.position.as_dvec3());
        let (low, high) = bounds(part.mesh.vertices.iter().map(place));
        Self { low, high }
    }

    fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
            DVec3::new(
                pick(0, self.low.x, self.high.x),
                pick(1, self.low.y, self.high.y),
                pick(2, self.low.z, self.high.z),
            )
        })
    }
}

/// Directions to a face's light: its middle, or its corners, between which all samples lie.
fn directions(face: &Face, samples: u32) -> Vec<DVec3> {
    if samples == 1 {
        return vec![face.centre.as_dvec3()];
    }
    face.corners.iter().map(|c| c.as_dvec3()).collect()
}

/// Whether a shadow of what lies in `caster` can fall into the plane's slab, with light from
/// between `towards`. Separating axes: what an axis separates for each of the directions it
/// separates for all between them.
fn may_shadow(caster: &Extent, towards: &[DVec3], plane: &ShadowingPlane) -> bool {
    let (normal, corners) = (plane.normal(), caster.corners());
    let slab = slab_corners(plane);
    let own = [plane.right, plane.up, normal];
    let edges = own.into_iter().chain(DVec3::AXES);
    let crossed = edges.flat_map(|edge| towards.iter().map(move |l| edge.cross(*l)));
    let mut axes = own.into_iter().chain(DVec3::AXES).chain(crossed);
    let separates = |axis: DVec3| {
        // The shadow leaves the caster against the light: along the axis it may only fall.
        let falls = |axis: DVec3| towards.iter().all(|l| axis.dot(*l) >= -1e-9);
        let beyond = |axis: DVec3| {
            let most = corners.iter().map(|c| c.dot(axis)).fold(f64::MIN, f64::max);
            let least = slab.iter().map(|c| c.dot(axis)).fold(f64::MAX, f64::min);
            falls(axis) && most < least
        };
        beyond(axis) || beyond(-axis)
    };
    !axes.any(separates)
}

/// Corners of what a plane stands for, and a little more: images are smooth over a texel.
fn slab_corners(plane: &ShadowingPlane) -> [DVec3; 8] {
    let margin = 1.02;
    let (right, up) = (
        plane.right * plane.half_size.x * margin,
        plane.up * plane.half_size.y * margin,
    );
    let back = plane.normal() * plane.depth;
    std::array::from_fn(|i| {
        let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let behind = if i & 4 == 0 {
            -back * 0.02
        } else {
            back * margin
        };
        plane.centre + right * sign(0) + up * sign(1) - behind
    })
}

#[cfg(test)]
mod tests;
