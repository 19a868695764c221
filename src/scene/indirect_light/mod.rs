//! Indirect light: light that virtual objects reflect onto the real scene and onto each other,
//! and light of the ground and of phantoms that virtual objects block.
//!
//! Visibility between surfaces is found once, by ray casting: it does not depend on the light. For
//! every new state of the light the surfels' radiosity follows by sums over these lists
//! (progressive radiosity, Cohen et al. 1988, on point samples; one more bounce each time), and
//! from it the change of irradiance on the ground (a grid) and in the air around the objects (a
//! volume of ambient cubes, McTaggart 2004), and the light between virtual surfaces (points on them,
//! in a grid).

mod blend;
mod directions;
mod ground;
mod obstacles;
mod receivers;
mod region;
mod result;
mod sampling;
mod shares;
mod sides;
mod surface;
mod surface_grid;
mod surfels;
mod volume;

pub use blend::IndirectLightBlender;
pub use directions::{AXES, side_of};
pub use obstacles::solid_phantoms;
pub use result::{
    GROUND_SIDE, IndirectLight, Irradiance, NearbyRadiance, PhantomRadiance, VOLUME_SIZE,
};
pub use surface_grid::{GRID_SIDE, SurfaceGrid, SurfaceIrradiance};

use crate::mesh::Part;
use crate::scene::Scene;
use directions::Directions;
use glam::Vec3;
use ground::GroundGrid;
use obstacles::Obstacles;
use penumbra_lighting::Lighting;
use penumbra_lighting::compact_source_specular::CompleteMap;
use receivers::Receivers;
use region::Region;
use shares::DistantLight;
use sides::Sides;
use surfels::Surfels;
use volume::Volume;

/// Number of bounces after which indirect light no longer changes visibly.
const BOUNCES: usize = 3;

/// Visibility around the virtual objects, and the indirect light of the last update.
pub struct IndirectLightSolver {
    surfels: Surfels,
    sides: Sides,
    ground: GroundGrid,
    volume: Volume,
    receivers: Receivers,
    obstacles: Obstacles,
    directions: Directions,
    light: IndirectLight,
    /// Generation of the lighting of the last update.
    lit_by: Option<u64>,
    has_ground: bool,
}

impl IndirectLightSolver {
    /// Casts all rays. `casters` are the scene's virtual parts as they cast shadows. `None` without
    /// virtual parts.
    #[must_use]
    pub fn new(scene: &Scene, casters: &[Part]) -> Option<Self> {
        let region = Region::around(casters, scene.ground_height)?;
        let obstacles = Obstacles::new(scene, casters);
        let directions = Directions::new();
        let moves = !scene.motions.parts.is_empty();
        let surfels = Surfels::new(casters, &obstacles, &directions, &region, moves);
        let phantoms: Vec<Part> = solid_phantoms(scene).cloned().collect();
        let sides = Sides::new(&phantoms, &surfels, &obstacles, &directions, &region);
        let ground = GroundGrid::new(&obstacles, &surfels, &directions, &region);
        let volume = Volume::new(&obstacles, &surfels, &directions, &region);
        // Where something moves, a new solver is made every half second, and frames wait for it: too
        // often for the light between virtual surfaces.
        let still = casters.iter().filter(|_| !moves);
        let receivers = Receivers::new(still, &surfels, &obstacles, &region);
        let mut light = IndirectLight {
            low: region.low,
            high: region.high,
            ..IndirectLight::default()
        };
        if !moves {
            (light.nearby.points, light.nearby.spacing) = surfels.places();
        }
        Some(Self {
            surfels,
            sides,
            ground,
            volume,
            receivers,
            obstacles,
            directions,
            light,
            lit_by: None,
            has_ground: scene.ground_height.is_some(),
        })
    }

    /// Continues the generations of the `before` scene's solver: the light of a changed scene differs
    /// under the same lighting, too.
    pub fn follow(&mut self, before: &Self) {
        self.light.generation = before.light.generation;
    }

