//! The casters of a scene, and their depth maps for a light.

use crate::depth_map::{DepthMap, View};
use crate::layout::Bounds;
use glam::{DMat4, Vec2, Vec3};
use penumbra_scene::{Motion, Part, Scene, Vertex};

/// Casters of one kind, in the world.
struct Set {
    positions: Vec<Vec3>,
    indices: Vec<u32>,
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
    maps: [DepthMap; 2],
    projected: Vec<(Vec2, f32)>,
}

impl LightMaps {
    fn new(size: usize) -> Self {
        Self {
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
            cell: LightMaps::new(size / 2),
            compact: LightMaps::new(size),
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

/// Virtual casters and phantoms.
pub struct Casters {
    sets: [Set; 2],
    bounds: Vec<Bounds>,
}

impl Casters {
    /// `casters` are the virtual parts as they cast shadows. The ground casts no shadow.
    pub fn new(scene: &Scene, casters: &[Part]) -> Self {
        let solid = scene.phantom_parts.iter().filter(|p| !is_ground(p, scene));
        let motion = |i: usize| {
            let movers = &scene.motions.parts;
            let mover = movers.iter().find(|mover| mover.index == i);
            mover.map(|mover| &mover.motion)
        };
        let own: Vec<_> = (casters.iter().enumerate())
            .map(|(i, part)| (part, motion(i)))
            .collect();
        let bounds = own.iter().map(|(part, motion)| swept(part, *motion));
        Self {
            bounds: bounds.collect(),
            sets: [
                Set::new(own.iter().map(|(part, motion)| (*part, motion.is_some()))),
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
        let set = &mut self.sets[0];
        if let Some(caster) = set.moving.iter().find(|caster| caster.part == part) {
            let to = set.positions[caster.first..].iter_mut();
            for (to, own) in to.zip(&caster.own) {
                *to = world.transform_point3(own.as_dvec3()).as_vec3();
            }
        }
    }

    /// Draws the maps of a light: of virtual casters and of phantoms, where there are any.
    pub fn draw<'a>(
        &self,
        to_light: Vec3,
        to: &'a mut LightMaps,
    ) -> [Option<(&'a DepthMap, View)>; 2] {
        let [first, second] = &mut to.maps;
        let [own, real] = &self.sets;
        [
            own.draw(to_light, first, &mut to.projected),
            real.draw(to_light, second, &mut to.projected),
        ]
    }
}

impl Set {
    /// Parts, each with whether it moves.
    fn new<'a>(parts: impl Iterator<Item = (&'a Part, bool)>) -> Self {
        let mut set = Self {
            positions: Vec::new(),
            indices: Vec::new(),
            hull: Vec::new(),
            moving: Vec::new(),
        };
        let mut still = Vec::new();
        for (number, (part, moves)) in parts.enumerate() {
            let first = set.positions.len() as u32;
            set.positions.extend(positions_of(part));
            set.indices
                .extend(part.mesh.indices.iter().map(|i| i + first));
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
        to_light: Vec3,
        map: &'a mut DepthMap,
        projected: &mut Vec<(Vec2, f32)>,
    ) -> Option<(&'a DepthMap, View)> {
        let view = View::fitted(self.outermost(), to_light, map.size())?;
        projected.clear();
        projected.extend(self.positions.iter().map(|p| view.project(*p)));
        map.clear();
        map.draw(projected, &self.indices);
        map.finish();
        Some((map, view))
    }
}

impl Set {
    fn outermost(&self) -> impl Iterator<Item = Vec3> + Clone {
        self.hull.iter().map(|i| self.positions[*i as usize])
    }
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
