//! Finds the planes that are visible in a frame: those that face the viewer and lie in the picture.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3, DVec4};
use penumbra_interface::RigidTransform;
use penumbra_scene::planes::{Bake, Layer, Receiver, ShadowingPlane};

/// Twin of WGSL `VisiblePlane` in `lib/planes.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct VisiblePlane {
    pub u: [f32; 4],
    pub v: [f32; 4],
    pub behind: [f32; 4],
    pub normal: [f32; 4],
    pub kind: [u32; 4],
    pub scale: [f32; 4],
}

/// Minimum cosine between the normal of a plane with a surface receiver and the direction to the
/// viewer. It is negative because the surfaces behind a plane may be turned away from its normal.
const MIN_SURFACE_COSINE: f64 = -0.3;

/// Width of the border over which a plane fades out, texels.
const FADE: f32 = 1.5;

/// Maximum distance of a point from the receiver along the plane's normal, texels.
const TOLERANCE: f64 = 1.5;

/// All planes of a bake, and those that are visible in the current frame.
pub(super) struct VisiblePlanes {
    side: u32,
    all: Vec<(VisiblePlane, ShadowingPlane)>,
    is_visible: Vec<bool>,
    count: [u32; 4],
    visible: Vec<VisiblePlane>,
    /// Bounding box of the planes of the real layer, slabs included.
    pub bounds: (DVec3, DVec3),
}

impl VisiblePlanes {
    pub fn new(bake: &Bake) -> Self {
        let count = bake.planes.len();
        let mut all = Self {
            side: bake.settings.resolution,
            all: Vec::with_capacity(count),
            is_visible: vec![false; count],
            count: [0; 4],
            visible: Vec::with_capacity(count),
            bounds: (DVec3::ZERO, DVec3::ZERO),
        };
        all.place(&bake.planes, RigidTransform::IDENTITY);
        all
    }

    /// Moves the `planes` of the bake by `world_from_bake`.
    pub fn place(&mut self, planes: &[ShadowingPlane], world_from_bake: RigidTransform) {
        let placed = planes.iter().map(|p| p.moved(world_from_bake));
        let uniform = |(k, p): (usize, ShadowingPlane)| (visible_plane(&p, k as u32, self.side), p);
        self.all.clear();
        self.all.extend(placed.enumerate().map(uniform));
        let real = self.all.iter().filter(|(_, p)| p.layer == Layer::Real);
        let (low, high) = real
            .flat_map(|(_, p)| corners(p))
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
                (low.min(p), high.max(p))
            });
        // Surfaces lie on the box's faces, and depths are not exact.
        let margin = DVec3::splat(0.005 + 0.01 * (high - low).max_element().max(0.0));
        self.bounds = (low - margin, high + margin);
    }

    /// Size of the buffer for a number of planes, bytes.
    pub const fn bytes(planes: usize) -> usize {
        16 + size_of::<VisiblePlane>() * if planes == 0 { 1 } else { planes }
    }

    /// Finds the visible planes; returns for each plane whether it is visible.
    pub fn find_visible(&mut self, clip_from_world: DMat4, eye: DVec3) -> &[bool] {
        self.visible.clear();
        self.count = [0; 4];
        for ((uniform, plane), is_visible) in self.all.iter().zip(&mut self.is_visible) {
            *is_visible = faces(plane, eye) && is_in_picture(plane, clip_from_world);
            if *is_visible {
                self.visible.push(*uniform);
                self.count[1] += 1;
                self.count[0] += u32::from(plane.layer == Layer::Real);
            }
        }
        &self.is_visible
    }

    /// All planes, as the shaders read them; those of the real layer come first.
    pub fn all(&self) -> Vec<VisiblePlane> {
        self.all.iter().map(|(uniform, _)| *uniform).collect()
    }

    /// The counts (planes of the real layer, all planes) and the planes, as the shaders read them.
    pub fn uploads(&self) -> (&[u32; 4], &[VisiblePlane]) {
        (&self.count, &self.visible)
    }
}

/// Whether any corner of the plane faces the viewer.
fn faces(plane: &ShadowingPlane, eye: DVec3) -> bool {
    let min_cosine = match plane.receiver {
        Receiver::Plane => 0.0,
        Receiver::Surface => MIN_SURFACE_COSINE,
    };
    // From close by, the viewing angle varies across a plane: one corner is enough.
    corners(plane).any(|c| (eye - c).normalize_or_zero().dot(plane.normal()) > min_cosine)
}

/// Whether any part of the slab may lie in the picture (reversed depth: w is the distance).
fn is_in_picture(plane: &ShadowingPlane, clip_from_world: DMat4) -> bool {
    let clip: [DVec4; 8] = {
        let mut all = corners(plane);
        std::array::from_fn(|_| clip_from_world * all.next().unwrap_or_default().extend(1.0))
    };
    let outside = [
        clip.iter().all(|c| c.x < -c.w),
        clip.iter().all(|c| c.x > c.w),
        clip.iter().all(|c| c.y < -c.w),
        clip.iter().all(|c| c.y > c.w),
        clip.iter().all(|c| c.w <= 0.0),
    ];
    !outside.contains(&true)
}

/// Corners of the slab.
fn corners(plane: &ShadowingPlane) -> impl Iterator<Item = DVec3> {
    let (right, up) = (
        plane.right * plane.half_size.x,
        plane.up * plane.half_size.y,
    );
    let (centre, back) = (plane.centre, plane.normal() * plane.depth);
    (0..8).map(move |i| {
        let sign = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
        let behind = if i & 4 == 0 { DVec3::ZERO } else { back };
        centre + right * sign(1) + up * sign(2) - behind
    })
}

fn visible_plane(plane: &ShadowingPlane, layer: u32, side: u32) -> VisiblePlane {
    let row = |axis: DVec3, at: f64| axis.extend(at).as_vec4().to_array();
    let across = |axis: DVec3, half: f64| {
        let axis = axis / (2.0 * half);
        row(axis, 0.5 - axis.dot(plane.centre))
    };
    let normal = plane.normal();
    let texel = 2.0 * plane.half_size.max_element() / f64::from(side);
    let flat = plane.receiver == Receiver::Plane;
    // A flat receiver represents all surfaces in its slab.
    let tolerance = if flat {
        0.5 * texel + 1e-3
    } else {
        TOLERANCE * texel + 0.005 * plane.depth
    };
    VisiblePlane {
        u: across(plane.right, plane.half_size.x),
        v: across(-plane.up, plane.half_size.y),
        behind: row(-normal, normal.dot(plane.centre)),
        normal: normal.extend(plane.depth).as_vec4().to_array(),
        kind: [layer, u32::from(flat), 0, 0],
        scale: [
            (1.0 / texel) as f32,
            FADE / side as f32,
            tolerance as f32,
            0.0,
        ],
    }
}