    /// Whether the last update was for another generation of `lighting`.
    #[must_use]
    pub fn is_outdated(&self, lighting: &Lighting) -> bool {
        self.lit_by != Some(lighting.generation)
    }

    /// Computes the indirect light under `lighting` with all bounces at once, for a solver that
    /// replaces another while frames are shown.
    pub fn settle(&mut self, lighting: &Lighting, phantoms: &PhantomRadiance) {
        for _ in 0..BOUNCES {
            self.lit_by = None;
            self.update(lighting, phantoms);
        }
    }

    /// Computes the indirect light under `lighting`, with one more bounce. Does nothing if it is up to
    /// date.
    pub fn update(&mut self, lighting: &Lighting, phantoms: &PhantomRadiance) {
        if !self.is_outdated(lighting) {
            return;
        }
        self.lit_by = Some(lighting.generation);
        self.light.generation += 1;
        self.directions.set_light(lighting);
        let floor = if self.has_ground {
            lighting.ground_radiance
        } else {
            Vec3::ZERO
        };
        let light = DistantLight {
            radiance: CompleteMap::new(&lighting.radiance),
            floor,
            phantoms,
        };
        self.ground.update(&self.directions);
        let shares = &self.ground.shares;
        self.sides
            .update(&self.surfels, shares, &self.directions, &light);
        self.surfels.update(
            &self.directions,
            shares,
            &self.sides.shares,
            &light,
            &self.obstacles,
        );
        self.ground
            .gather(&self.surfels, &self.sides.shares, &light, &mut self.light);
        self.volume.gather(
            &self.surfels,
            shares,
            &self.sides.shares,
            &self.directions,
            &light,
            &mut self.light,
        );
        self.receivers.gather(
            &self.surfels,
            shares,
            &self.sides.shares,
            &light,
            &mut self.light.on_virtual,
        );
        let nearby = &mut self.light.nearby;
        if !nearby.points.is_empty() {
            self.surfels.write(nearby);
        }
        let sides = |part: usize| {
            std::array::from_fn(|side| self.sides.shares.radiance((6 * part + side) as u32, &light))
        };
        nearby.phantoms.clear();
        nearby.phantoms.extend((0..phantoms.len()).map(sides));
        nearby.ground.clone_from(&self.ground.shares.0);
    }

