//! The surfaces that receive light, still and moving.

use crate::layout::{Bounds, Layout, Receiver};
use crate::texels::{Cone, PageTexels};
use glam::{DMat3, DMat4, Vec3};
use penumbra_scene::{Part, Scene};
use std::sync::Arc;

/// The kinds of receivers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// A virtual part of this number.
    Virtual(usize),
    /// A phantom of this number.
    Phantom(usize),
}

/// A receiver of the cache.
pub struct CachedPart {
    pub layer: Layer,
    pub albedo: Vec3,
    /// Whether the placement reversed the winding of its triangles.
    pub is_mirrored: bool,
    pub receiver: Receiver,
}

/// What holds all used texels of a page.
#[derive(Clone, Copy)]
pub struct Extent {
    pub bounds: Bounds,
    pub normals: Cone,
}

impl Extent {
    /// That of a page.
    pub fn of(texels: &PageTexels) -> Self {
        let used = texels.positions.iter().zip(&texels.is_used);
        let used = used.filter_map(|(p, used)| used.then_some(*p));
        Self {
            bounds: used.fold(Bounds::NOTHING, Bounds::with),
            normals: Cone::of(texels),
        }
    }
}

/// All surfaces that receive light, and the normals of their vertices.
pub fn receivers(scene: &Scene) -> (Vec<CachedPart>, Vec<Vec<Vec3>>) {
    let phantoms = scene.phantom_parts.iter().enumerate();
    let phantoms = phantoms.filter(|(_, part)| !part.mirror);
    let virtual_parts = scene.virtual_parts.iter().enumerate();
    let all = virtual_parts
        .map(|(i, part)| (Layer::Virtual(i), part))
        .chain(phantoms.map(|(i, part)| (Layer::Phantom(i), part)));
    all.map(|(layer, part)| {
        let (positions, normals, indices) = placed(part);
        let cached = CachedPart {
            layer,
            albedo: part.material.mean_base_colour(),
            is_mirrored: part.world_from_part.determinant() < 0.0,
            receiver: Receiver::new(positions, &normals, indices),
        };
        (cached, normals)
    })
    .unzip()
}

/// Positions, normals and outward-facing triangles of a part in the world.
fn placed(part: &Part) -> (Vec<Vec3>, Vec<Vec3>, Vec<u32>) {
    let world = part.world_from_part;
    let normal_from_part = DMat3::from_mat4(world).inverse().transpose();
    let vertices = &part.mesh.vertices;
    let place = |p: Vec3| world.transform_point3(p.as_dvec3()).as_vec3();
    let turn = |n: Vec3| {
        (normal_from_part * n.as_dvec3())
            .normalize_or_zero()
            .as_vec3()
    };
    let mut indices = part.mesh.indices.clone();
    if world.determinant() < 0.0 {
        // A mirroring placement reverses the winding of triangles.
        indices.chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
    }
    (
        vertices.iter().map(|v| place(v.position)).collect(),
        vertices.iter().map(|v| turn(v.normal)).collect(),
        indices,
    )
}

/// A virtual part that moves, with its texels where they were placed first.
pub struct MovingReceiver {
    part: usize,
    part_from_first_world: DMat4,
    /// Pages by number.
    first: Vec<(usize, Arc<PageTexels>)>,
}

impl MovingReceiver {
    /// The moving parts of `scene` among `parts`.
    pub fn all(
        scene: &Scene,
        parts: &[CachedPart],
        layout: &Layout,
        texels: &[Arc<PageTexels>],
    ) -> Vec<Self> {
        let movers = scene.motions.parts.iter();
        let movers = movers.filter_map(|m| Some((m.index, scene.virtual_parts.get(m.index)?)));
        let pages = |part: usize| {
            let pages = layout.pages.iter().enumerate();
            let own = pages.filter(move |(_, p)| parts[p.receiver].layer == Layer::Virtual(part));
            own.map(|(p, _)| (p, texels[p].clone())).collect()
        };
        movers
            .map(|(part, placed)| Self {
                part,
                part_from_first_world: placed.world_from_part.inverse(),
                first: pages(part),
            })
            .collect()
    }

    /// Whether it is virtual part `part`.
    pub const fn is(&self, part: usize) -> bool {
        self.part == part
    }

    /// Numbers of its pages.
    pub fn pages(&self) -> impl Iterator<Item = usize> {
        self.first.iter().map(|(p, _)| *p)
    }

    /// Moves its texels with the part to `world`.
    pub fn place(&self, world: DMat4, texels: &mut [Arc<PageTexels>], extents: &mut [Extent]) {
        let moved = world * self.part_from_first_world;
        let turned = DMat3::from_mat4(moved).inverse().transpose();
        let turn = |n: Vec3| {
            (turned * n.as_dvec3())
                .normalize_or(glam::DVec3::Z)
                .as_vec3()
        };
        for (p, first) in &self.first {
            let page = Arc::make_mut(&mut texels[*p]);
            for (to, at) in page.positions.iter_mut().zip(&first.positions) {
                *to = moved.transform_point3(at.as_dvec3()).as_vec3();
            }
            for (to, n) in page.normals.iter_mut().zip(&first.normals) {
                *to = turn(*n);
            }
            page.plane = first.plane.map(turn);
            extents[*p] = Extent::of(page);
        }
    }
}
