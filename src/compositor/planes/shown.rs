//! Which planes the picture shows: those that face the viewer and lie in it.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3, DVec4};
use penumbra_interface::RigidTransform;
use penumbra_scene::planes::{Bake, Layer, Receiver, ShadowingPlane};

/// Twin of WGSL `ShownPlane` in `lib/planes.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct ShownPlane {
    u: [f32; 4],
    v: [f32; 4],
    behind: [f32; 4],
    normal: [f32; 4],
    kind: [u32; 4],
    scale: [f32; 4],
}

/// Surfaces behind a plane may face up to so much away from it and still be seen: cosine of
/// plane and view.
const TURNED_AWAY: f64 = -0.3;

/// Texels over which a plane fades out at its border.
const FADE: f32 = 1.5;

/// Texels by which a point may lie before or behind the receiver.
const TOLERANCE: f64 = 1.5;

/// All planes of a bake, and those in sight.
pub(super) struct ShownPlanes {
    side: u32,
    all: Vec<(ShownPlane, ShadowingPlane)>,
    seen: Vec<bool>,
    count: [u32; 4],
    chosen: Vec<ShownPlane>,
    /// Box around what planes of the real layer cover.
    pub reach: (DVec3, DVec3),
}

impl ShownPlanes {
    pub fn of(bake: &Bake) -> Self {
        let count = bake.planes.len();
        let mut all = Self {
            side: bake.settings.resolution,
            all: Vec::with_capacity(count),
            seen: vec![false; count],
            count: [0; 4],
            chosen: Vec::with_capacity(count),
            reach: (DVec3::ZERO, DVec3::ZERO),
        };
        all.place(&bake.planes, RigidTransform::IDENTITY);
        all
    }

    /// Puts the bake's `planes` where a motion carries them.
    pub fn place(&mut self, planes: &[ShadowingPlane], world_from_bake: RigidTransform) {
        let placed = planes.iter().map(|p| p.moved(world_from_bake));
        let shown = |(k, p): (usize, ShadowingPlane)| (shown(&p, k as u32, self.side), p);
        self.all.clear();
        self.all.extend(placed.enumerate().map(shown));
        let real = self.all.iter().filter(|(_, p)| p.layer == Layer::Real);
        let (low, high) = real
            .flat_map(|(_, p)| corners(p))
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
                (low.min(p), high.max(p))
            });
        // Surfaces lie on the box's faces, and depths are not exact.
        let margin = DVec3::splat(0.005 + 0.01 * (high - low).max_element().max(0.0));
        self.reach = (low - margin, high + margin);
    }

    /// Bytes of the buffer for as many planes.
    pub const fn bytes(planes: usize) -> usize {
        16 + size_of::<ShownPlane>() * if planes == 0 { 1 } else { planes }
    }

    /// Chooses; tells of each plane whether it is in sight.
    pub fn choose(&mut self, clip_from_world: DMat4, eye: DVec3) -> &[bool] {
        self.chosen.clear();
        self.count = [0; 4];
        for ((shown, plane), seen) in self.all.iter().zip(&mut self.seen) {
            *seen = faces(plane, eye) && in_picture(plane, clip_from_world);
            if *seen {
                self.chosen.push(*shown);
                self.count[1] += 1;
                self.count[0] += u32::from(plane.layer == Layer::Real);
            }
        }
        &self.seen
    }

    /// Counts and planes as the shaders read them.
    pub fn uploads(&self) -> (&[u32; 4], &[ShownPlane]) {
        (&self.count, &self.chosen)
    }
}

fn faces(plane: &ShadowingPlane, eye: DVec3) -> bool {
    let least = match plane.receiver {
        Receiver::Plane => 0.0,
        Receiver::Surface => TURNED_AWAY,
    };
    // From close by a plane is seen at many angles: its nearest corner decides.
    corners(plane).any(|c| (eye - c).normalize_or_zero().dot(plane.normal()) > least)
}

/// Whether a part of the slab may lie in the picture (reversed depth: w is the distance).
fn in_picture(plane: &ShadowingPlane, clip_from_world: DMat4) -> bool {
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

fn shown(plane: &ShadowingPlane, layer: u32, side: u32) -> ShownPlane {
    let row = |axis: DVec3, at: f64| axis.extend(at).as_vec4().to_array();
    let across = |axis: DVec3, half: f64| {
        let axis = axis / (2.0 * half);
        row(axis, 0.5 - axis.dot(plane.centre))
    };
    let normal = plane.normal();
    let texel = 2.0 * plane.half_size.max_element() / f64::from(side);
    let flat = plane.receiver == Receiver::Plane;
    // A flat receiver stands for whatever lies in its slab.
    let tolerance = if flat {
        0.5 * texel + 1e-3
    } else {
        TOLERANCE * texel + 0.005 * plane.depth
    };
    ShownPlane {
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
