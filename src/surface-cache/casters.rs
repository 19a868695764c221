//! The casters of a scene, and their depth maps for a light.

use crate::depth_map::{DepthMap, View};
use crate::layout::Bounds;
use glam::{DMat4, Vec2, Vec3};
use penumbra_lighting::DomeLight;
use penumbra_scene::{Motion, Part, Scene, Vertex};
use std::collections::HashMap;

/// Casters of one kind, in the world.
struct Set {
    positions: Vec<Vec3>,
    /// Three per triangle; first those of closed surfaces, of which back faces are left out.
    indices: [Vec<u32>; 2],
    /// Numbers of the outermost positions, to which maps are fitted.
    hull: Vec<u32>,
    moving: Vec<MovingCaster>,
}

/// A caster that moves.
struct MovingCaster {
    /// Number of the virtual part.
    part: usize,
    /// Its first position in the set.
    first: usize,
    /// Its positions, in its own frame.
    own: Vec<Vec3>,
}

/// The depth maps of one light, and buffers for drawing them.
pub struct LightMaps {
    is_compact: bool,
    maps: [DepthMap; 2],
    projected: Vec<(Vec2, f32)>,
}

impl LightMaps {
    fn new(size: usize, is_compact: bool) -> Self {
        Self {
            is_compact,
            maps: [DepthMap::new(size), DepthMap::new(size)],
            projected: Vec::new(),
        }
    }
}

/// The depth maps of a thread.
pub struct Maps {
    cell: LightMaps,
    compact: LightMaps,
}

impl Maps {
    /// Maps of `size` texels a side for compact lights; those of lights that stand for cells, whose
    /// penumbrae are wide, have half as many.
    pub fn new(size: usize) -> Self {
        Self {
            cell: LightMaps::new(size / 2, false),
            compact: LightMaps::new(size, true),
        }
    }

    /// The maps for a light of a kind.
    pub const fn of(&mut self, is_compact: bool) -> &mut LightMaps {
        if is_compact {
            &mut self.compact
        } else {
            &mut self.cell
        }
    }
}

/// Drawing a map, with the instructions that the processor has.
struct Drawing<'a> {
    set: &'a Set,
    view: &'a View,
    map: &'a mut DepthMap,
    projected: &'a mut Vec<(Vec2, f32)>,
}

impl pulp::WithSimd for Drawing<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self {
            set,
            view,
            map,
            projected,
        } = self;
        projected.clear();
        for p in &set.positions {
            projected.push(view.project(*p));
        }
        map.clear();
        let [closed, open] = &set.indices;
        map.draw(projected, closed, true);
        map.draw(projected, open, false);
        map.finish();
    }
}

/// Virtual casters and phantoms.
pub struct Casters {
    /// Virtual ones for lights that stand for cells, for compact ones; phantoms.
    sets: [Set; 3],
    bounds: Vec<Bounds>,
}

impl Casters {
    /// `casters` are the virtual parts as they cast shadows. The ground casts no shadow.
    /// `map_size` is that of the maps of compact lights; the smaller ones get coarser casters.
    pub fn new(scene: &Scene, casters: &[Part], map_size: usize) -> Self {
        let solid = scene.phantom_parts.iter().filter(|p| !is_ground(p, scene));
        let motion = |i: usize| {
            let movers = &scene.motions.parts;
            let mover = movers.iter().find(|mover| mover.index == i);
            mover.map(|mover| &mover.motion)
        };
        let own: Vec<_> = (casters.iter().enumerate())
            .map(|(i, part)| (part, motion(i)))
            .collect();
        let all = casters.iter().flat_map(positions_of);
        let all = all.fold(Bounds::NOTHING, Bounds::with);
        let half_a_texel = all.extent() / map_size as f32;
        let coarse: Vec<Part> = (casters.iter())
            .map(|part| Part {
                mesh: part.caster(half_a_texel),
                ..part.clone()
            })
            .collect();
        let moves = || own.iter().map(|(_, motion)| motion.is_some());
        Self {
            bounds: (own.iter())
                .map(|(part, motion)| swept(part, *motion))
                .collect(),
            sets: [
                Set::new(coarse.iter().zip(moves())),
                Set::new(casters.iter().zip(moves())),
                Set::new(solid.map(|part| (part, false))),
            ],
        }
    }

