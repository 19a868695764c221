//! The surface of a layer in the world, divided into fragments that are small enough to be either
//! visible or hidden.

use super::PlaneError;
use crate::check::triangles;
use crate::mesh::Part;
use crate::raycast::RayCaster;
use glam::{DMat3, DVec3, Vec3};

/// Maximum number of triangles of a part that is not simplified first.
const MAX_PART_TRIANGLES: usize = 60_000;
/// Maximum number of triangles of a part that are used; of more, a regular subset is.
const MAX_KEPT: usize = 200_000;
/// Maximum edge of a fragment as a share of the surface's extent.
const FRAGMENT_SHARE: f64 = 1.0 / 24.0;
/// Maximum error of a simplified part as a share of its extent.
const SIMPLIFIED_SHARE: f64 = 1.0 / 1000.0;
/// Maximum number of fragments of a layer; beyond it triangles are not divided.
const MAX_FRAGMENTS: usize = 400_000;
/// Maximum number of fragments whose visibility is tested by rays; of more, a regular subset is, and
/// the rest counts as visible.
const MAX_PROBED: usize = 60_000;
/// Maximum coordinate, metres; beyond it single precision does not resolve centimetres.
const MAX_COORDINATE: f64 = 1e7;

/// A small triangle of the surface.
#[derive(Clone, Debug)]
pub(super) struct Fragment {
    /// World, metres.
    pub corners: [DVec3; 3],
    /// Mean of the corners.
    pub centre: DVec3,
    /// Unit vector, by winding.
    pub normal: DVec3,
    /// Area, square metres, weighted by visibility.
    pub area: f64,
    /// Index among the layer's parts.
    pub part: u32,
    /// Index of its cluster.
    pub cluster: u32,
    /// Index of the fragment.
    pub number: u32,
}

/// Fragments of all parts of a layer.
#[derive(Clone, Debug, Default)]
pub(super) struct Surface {
    /// In the parts' order.
    pub fragments: Vec<Fragment>,
}

impl Surface {
    /// Returns the surface of the parts with the indices `wanted`.
    ///
    /// # Errors
    /// A vertex is not finite or too far from the origin.
    pub fn new(parts: &[Part], wanted: &[u32]) -> Result<Self, PlaneError> {
        let mut fragments = Vec::new();
        for index in wanted {
            if let Some(part) = parts.get(*index as usize) {
                add_part(&mut fragments, part, *index)?;
            }
        }
        let (low, high) = bounds(fragments.iter().flat_map(|f| f.corners));
        let max_edge = (high - low).max_element() * FRAGMENT_SHARE;
        let mut out = Vec::with_capacity(fragments.len());
        for fragment in fragments {
            split(fragment, max_edge, &mut out);
        }
        let mut surface = Self { fragments: out };
        surface.renumber();
        Ok(surface)
    }

    /// Numbers the fragments again after some were removed.
    pub fn renumber(&mut self) {
        for (i, fragment) in self.fragments.iter_mut().enumerate() {
            fragment.number = i as u32;
        }
    }

    /// Corners of the bounding box; inverted for an empty surface.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        bounds(self.fragments.iter().flat_map(|f| f.corners))
    }

    /// Sets the area of fragments that are invisible from everywhere to zero, by casting rays against
    /// `rays`, and reduces that of fragments that face down, because viewers are above the ground.
    pub fn weigh(&mut self, rays: &RayCaster, extent: f64) {
        let step = self.fragments.len().div_ceil(MAX_PROBED).max(1);
        let around = directions_around();
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

/// Bounding box of `points`.
pub(super) fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
        (low.min(p), high.max(p))
    })
}

/// Unit vectors evenly distributed over the sphere, by the golden angle.
fn directions_around() -> [DVec3; 24] {
    std::array::from_fn(|i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / 24.0;
        let azimuth = i as f64 * 2.399_963_229_728_653;
        let out = (1.0 - z * z).sqrt();
        DVec3::new(out * azimuth.cos(), out * azimuth.sin(), z)
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
    let mesh = if count > MAX_PART_TRIANGLES {
        part.caster((extent_of(part) * SIMPLIFIED_SHARE) as f32)
    } else {
        part.mesh.clone()
    };
    let world = part.world_from_part;
    // A mirroring transform reverses the winding.
    let flips = DMat3::from_mat4(world).determinant() < 0.0;
    let step = (mesh.indices.len() / 3).div_ceil(MAX_KEPT).max(1);
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
    p.is_finite() && p.abs().max_element() <= MAX_COORDINATE
}

/// Longest edge of a part's bounding box in the world, metres.
fn extent_of(part: &Part) -> f64 {
    let place = |p: Vec3| part.world_from_part.transform_point3(p.as_dvec3());
    let (low, high) = bounds(part.mesh.vertices.iter().map(|v| place(v.position)));
    (high - low).max_element()
}

/// Creates a fragment; `None` for a triangle without area.
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

/// Bisects `fragment` at its longest edge until no edge is longer than `max_edge`.
fn split(fragment: Fragment, max_edge: f64, out: &mut Vec<Fragment>) {
    let mut waiting = vec![fragment];
    while let Some(f) = waiting.pop() {
        let edge = |i: usize| f.corners[i].distance(f.corners[(i + 1) % 3]);
        let (at, length) = (0..3)
            .map(|i| (i, edge(i)))
            .fold((0, 0.0), |best, e| if e.1 > best.1 { e } else { best });
        if length <= max_edge || out.len() + waiting.len() >= MAX_FRAGMENTS {
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
