//! The surfaces that mirror rays can meet: virtual parts and phantoms, with what they reflect.

use super::super::cover::{Corners, corners};
use super::super::mesh_buffers::is_ground;
use super::bvh::{Bvh, Hits, LANES, NOTHING, Rays};
use glam::{DMat4, Mat3, Mat4, Vec3};
use penumbra_lighting::lobes::{Family, own_width, phong_parameter};
use penumbra_scene::indirect_light::solid_phantoms;
use penumbra_scene::{Material, Part, Scene};

/// Width of a lobe, as GGX's α, above which a surface is too rough to mirror anything.
const WIDEST: f32 = 0.36;
/// Ratio of F0 to that width below which what is mirrored is too weak or too blurred to be worth its
/// rays: a dielectric of roughness 0.14, or a metal that is a quarter as bright at 0.35.
const CLEAREST: f32 = 2.0;
/// F0 of dielectrics with a refractive index of 1.5.
const DIELECTRIC: f32 = 0.04;
/// α of the GGX lobe whose half vectors have the same median angle to the normal as those of
/// Phong's lobe cosᵉ about the mirror direction, times √(e + 1): √(ln 4) / 2.
const PHONG: f32 = 0.589;
/// Distance of a ray's origin from its surface, as a share of the extent of the virtual objects.
const LIFT: f32 = 1e-4;

/// What a surface does with light, averaged over its textures.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Albedo of diffuse reflection.
    pub diffuse: Vec3,
    /// Specular reflectance at normal incidence.
    pub f0: Vec3,
    /// At grazing incidence.
    pub f90: f32,
    /// Radiance that it emits.
    pub emissive: Vec3,
    /// α of the GGX lobe that is as wide.
    pub width: f32,
    /// Whether a ray is traced where the camera sees it.
    pub is_glossy: bool,
    /// Its number among the phantoms without the ground.
    pub phantom: Option<u32>,
}

impl Surface {
    fn virtual_one(material: &Material) -> Self {
        let base = material.mean_base_colour();
        let metallic = material.metallic.clamp(0.0, 1.0);
        let dielectric = DIELECTRIC * material.specular;
        let (diffuse, f0, f90, width) = match &material.phong {
            Some(phong) => {
                let parameter = phong_parameter(phong.exponent);
                let width = PHONG * own_width(Family::Phong, parameter);
                (base, phong.specular, 0.0, width)
            }
            None => {
                let f0 = Vec3::splat(dielectric).lerp(base, metallic);
                let f90 = if f0.max_element() > 0.0 { 1.0 } else { 0.0 };
                let width = own_width(Family::Ggx, material.roughness);
                (base * (1.0 - metallic), f0, f90, width)
            }
        };
        Self {
            diffuse,
            f0,
            f90,
            emissive: material.emissive,
            width,
            is_glossy: width <= WIDEST && f0.max_element() >= CLEAREST * width,
            phantom: None,
        }
    }

    fn real_one(part: &Part, number: u32) -> Self {
        let albedo = part.albedo.unwrap_or(Vec3::ONE);
        Self {
            diffuse: Vec3::ZERO,
            f0: if part.mirror { albedo } else { Vec3::ZERO },
            f90: 0.0,
            emissive: Vec3::ZERO,
            width: 0.0,
            is_glossy: part.mirror,
            phantom: Some(number),
        }
    }

    /// Specular reflectance at an angle of incidence with this cosine (Schlick 1994).
    pub fn fresnel(&self, cosine: f32) -> Vec3 {
        let grazing = (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        self.f0 + (Vec3::splat(self.f90) - self.f0).max(Vec3::ZERO) * grazing
    }
}

/// A triangle of a surface.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// At its corners, unit length.
    normals: [Vec3; 3],
    /// Its own, unit length.
    normal: Vec3,
    /// See [`Met::curvature`].
    curvature: f32,
    surface: u32,
}

/// Triangles that move together.
#[derive(Debug, Default)]
struct Body {
    bvh: Bvh,
    faces: Vec<Face>,
}