    /// Bounds of the virtual casters, one by one; of those that move, wherever they go.
    pub fn virtual_bounds(&self) -> &[Bounds] {
        &self.bounds
    }

    /// Moves a virtual part to `world`.
    pub fn place(&mut self, part: usize, world: DMat4) {
        for set in &mut self.sets[..2] {
            set.place(part, world);
        }
    }

    /// Draws the maps of a light: of virtual casters and of phantoms, where there are any.
    pub fn draw<'a>(
        &self,
        light: &DomeLight,
        to: &'a mut LightMaps,
    ) -> [Option<(&'a DepthMap, View)>; 2] {
        let [first, second] = &mut to.maps;
        let [coarse, fine, real] = &self.sets;
        let own = if to.is_compact { fine } else { coarse };
        [
            own.draw(light, first, &mut to.projected),
            real.draw(light, second, &mut to.projected),
        ]
    }
}

impl Set {
    /// Parts, each with whether it moves.
    fn new<'a>(parts: impl Iterator<Item = (&'a Part, bool)>) -> Self {
        let mut set = Self {
            positions: Vec::new(),
            indices: [Vec::new(), Vec::new()],
            hull: Vec::new(),
            moving: Vec::new(),
        };
        let mut still = Vec::new();
        for (number, (part, moves)) in parts.enumerate() {
            let first = set.positions.len() as u32;
            set.positions.extend(positions_of(part));
            let corners: Vec<Vec3> = positions_of(part).collect();
            let volume = closed_volume(&corners, &part.mesh.indices);
            let indices = &mut set.indices[usize::from(volume.is_none())];
            let at = indices.len();
            indices.extend(part.mesh.indices.iter().map(|i| i + first));
            if volume.is_some_and(|volume| volume < 0.0) {
                // Wound or placed inside out.
                indices[at..].chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
            }
            let numbers = first..set.positions.len() as u32;
            if moves {
                set.hull.extend(outermost(&set.positions, numbers));
                set.moving.push(MovingCaster {
                    part: number,
                    first: first as usize,
                    own: part.mesh.vertices.iter().map(|v| v.position).collect(),
                });
            } else {
                still.extend(numbers);
            }
        }
        set.hull
            .extend(outermost(&set.positions, still.iter().copied()));
        set
    }

    fn draw<'a>(
        &self,
        light: &DomeLight,
        map: &'a mut DepthMap,
        projected: &mut Vec<(Vec2, f32)>,
    ) -> Option<(&'a DepthMap, View)> {
        let view = View::fitted(self.outermost(), light, map.size())?;
        pulp::Arch::new().dispatch(Drawing {
            set: self,
            view: &view,
            map: &mut *map,
            projected,
        });
        Some((map, view))
    }
}

impl Set {
    fn place(&mut self, part: usize, world: DMat4) {
        if let Some(caster) = self.moving.iter().find(|caster| caster.part == part) {
            let to = self.positions[caster.first..].iter_mut();
            for (to, own) in to.zip(&caster.own) {
                *to = world.transform_point3(own.as_dvec3()).as_vec3();
            }
        }
    }

    fn outermost(&self) -> impl Iterator<Item = Vec3> + Clone {
        self.hull.iter().map(|i| self.positions[*i as usize])
    }
}

/// The volume that triangles enclose, negative if they are wound inwards; `None` if they are not
/// closed and evenly wound.
fn closed_volume(positions: &[Vec3], indices: &[u32]) -> Option<f32> {
    let key = |i: u32| {
        (positions[i as usize] + Vec3::ZERO)
            .to_array()
            .map(f32::to_bits)
    };
    let mut edges: HashMap<_, i32> = HashMap::with_capacity(indices.len());
    let mut volume = 0.0;
    let centre = positions.first()?;
    for t in indices.chunks_exact(3) {
        let [a, b, c] = [t[0], t[1], t[2]].map(|i| positions[i as usize] - centre);
        volume += a.dot(b.cross(c)) / 6.0;
        for (from, to) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])].map(|(a, b)| (key(a), key(b)))
        {
            let (edge, turn) = if from < to {
                ((from, to), 1)
            } else {
                ((to, from), -1)
            };
            *edges.entry(edge).or_default() += turn * i32::from(from != to);
        }
    }
    edges.values().all(|turns| *turns == 0).then_some(volume)
}