    /// The indirect light of the last update.
    #[must_use]
    pub const fn light(&self) -> &IndirectLight {
        &self.light
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::casters::casters;
    use crate::mesh::Material;
    use crate::primitives;
    use glam::DMat4;
    use penumbra_interface::MonotonicTime;
    use penumbra_lighting::{CubeMap, Harmonics, Lighting};
    use std::sync::Arc;

    fn solver(size: f32) -> IndirectLightSolver {
        let part = Part {
            name: "box".into(),
            mesh: Arc::new(primitives::cuboid(Vec3::splat(size))),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::IDENTITY,
            mirror: false,
            albedo: None,
        };
        let scene = Scene {
            virtual_parts: vec![part],
            ground_height: Some(0.0),
            ..Scene::default()
        };
        IndirectLightSolver::new(&scene, &casters(&scene)).unwrap()
    }

    fn lighting(generation: u64) -> Lighting {
        Lighting {
            captured_at: MonotonicTime::from_nanos(0),
            generation,
            radiance: Arc::new(CubeMap {
                size: 1,
                levels: vec![vec![[1.0; 3]; 6]],
                ..CubeMap::default()
            }),
            irradiance: Harmonics::default(),
            lights: Vec::new(),
            ground_radiance: Vec3::ZERO,
            faces: None,
        }
    }

    #[test]
    fn changed_scene_has_a_new_generation_under_the_same_lighting() {
        let none: &PhantomRadiance = &[];
        let mut before = solver(0.1);
        before.update(&lighting(5), none);
        before.update(&lighting(5), none);
        assert_eq!(before.light().generation, 1);
        before.update(&lighting(6), none);
        assert_eq!(before.light().generation, 2);
        let mut after = solver(0.2);
        after.follow(&before);
        after.update(&lighting(6), none);
        assert_eq!(after.light().generation, 3);
        assert!(after.light().high.x > before.light().high.x);
    }

    fn part_of(mesh: crate::mesh::Mesh, grey: f32, emissive: f32, place: DMat4) -> Part {
        let material = Material {
            base_colour: Vec3::splat(grey).extend(1.0),
            metallic: 0.0,
            specular: 0.0,
            emissive: Vec3::splat(emissive),
            ..Material::default()
        };
        Part {
            name: "part".into(),
            mesh: Arc::new(mesh),
            material: Arc::new(material),
            world_from_part: place,
            mirror: false,
            albedo: None,
        }
    }

    /// Light on virtual surfaces without a ground and in the dark, after `bounces`.
    fn on_virtual(parts: Vec<Part>, bounces: u64) -> SurfaceIrradiance {
        let scene = Scene {
            virtual_parts: parts,
            ..Scene::default()
        };
        let mut solver = IndirectLightSolver::new(&scene, &scene.virtual_parts).unwrap();
        for generation in 1..=bounces {
            solver.update(&lighting(generation), &[]);
        }
        solver.light().on_virtual.clone()
    }

    #[test]
    fn parallel_squares_exchange_their_form_factor() {
        let faces_down = DMat4::from_rotation_x(std::f64::consts::PI);
        let upper = DMat4::from_translation(glam::DVec3::Z) * faces_down;
        let light = on_virtual(
            vec![
                part_of(primitives::plane(1.0, 1.0), 0.0, 0.0, DMat4::IDENTITY),
                part_of(primitives::plane(1.0, 1.0), 0.0, 1.0, upper),
            ],
            1,
        );
        let at = |k: usize| Vec3::new((k % 10) as f32 - 4.5, (k / 10) as f32 - 4.5, 0.0) * 0.1;
        let mean = (0..100).map(|k| light.on(at(k), Vec3::Z).x).sum::<f32>() / 100.0;
        // Unit squares at distance 1 (Howell, configuration C-11).
        let expected = 0.199_82 * std::f32::consts::PI;
        assert!((mean / expected - 1.0).abs() < 0.03, "{mean} {expected}");
    }

    #[test]
    fn closed_cavity_neither_gains_nor_loses_energy() {
        let mut cavity = primitives::cuboid(Vec3::ONE);
        cavity
            .indices
            .chunks_exact_mut(3)
            .for_each(|t| t.swap(1, 2));
        for vertex in &mut cavity.vertices {
            vertex.normal = -vertex.normal;
        }
        // Emission 1 - albedo makes the radiance 1 everywhere.
        let light = on_virtual(vec![part_of(cavity, 0.5, 0.5, DMat4::IDENTITY)], 16);
        let places = [
            (Vec3::new(0.1, 0.2, 0.0), Vec3::Z),
            (Vec3::new(0.45, -0.3, 1.0), Vec3::NEG_Z),
            (Vec3::new(0.5, 0.0, 0.5), Vec3::NEG_X),
        ];
        for (p, n) in places {
            let found = light.on(p, n);
            assert!((found.x - std::f32::consts::PI).abs() < 0.03, "{found}");
            assert!(found.w > 0.99, "{found}");
        }
    }

    #[test]
    fn convex_object_gives_itself_no_light() {
        let ball = primitives::sphere(0.1, 24, 16);
        let light = on_virtual(vec![part_of(ball, 0.8, 1.0, DMat4::IDENTITY)], 3);
        assert!(light.values.iter().all(|value| *value == Vec3::ZERO));
        assert!(light.on(Vec3::Z * 0.1, Vec3::Z).w > 0.99);
    }
}