impl Body {
    /// Parts with the number of their surface, in the world or, as it is, in their own frame.
    fn new<'a>(parts: impl Iterator<Item = (&'a Part, u32, DMat4)>) -> Self {
        let mut corners = Vec::new();
        let mut faces = Vec::new();
        for (part, surface, place) in parts {
            let normal_from_part = Mat3::from_mat4(place.as_mat4()).inverse().transpose();
            for ids in part.mesh.indices.chunks_exact(3) {
                let [a, b, c] = [0, 1, 2].map(|k| part.mesh.vertices[ids[k] as usize]);
                let own = [a, b, c].map(|v| place.transform_point3(v.position.as_dvec3()));
                let own = own.map(|p| p.as_vec3());
                let normal = (own[1] - own[0]).cross(own[2] - own[0]).normalize_or_zero();
                if normal == Vec3::ZERO || !own.iter().all(|p| p.is_finite()) {
                    continue;
                }
                let normals = [a, b, c].map(|v| (normal_from_part * v.normal).normalize_or(normal));
                corners.push(own);
                faces.push(Face {
                    normals,
                    normal,
                    curvature: curvature(own, normals),
                    surface,
                });
            }
        }
        Self {
            bvh: Bvh::new(&corners),
            faces,
        }
    }
}

/// A virtual part that moves.
#[derive(Debug)]
struct Mover {
    part: usize,
    body: Body,
    own_from_world: Mat4,
}

/// A point that a ray meets.
#[derive(Clone, Copy, Debug)]
pub struct Met<'a> {
    /// Distance in lengths of the ray's direction.
    pub distance: f32,
    /// The triangle's own unit normal, towards the ray's origin.
    pub normal: Vec3,
    /// Interpolated between its corners, on the same side.
    pub shading_normal: Vec3,
    /// By how much the normal turns along the surface, radians a metre.
    pub curvature: f32,
    pub surface: &'a Surface,
}

/// All surfaces around the virtual objects.
#[derive(Debug)]
pub struct NearbyScene {
    surfaces: Vec<Surface>,
    still: Body,
    moving: Vec<Mover>,
    /// Phantoms alone.
    real: Bvh,
    /// The boxes around real mirrors, world.
    pub mirrors: Vec<Corners>,
    /// Height of the ground, metres.
    pub ground: Option<f32>,
    /// Distance of a ray's origin from its surface, metres.
    pub lift: f32,
}

impl NearbyScene {
    /// The surfaces of `scene`; `None` if it has no virtual part, or neither a glossy one nor a real
    /// mirror. Parts whose texture cuts holes are left out.
    pub fn new(scene: &Scene) -> Option<Self> {
        let parts = &scene.virtual_parts;
        let mut surfaces: Vec<Surface> = (parts.iter())
            .map(|part| Surface::virtual_one(&part.material))
            .collect();
        let solid: Vec<&Part> = solid_phantoms(scene).collect();
        surfaces.extend(solid.iter().zip(0..).map(|(p, i)| Surface::real_one(p, i)));
        if parts.is_empty() || !surfaces.iter().any(|surface| surface.is_glossy) {
            return None;
        }
        let first_real = parts.len() as u32;
        let real = || {
            let numbered = solid.iter().zip(first_real..);
            let standing = numbered.filter(|(part, _)| !is_ground(part, scene));
            standing.map(|(part, i)| (*part, i, part.world_from_part))
        };
        let numbered = parts.iter().zip(0..);
        let opaque = numbered.filter(|(part, _)| part.material.alpha_cutoff == 0.0);
        let moves = |i: u32| {
            let mut movers = scene.motions.parts.iter();
            movers.any(|mover| mover.index == i as usize)
        };
        let (movers, still): (Vec<_>, Vec<_>) = opaque.partition(|(_, i)| moves(*i));
        let still = still.into_iter().map(|(p, i)| (p, i, p.world_from_part));
        let moving = movers.into_iter().map(|(part, i)| Mover {
            part: i as usize,
            body: Body::new(std::iter::once((part, i, DMat4::IDENTITY))),
            own_from_world: part.world_from_part.inverse().as_mat4(),
        });
        Some(Self {
            surfaces,
            still: Body::new(still.chain(real())),
            moving: moving.collect(),
            real: Body::new(real()).bvh,
            mirrors: real()
                .filter_map(|(part, ..)| box_of_mirror(part))
                .collect(),
            ground: scene.ground_height.map(|height| height as f32),
            lift: LIFT * extent(parts),
        })
    }