fn positions_of(part: &Part) -> impl Iterator<Item = Vec3> {
    let place = |p: Vec3| {
        part.world_from_part
            .transform_point3(p.as_dvec3())
            .as_vec3()
    };
    part.mesh.vertices.iter().map(move |v| place(v.position))
}

/// Instants at which the places of a moving part are looked at.
const INSTANTS: usize = 33;

/// Bounds of a part wherever its motion takes it.
fn swept(part: &Part, motion: Option<&Motion>) -> Bounds {
    let Some(motion) = motion else {
        return positions_of(part).fold(Bounds::NOTHING, Bounds::with);
    };
    let own = |p: Bounds, v: &Vertex| p.with(v.position);
    let own = part.mesh.vertices.iter().fold(Bounds::NOTHING, own);
    let instants = (0..INSTANTS).map(|i| motion.end() * i as f64 / (INSTANTS - 1) as f64);
    instants.fold(Bounds::NOTHING, |all, seconds| {
        let world = motion.at(seconds);
        let place = |p: Vec3| world.transform_point3(p.as_dvec3()).as_vec3();
        own.corners().fold(all, |all, p| all.with(place(p)))
    })
}

/// Number of directions along which [`outermost`] keeps a point.
const HULL_DIRECTIONS: usize = 512;

/// The points among `numbers` that bound them all from any direction, to within a small share of
/// their extent.
fn outermost(positions: &[Vec3], numbers: impl Iterator<Item = u32> + Clone) -> Vec<u32> {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let direction = |i: usize| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / HULL_DIRECTIONS as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Vec3::new(across * cos, across * sin, z)
    };
    let farthest = |i: usize| {
        let along = |k: &u32| positions[*k as usize].dot(direction(i));
        let numbers = numbers.clone();
        numbers.max_by(|a, b| along(a).total_cmp(&along(b)))
    };
    let mut found: Vec<u32> = (0..HULL_DIRECTIONS).filter_map(farthest).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Whether a part lies in the ground plane.
fn is_ground(part: &Part, scene: &Scene) -> bool {
    let Some(height) = scene.ground_height else {
        return false;
    };
    positions_of(part).all(|p| (f64::from(p.z) - height).abs() < 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_lighting::{LightKind, LightPlace};
    use penumbra_scene::primitives;

    #[test]
    fn back_faces_of_closed_surfaces_change_nothing() {
        let mesh = primitives::torus(0.09, 0.035, 60, 40);
        let positions: Vec<Vec3> = mesh.vertices.iter().map(|v| v.position).collect();
        let volume = closed_volume(&positions, &mesh.indices).expect("closed");
        let exact = 2.0 * std::f32::consts::PI.powi(2) * 0.09 * 0.035 * 0.035;
        assert!((volume / exact - 1.0).abs() < 0.02, "{volume} {exact}");
        let light = DomeLight {
            direction: Vec3::new(0.3, -0.5, 0.6).normalize(),
            irradiance: Vec3::ONE,
            angular_radius: 0.1,
            kind: LightKind::Cell,
            place: LightPlace::FAR,
        };
        let view = View::fitted(positions.iter().copied(), &light, 64).expect("points");
        let corners: Vec<_> = positions.iter().map(|p| view.project(*p)).collect();
        let [front, all] = [true, false].map(|closed| {
            let mut map = DepthMap::new(64);
            map.draw(&corners, &mesh.indices, closed);
            (0..64 * 64)
                .map(|k| [k % 64, k / 64].map(|x| x as f32 + 0.5))
                .map(|at| map.nearest(pulp::Scalar::new(), at))
                .collect::<Vec<f32>>()
        });
        assert!(all.iter().filter(|z| z.is_finite()).count() > 500);
        assert!(front == all);
    }

    #[test]
    fn open_and_mirrored_surfaces_are_known() {
        let square = primitives::plane(1.0, 1.0);
        let positions: Vec<Vec3> = square.vertices.iter().map(|v| v.position).collect();
        assert_eq!(closed_volume(&positions, &square.indices), None);
        let cube = primitives::cuboid(Vec3::ONE);
        let mirrored: Vec<Vec3> = cube
            .vertices
            .iter()
            .map(|v| v.position * Vec3::new(-1.0, 1.0, 1.0))
            .collect();
        let volume = closed_volume(&mirrored, &cube.indices).expect("closed");
        assert!((volume + 1.0).abs() < 1e-5, "{volume}");
    }
}
