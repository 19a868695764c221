//! A layer's surface in the world, cut into fragments small enough that each is either seen
//! or not.

use super::PlaneError;
use crate::check::triangles;
use crate::mesh::Part;
use crate::raycast::RayCaster;
use glam::{DMat3, DVec3, Vec3};

/// Triangles of one part beyond which it is simplified first.
const MOST_PART_TRIANGLES: usize = 60_000;
/// Triangles of one part that are looked at; of more, evenly some.
const MOST_KEPT: usize = 200_000;
/// A fragment is at most this share of the surface's extent across.
const FRAGMENT_SHARE: f64 = 1.0 / 24.0;
/// A simplified part may be off by this share of the part's extent.
const SIMPLIFIED_SHARE: f64 = 1.0 / 1000.0;
/// Fragments of one layer; past it triangles stay whole.
const MOST_FRAGMENTS: usize = 400_000;
/// Fragments whose sight is found by rays; of more, evenly some, and the rest counts as seen.
const MOST_PROBED: usize = 60_000;
/// Metres from the origin; beyond them single precision has no centimetres left.
const FARTHEST: f64 = 1e7;

/// A small triangle of the surface.
#[derive(Clone, Debug)]
pub(super) struct Fragment {
    /// World, metres.
    pub corners: [DVec3; 3],
    /// Their mean.
    pub centre: DVec3,
    /// Unit vector, by winding.
    pub normal: DVec3,
    /// Square metres; with the weight of being seen from somewhere.
    pub area: f64,
    /// Index among the layer's parts.
    pub part: u32,
    /// Cluster that it belongs to.
    pub cluster: u32,
    /// Its own index.
    pub number: u32,
}

/// Fragments of all parts of a layer.
#[derive(Clone, Debug, Default)]
pub(super) struct Surface {
    /// In the parts' order.
    pub fragments: Vec<Fragment>,
}

impl Surface {
    /// The surface of those `parts` that `wanted` names by index.
    pub fn new(parts: &[Part], wanted: &[u32]) -> Result<Self, PlaneError> {
        let mut whole = Vec::new();
        for index in wanted {
            if let Some(part) = parts.get(*index as usize) {
                add_part(&mut whole, part, *index)?;
            }
        }
        let (low, high) = bounds(whole.iter().flat_map(|f| f.corners));
        let longest = (high - low).max_element() * FRAGMENT_SHARE;
        let mut out = Vec::with_capacity(whole.len());
        for fragment in whole {
            split(fragment, longest, &mut out);
        }
        let mut surface = Self { fragments: out };
        surface.renumber();
        Ok(surface)
    }

    /// After fragments were taken away.
    pub fn renumber(&mut self) {
        for (i, fragment) in self.fragments.iter_mut().enumerate() {
            fragment.number = i as u32;
        }
    }

    /// Corners of the bounding box; nothing gives an inverted one.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        bounds(self.fragments.iter().flat_map(|f| f.corners))
    }

    /// Takes away the weight of what can be seen from nowhere, by rays against `rays`, and
    /// most of the weight of what looks down: visitors stand on the ground.
    pub fn weigh(&mut self, rays: &RayCaster, extent: f64) {
        let step = self.fragments.len().div_ceil(MOST_PROBED).max(1);
        let around = around();
        for (i, fragment) in self.fragments.iter_mut().enumerate() {
            if fragment.normal.z < -0.7 {
                fragment.area *= 0.25;
            }
            if i % step == 0 && is_enclosed(fragment, rays, extent, &around) {
                fragment.area = 0.0;
            }
        }
    }
}

/// The box around `points`.
pub(super) fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
        (low.min(p), high.max(p))
    })
}

/// Unit vectors evenly around, by the golden angle.
fn around() -> [DVec3; 24] {
    std::array::from_fn(|i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / 24.0;
        let turn = i as f64 * 2.399_963_229_728_653;
        let out = (1.0 - z * z).sqrt();
        DVec3::new(out * turn.cos(), out * turn.sin(), z)
    })
}

fn is_enclosed(f: &Fragment, rays: &RayCaster, extent: f64, around: &[DVec3]) -> bool {
    let origin = f.centre + f.normal * extent * 1e-4;
    let blocked = |d: &DVec3| rays.is_blocked(origin, *d, 4.0 * extent);
    let mut open = around.iter().filter(|d| d.dot(f.normal) > 0.15);
    !open.any(|d| !blocked(d))
}

fn add_part(out: &mut Vec<Fragment>, part: &Part, index: u32) -> Result<(), PlaneError> {
    let count = part.mesh.indices.len() / 3;
    let mesh = if count > MOST_PART_TRIANGLES {
        part.caster((extent_of(part) * SIMPLIFIED_SHARE) as f32)
    } else {
        part.mesh.clone()
    };
    let world = part.world_from_part;
    // A mirroring placement turns the winding round.
    let flips = DMat3::from_mat4(world).determinant() < 0.0;
    let step = (mesh.indices.len() / 3).div_ceil(MOST_KEPT).max(1);
    for corners in triangles(&mesh).step_by(step) {
        let mut corners = corners.map(|p| world.transform_point3(p.as_dvec3()));
        if corners.iter().any(|p| !is_near(*p)) {
            let name = part.name.clone();
            return Err(PlaneError::FarAway { part: name });
        }
        if flips {
            corners.swap(1, 2);
        }
        let scale = step as f64;
        out.extend(fragment(corners, index, scale));
        if part.material.double_sided {
            let [a, b, c] = corners;
            out.extend(fragment([a, c, b], index, scale));
        }
    }
    Ok(())
}

fn is_near(p: DVec3) -> bool {
    p.is_finite() && p.abs().max_element() <= FARTHEST
}

/// The longest edge of a part's bounding box in the world.
fn extent_of(part: &Part) -> f64 {
    let place = |p: Vec3| part.world_from_part.transform_point3(p.as_dvec3());
    let (low, high) = bounds(part.mesh.vertices.iter().map(|v| place(v.position)));
    (high - low).max_element()
}

/// None for a triangle without area.
fn fragment(corners: [DVec3; 3], part: u32, scale: f64) -> Option<Fragment> {
    let [a, b, c] = corners;
    let cross = (b - a).cross(c - a);
    let normal = cross.try_normalize()?;
    Some(Fragment {
        corners,
        centre: (a + b + c) / 3.0,
        normal,
        area: scale * cross.length() / 2.0,
        part,
        cluster: 0,
        number: 0,
    })
}

/// Halves `fragment` across its longest edge until no edge is longer than `longest`.
fn split(fragment: Fragment, longest: f64, out: &mut Vec<Fragment>) {
    let mut waiting = vec![fragment];
    while let Some(f) = waiting.pop() {
        let edge = |i: usize| f.corners[i].distance(f.corners[(i + 1) % 3]);
        let (at, length) = (0..3)
            .map(|i| (i, edge(i)))
            .fold((0, 0.0), |best, e| if e.1 > best.1 { e } else { best });
        if length <= longest || out.len() + waiting.len() >= MOST_FRAGMENTS {
            out.push(f);
            continue;
        }
        let [a, b, c] = [0, 1, 2].map(|i| f.corners[(at + i) % 3]);
        let middle = a.midpoint(b);
        for corners in [[a, middle, c], [middle, b, c]] {
            waiting.push(Fragment {
                corners,
                centre: corners.iter().sum::<DVec3>() / 3.0,
                area: f.area / 2.0,
                ..f.clone()
            });
        }
    }
}