    /// Moves a moving virtual part to `world`.
    pub fn place(&mut self, part: usize, world: DMat4) {
        if let Some(mover) = self.moving.iter_mut().find(|mover| mover.part == part) {
            mover.own_from_world = world.inverse().as_mat4();
        }
    }

    /// What each ray meets first, nearer than `farthest` lengths of its direction.
    pub fn nearest(&self, rays: &Rays, farthest: [f32; LANES]) -> [Option<Met<'_>>; LANES] {
        let mut hits = Hits::within(farthest);
        self.still.bvh.nearest(rays, &mut hits);
        let mut found: [Option<Met<'_>>; LANES] =
            std::array::from_fn(|i| self.met(&self.still, &hits, (rays, i), Mat3::IDENTITY));
        for mover in &self.moving {
            let own = transformed(rays, &mover.own_from_world);
            hits.forget();
            mover.body.bvh.nearest(&own, &mut hits);
            let world_from_normal = Mat3::from_mat4(mover.own_from_world).transpose();
            for (i, found) in found.iter_mut().enumerate() {
                let nearer = self.met(&mover.body, &hits, (rays, i), world_from_normal);
                *found = nearer.or(*found);
            }
        }
        found
    }

    /// Whether phantoms block each ray before `farthest` lengths of its direction.
    pub fn is_hidden(&self, rays: &Rays, farthest: [f32; LANES]) -> [bool; LANES] {
        let mut hits = Hits::within(farthest);
        self.real.nearest(rays, &mut hits);
        std::array::from_fn(|lane| hits.triangle(lane) != NOTHING)
    }

    fn met<'a>(
        &'a self,
        body: &Body,
        hits: &Hits,
        (rays, i): (&Rays, usize),
        world_from_normal: Mat3,
    ) -> Option<Met<'a>> {
        let face = body.faces.get(hits.triangle(i) as usize)?;
        let direction = Vec3::from_array(rays.direction.map(|axis| axis[i]));
        let (u, v) = (hits.u[i], hits.v[i]);
        let [a, b, c] = face.normals;
        let facing = |n: Vec3, towards: Vec3| if n.dot(towards) < 0.0 { -n } else { n };
        let normal = facing((world_from_normal * face.normal).normalize(), -direction);
        let between = world_from_normal * (a * (1.0 - u - v) + b * u + c * v);
        Some(Met {
            distance: hits.distance[i],
            normal,
            shading_normal: facing(between.normalize_or(normal), normal),
            curvature: face.curvature * world_from_normal.x_axis.length(),
            surface: &self.surfaces[face.surface as usize],
        })
    }
}

/// The box around a phantom, if it is a mirror.
fn box_of_mirror(part: &Part) -> Option<Corners> {
    let vertices = part.mesh.vertices.iter().filter(|_| part.mirror);
    corners(
        vertices.map(|v| v.position.as_dvec3()),
        part.world_from_part,
    )
}

/// The most by which the normal turns along an edge, radians a metre.
fn curvature(corners: [Vec3; 3], normals: [Vec3; 3]) -> f32 {
    let along = |a: usize, b: usize| {
        let length = corners[a].distance(corners[b]);
        normals[a].distance(normals[b]) / length.max(1e-9)
    };
    along(0, 1).max(along(1, 2)).max(along(2, 0))
}

fn transformed(rays: &Rays, by: &Mat4) -> Rays {
    let mut own = *rays;
    for i in 0..LANES {
        let origin = by.transform_point3(Vec3::from_array(rays.origin.map(|axis| axis[i])));
        let direction = by.transform_vector3(Vec3::from_array(rays.direction.map(|axis| axis[i])));
        for axis in 0..3 {
            own.origin[axis][i] = origin[axis];
            own.direction[axis][i] = direction[axis];
        }
    }
    own
}

/// The longest side of the box around `parts`, metres.
fn extent(parts: &[Part]) -> f32 {
    let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let points = parts.iter().flat_map(|part| {
        let place = |p: Vec3| {
            part.world_from_part
                .transform_point3(p.as_dvec3())
                .as_vec3()
        };
        part.mesh.vertices.iter().map(move |v| place(v.position))
    });
    let (low, high) = points.fold(nothing, |(low, high), p| (low.min(p), high.max(p)));
    (high - low).max_element().max(0.0)
}
