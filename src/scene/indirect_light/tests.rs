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
    before.update(&lighting(5), none, &[]);
    before.update(&lighting(5), none, &[]);
    assert_eq!(before.light().generation, 1);
    before.update(&lighting(6), none, &[]);
    assert_eq!(before.light().generation, 2);
    let mut after = solver(0.2);
    after.follow(&before);
    after.update(&lighting(6), none, &[]);
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
        solver.update(&lighting(generation), &[], &[]);
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

/// Irradiance on the ground at a distance from the edge at x = 0.1: the mean over 2 cm, because a texel has
/// few rays.
fn on_ground_beside(light: &IndirectLight, distance: f32) -> f32 {
    let size = (light.high - light.low).truncate();
    let along = (0..20).map(|k| 0.001 * k as f32 - 0.01);
    let at = along.map(|y| (glam::Vec2::new(0.1 + distance, y) - light.low.truncate()) / size);
    let value = |at| light.on_ground.value(&light.change.ground, at);
    at.map(|at| value(at).expect("a grid").x).sum::<f32>() / 20.0
}

#[test]
fn inside_of_an_object_does_not_light_the_ground_beside_it() {
    let height = 0.1_f32;
    let mesh = primitives::cuboid(Vec3::new(0.2, 0.2, height));
    let scene = Scene {
        virtual_parts: vec![part_of(mesh, 0.0, 1.0, DMat4::IDENTITY)],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &scene.virtual_parts).unwrap();
    solver.update(&lighting(1), &[], &[]);
    for beside in [0.004_f32, 0.01, 0.02] {
        // A long wall.
        let cosine = beside / beside.hypot(height);
        let expected = 0.5 * std::f32::consts::PI * (1.0 - cosine);
        let found = on_ground_beside(solver.light(), beside);
        assert!(
            (found / expected - 1.0).abs() < 0.15,
            "{beside}: {found} {expected}"
        );
    }
}

#[test]
fn ground_resolves_the_light_below_the_edge_of_an_object() {
    let height = 0.012_f32;
    let plate = DMat4::from_translation(glam::DVec3::Z * f64::from(height))
        * DMat4::from_rotation_x(std::f64::consts::PI);
    let scene = Scene {
        virtual_parts: vec![part_of(primitives::plane(0.2, 0.2), 0.0, 1.0, plate)],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &scene.virtual_parts).unwrap();
    solver.update(&lighting(1), &[], &[]);
    let mean = |beside: f32| on_ground_beside(solver.light(), beside);
    for beside in [-0.03_f32, -0.01, 0.0, 0.01, 0.03] {
        // A plate that is large beside its height.
        let sine = beside / beside.hypot(height);
        let expected = 0.5 * std::f32::consts::PI * (1.0 - sine);
        let found = mean(beside);
        assert!(
            (found - expected).abs() < 0.2,
            "{beside}: {found} {expected}"
        );
    }
}

/// Irradiance at `p` on a surface that faces −X, by the ground under `lamp`, which reflects
/// `albedo`: the integral over the solver's region.
fn from_lit_ground(p: Vec3, lamp: &PlacedLamp, albedo: f32, [low, high]: [Vec3; 2]) -> f32 {
    let step = (high - low).truncate() / 200.0;
    let each = (0..200 * 200).map(|i| {
        let at = glam::Vec2::new((i % 200) as f32, (i / 200) as f32) + 0.5;
        let q = (low.truncate() + at * step).extend(0.0);
        let (to_lamp, to_p) = (lamp.position - q, p - q);
        let arriving = lamp.intensity.x * to_lamp.z / to_lamp.length_squared().powf(1.5);
        let cosines = to_p.x.max(0.0) * to_p.z / to_p.length_squared().powi(2);
        arriving * albedo / std::f32::consts::PI * cosines * step.x * step.y
    });
    each.sum()
}

#[test]
fn ground_passes_the_light_of_a_lamp_on() {
    let wall = part_of(
        primitives::cuboid(Vec3::new(0.02, 0.4, 0.3)),
        0.5,
        0.0,
        DMat4::from_translation(glam::DVec3::new(0.3, 0.0, 0.15)),
    );
    let lamp = PlacedLamp {
        position: Vec3::new(0.1, 0.0, 0.2),
        direction: Vec3::NEG_Z,
        intensity: Vec3::splat(0.1),
        cone: None,
        area: None,
    };
    let key = crate::virtual_light::VirtualLightKey {
        seconds: 0.0,
        position: lamp.position.as_dvec3(),
        target: None,
        gain: 1.0,
    };
    let scene = Scene {
        phantom_parts: vec![wall],
        ground_height: Some(0.0),
        lamps: vec![crate::VirtualLight {
            name: "lamp".into(),
            kind: crate::VirtualLightKind::Point,
            intensity: lamp.intensity,
            screen: None,
            keys: vec![key],
            repeat: None,
        }],
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &[]).unwrap();
    let mut lighting = lighting(1);
    let (open, albedo) = (2.0, 0.4);
    lighting.ground_radiance = Vec3::splat(albedo * open / std::f32::consts::PI);
    lighting.lights = vec![penumbra_lighting::DomeLight {
        direction: Vec3::Z,
        irradiance: Vec3::splat(open),
        angular_radius: 0.1,
        kind: penumbra_lighting::LightKind::Cell,
        place: penumbra_lighting::LightPlace::default(),
    }];
    let dark = [[Vec3::ZERO; 6]];
    solver.update(&lighting, &dark, &[lamp]);
    let light = solver.light();
    let [nx, ny, nz] = VOLUME_SIZE;
    let (x, y, z) = (5, ny / 2, 2);
    let cells = Vec3::new(nx as f32, ny as f32, nz as f32);
    let cell = Vec3::new(x as f32, y as f32, z as f32) + 0.5;
    let p = light.low + (light.high - light.low) * cell / cells;
    let found = light.change.volume[1][(x + nx * (y + ny * z)) as usize].x;
    let expected = from_lit_ground(p, &lamp, albedo, [light.low, light.high]);
    assert!(
        (found / expected - 1.0).abs() < 0.12,
        "{found} {expected} at {p}"
    );
    // Without virtual lights, nothing changes.
    solver.settle(&lighting, &dark, &[]);
    let change = &solver.light().change;
    assert!(change.volume.iter().flatten().all(|e| *e == Vec3::ZERO));
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
