//! Finds the parts of a bake that remain valid after some parts of its scene changed: planes that do
//! not cover changed parts, and images that neither the old nor the new shadows of these reach.

use super::generate::{Kept, PlaneError, PlaneSettings, generate_additional};
use super::surface::bounds;
use super::{Bake, Layer, ShadowingPlane};
use crate::change::is_same;
use crate::mesh::Part;
use crate::scene::Scene;
use glam::DVec3;
use penumbra_lighting::geodesic::{Face, GeodesicDome};

/// A bake that is to be updated.
#[derive(Clone, Debug, PartialEq)]
pub struct Renewal {
    /// All planes of the new bake; those of the real layer come first.
    pub planes: Vec<ShadowingPlane>,
    /// For each plane the index of the same plane of the old bake, whose receiver and images remain
    /// valid.
    pub from: Vec<Option<usize>>,
    /// For each plane and light: whether the image must be rendered again.
    pub drawn: Vec<bool>,
}

impl Renewal {
    /// Number of planes that are not in the old bake, and of images to render.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        let new = self.from.iter().filter(|f| f.is_none()).count();
        (new, self.drawn.iter().filter(|d| **d).count())
    }
}

/// Minimum number of new planes that must be possible in addition to the kept ones.
const MIN_NEW: usize = 3;

/// Finds what must be baked for `scene`; `old` is the bake of `old_scene`.
///
/// # Errors
/// No planes can be generated for the scene.
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
            let is_new = from.is_none();
            lights
                .iter()
                .map(move |towards| is_new || casters.iter().any(|c| may_shadow(c, towards, plane)))
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
    let room = settings.count as usize >= stay.len() + MIN_NEW;
    let kept = if room || changed.iter().all(Vec::is_empty) {
        Kept {
            planes: stay,
            changed: Some(changed),
        }
    } else {
        // There is no room for planes of added parts: all planes are generated again.
        Kept::default()
    };
    let mut planes = generate_additional(scene, settings, &kept)?;
    // The order in which the baker writes them.
    planes.sort_by_key(|plane| plane.layer == Layer::Virtual);
    Ok(planes)
}

fn parts_of(scene: &Scene, layer: Layer) -> &[Part] {
    match layer {
        Layer::Virtual => &scene.virtual_parts,
        Layer::Real => &scene.phantom_parts,
    }
}

/// Correspondence of a layer's old and new parts.
struct Matched {
    /// For each old part the index of the same new one.
    new_from_old: Vec<Option<u32>>,
    /// Indices of new parts without a counterpart.
    changed: Vec<u32>,
    /// Bounding boxes of changed parts, before and after.
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
        let removed = old.iter().zip(&new_from_old).filter(|(_, n)| n.is_none());
        let added = changed.iter().filter_map(|i| new.get(*i as usize));
        let boxes = removed.map(|(part, _)| part).chain(added);
        Self {
            boxes: boxes.map(Extent::around).collect(),
            new_from_old,
            changed,
        }
    }

    /// The plane with its parts' new indices; `None` if one of them changed.
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

/// Directions to a face's light: its centre, or its corners, which enclose all samples.
fn directions(face: &Face, samples: u32) -> Vec<DVec3> {
    if samples == 1 {
        return vec![face.centre.as_dvec3()];
    }
    face.corners.iter().map(|c| c.as_dvec3()).collect()
}

/// Whether a shadow of `caster` can fall into the plane's slab, with light from directions between
/// `towards`. By separating axes: an axis that separates for each of the directions separates for
/// all between them.
fn may_shadow(caster: &Extent, towards: &[DVec3], plane: &ShadowingPlane) -> bool {
    let (normal, corners) = (plane.normal(), caster.corners());
    let slab = slab_corners(plane);
    let own = [plane.right, plane.up, normal];
    let edges = own.into_iter().chain(DVec3::AXES);
    let crossed = edges.flat_map(|edge| towards.iter().map(move |l| edge.cross(*l)));
    let mut axes = own.into_iter().chain(DVec3::AXES).chain(crossed);
    let separates = |axis: DVec3| {
        // The shadow extends from the caster against the light: its coordinate along the axis must
        // not increase.
        let falls = |axis: DVec3| towards.iter().all(|l| axis.dot(*l) >= -1e-9);
        let beyond = |axis: DVec3| {
            let max = corners.iter().map(|c| c.dot(axis)).fold(f64::MIN, f64::max);
            let min = slab.iter().map(|c| c.dot(axis)).fold(f64::MAX, f64::min);
            falls(axis) && max < min
        };
        beyond(axis) || beyond(-axis)
    };
    !axes.any(separates)
}

/// Corners of the slab that a plane covers, with a margin for filtering over a texel.
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
