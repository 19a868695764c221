use super::*;
use crate::casters::casters;
use crate::mesh::Material;
use crate::primitives;
use glam::DMat4;
use penumbra_interface::MonotonicTime;
use penumbra_lighting::compact_source_specular::excesses;
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::lobes::widths;
use penumbra_lighting::place::Seen;
use penumbra_lighting::prefilter::{Prefilter, level_count};
use penumbra_lighting::{CubeMap, Harmonics, LightPlace, Lighting};
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

static EVEN: GroundBrightness = GroundBrightness {
    low: glam::Vec2::ZERO,
    edge: 1.0,
    side: 0,
    cells: Vec::new(),
};

/// Phantoms of this radiance on an even ground.
fn real(phantoms: &PhantomRadiance) -> RealSurfaces<'_> {
    let ground = &EVEN;
    RealSurfaces { phantoms, ground }
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
    let none = real(&[]);
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
        solver.update(&lighting(generation), real(&[]), &[]);
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
    let along = (0..20).map(|k| glam::Vec2::new(0.1 + distance, 0.001 * k as f32 - 0.01));
    let each = along.map(|place| on_ground(light, &light.change.ground, place));
    each.sum::<f32>() / 20.0
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
    solver.update(&lighting(1), real(&[]), &[]);
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
    solver.update(&lighting(1), real(&[]), &[]);
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
        place: LightPlace::default(),
    }];
    let dark = [[Vec3::ZERO; 6]];
    solver.update(&lighting, real(&dark), &[lamp]);
    let light = solver.light();
    for height in [0.18, 0.25, 0.35] {
        let p = Vec3::new(0.29, 0.02, height);
        let found = light.change.surfaces.on(p, Vec3::NEG_X);
        let expected = from_lit_ground(p, &lamp, albedo, [light.low, light.high]);
        assert!(
            (found.x / expected - 1.0).abs() < 0.12 && found.w == 1.0,
            "{found} {expected} at {p}"
        );
    }
    // Without virtual lights, nothing changes.
    solver.lit_by = None;
    solver.update(&lighting, real(&dark), &[]);
    let change = &solver.light().change.surfaces;
    assert!(!change.values.is_empty());
    assert!(change.values.iter().all(|e| *e == Vec3::ZERO));
}

/// A black plate with the edge 0.2 m at the height 0.5 m over the origin.
fn plate() -> Part {
    let place = glam::DVec3::Z * 0.5;
    let mesh = primitives::cuboid(Vec3::new(0.2, 0.2, 0.001));
    part_of(mesh, 0.0, 0.0, DMat4::from_translation(place))
}

/// The light of one compact source.
fn sunlight(direction: Vec3, place: LightPlace) -> Lighting {
    let mut lighting = lighting(1);
    lighting.ground_radiance = Vec3::splat(0.2);
    lighting.lights = vec![penumbra_lighting::DomeLight {
        direction: direction.normalize(),
        irradiance: Vec3::splat(3.0),
        angular_radius: 0.004,
        kind: penumbra_lighting::LightKind::Compact,
        place,
    }];
    lighting
}

/// Solves for a box 0.2 m wide and 0.1 m high that stands on the ground.
fn box_on_the_ground(grey: f32, emissive: f32) -> IndirectLightSolver {
    let mesh = primitives::cuboid(Vec3::new(0.2, 0.2, 0.1));
    let scene = Scene {
        virtual_parts: vec![part_of(mesh, grey, emissive, DMat4::IDENTITY)],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    IndirectLightSolver::new(&scene, &casters(&scene)).unwrap()
}

/// Share of the light of the ground at 20 places along the box's side, `beside` it, metres: their mean.
fn share_beside(light: &IndirectLight, beside: f32) -> f32 {
    let along = (0..20).map(|k| glam::Vec2::new(0.1 + beside, 0.001 * k as f32 - 0.01));
    along.map(|place| ground_share(light, place)).sum::<f32>() / 20.0
}

/// Share of its light that a place on the ground has.
fn ground_share(light: &IndirectLight, place: glam::Vec2) -> f32 {
    on_ground(light, &light.nearby.ground, place)
}

/// Value of one of the grids on the ground at a place.
fn on_ground(light: &IndirectLight, grid: &[Vec3], place: glam::Vec2) -> f32 {
    let at = (place - light.low.truncate()) / (light.high - light.low).truncate();
    light.on_ground.value(grid, at).expect("a grid").x
}

#[test]
fn shadows_of_compact_sources_lie_where_they_belong() {
    let far = LightPlace::FAR;
    let scene = Scene {
        virtual_parts: vec![plate()],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &casters(&scene)).unwrap();
    for k in 0..8 {
        let (sin, cos) = (k as f32).sin_cos();
        let direction = Vec3::new(0.6 * cos, 0.6 * sin, 1.0);
        let centre = -0.5 * direction.truncate();
        solver.lit_by = None;
        solver.update(&sunlight(direction, far), real(&[]), &[]);
        let share = |beside: f32| ground_share(solver.light(), centre + glam::Vec2::X * beside);
        assert!(share(0.0) < 0.01 && share(0.06) < 0.01, "{direction}");
        assert!(share(0.14) > 0.99 && share(-0.14) > 0.99, "{direction}");
    }
    // A lamp at twice the height makes a shadow of twice the size.
    let near = LightPlace {
        reference: Vec3::ZERO,
        inverse_distance: 1.0,
    };
    solver.lit_by = None;
    solver.update(&sunlight(Vec3::Z, near), real(&[]), &[]);
    let share = |x: f32| ground_share(solver.light(), glam::Vec2::X * x);
    assert!(share(0.16) < 0.01 && share(0.24) > 0.99);
}

#[test]
fn ground_that_virtual_objects_light_is_brighter_by_that() {
    // A glowing wall that ends 0.1 from the middle, under a sun of irradiance 3 that no shadow of it reaches.
    let mut solver = box_on_the_ground(0.0, 1.0);
    let sun = sunlight(Vec3::Z, LightPlace::FAR);
    solver.update(&sun, real(&[]), &[]);
    let light = solver.light();
    let share = share_beside(light, 0.02);
    let expected = 1.0 + on_ground_beside(light, 0.02) / 3.0;
    assert!(
        expected > 1.2 && (share / expected - 1.0).abs() < 0.02,
        "{share} {expected}"
    );
}

#[test]
fn wall_lacks_the_light_of_ground_in_a_virtual_shadow_as_bright_as_that_is() {
    let place = DMat4::from_translation(glam::DVec3::X * 0.3);
    let scene = Scene {
        virtual_parts: vec![plate()],
        phantom_parts: vec![part_of(
            primitives::cuboid(Vec3::new(0.02, 0.6, 0.4)),
            0.5,
            0.0,
            place,
        )],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &casters(&scene)).unwrap();
    let sun = sunlight(Vec3::Z, LightPlace::FAR);
    // The shadow falls onto a white square on grey ground.
    let side = 32;
    let edge = 1.6;
    let mut ground = GroundBrightness {
        low: glam::Vec2::splat(-0.5 * edge),
        edge,
        side,
        cells: Vec::new(),
    };
    let is_white = |k: usize| (12..20).contains(&k);
    let brightness = |k: usize| {
        if is_white(k % side) && is_white(k / side) {
            3.0
        } else {
            0.8
        }
    };
    ground.cells = (0..side * side)
        .map(|k| Some(Vec3::splat(brightness(k))))
        .collect();
    let dark = [[Vec3::ZERO; 6]];
    let real = RealSurfaces {
        phantoms: &dark,
        ground: &ground,
    };
    solver.update(&sun, real, &[]);
    for height in [0.05, 0.1, 0.2] {
        let p = Vec3::new(0.29, 0.01, height);
        let found = solver.light().change.surfaces.on(p, Vec3::NEG_X);
        let expected = -3.0 * from_square(p, 0.1, 0.2);
        assert!(
            (found.x / expected - 1.0).abs() < 0.12,
            "{height}: {found} {expected}"
        );
        // Beside the mean, the white square and the grey ground around it.
        let found = solver.light().real.surfaces.on(p, Vec3::NEG_X);
        let grey = -0.2 * from_square(p, 0.5 * edge, 0.2);
        let expected = grey + 2.2 * from_square(p, 0.2, 0.2);
        assert!(
            (found.x - expected).abs() < 0.15 * expected.abs().max(0.05),
            "{height}: {found} {expected}"
        );
    }
}

#[test]
fn ground_lacks_the_light_of_the_shadowed_half_of_a_wall() {
    // A sun low over −X shines on a real wall; a black board hides the half at y > 0 from it.
    let wall = primitives::cuboid(Vec3::new(0.1, 0.6, 0.4));
    let board = primitives::cuboid(Vec3::new(0.002, 0.3, 0.6));
    let at = |x: f64, y: f64| DMat4::from_translation(glam::DVec3::new(x, y, 0.0));
    let scene = Scene {
        virtual_parts: vec![part_of(board, 0.0, 0.0, at(0.0, 0.15))],
        phantom_parts: vec![part_of(wall, 0.5, 0.0, at(0.34, 0.0))],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &casters(&scene)).unwrap();
    let direction = Vec3::new(-1.0, 0.0, 0.1);
    let mut sun = sunlight(direction, LightPlace::FAR);
    sun.ground_radiance = Vec3::ZERO;
    let mut radiance = [Vec3::ZERO; 6];
    radiance[side_of(Vec3::NEG_X) as usize] = Vec3::ONE;
    solver.update(&sun, real(&[radiance]), &[]);
    let light = solver.light();
    for y in [-0.2, -0.1, 0.1, 0.2] {
        let p = Vec3::new(0.22, y, 0.0);
        let lost = -on_ground(light, &light.change.ground, p.truncate());
        let expected = from_half_of_wall(p);
        assert!((lost - expected).abs() < 0.08, "{y}: {lost} {expected}");
    }
}

#[test]
fn light_of_a_wall_reaches_the_end_of_a_long_shadow() {
    let post = primitives::cuboid(Vec3::new(0.05, 0.05, 0.2));
    let wall = primitives::cuboid(Vec3::new(0.02, 0.6, 0.4));
    let at = |x: f64, y: f64| DMat4::from_translation(glam::DVec3::new(x, y, 0.0));
    let scene = Scene {
        virtual_parts: vec![part_of(post, 0.0, 0.0, at(0.0, 0.0))],
        phantom_parts: vec![part_of(wall, 0.5, 0.0, at(0.52, 0.15))],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &casters(&scene)).unwrap();
    let mut radiance = [Vec3::ZERO; 6];
    radiance[side_of(Vec3::NEG_X) as usize] = Vec3::ONE;
    solver.update(&lighting(1), real(&[radiance]), &[]);
    let light = solver.light();
    let found = on_ground(light, &light.real.ground, glam::Vec2::new(0.42, 0.15));
    let half = from_half_of_wall(Vec3::new(0.2, 0.0, 0.0));
    assert!((found / (2.0 * half) - 1.0).abs() < 0.15, "{found} {half}");
}

/// Irradiance at a point of the ground by the half at y > 0 of a wall at x = 0.29 with radiance 1.
fn from_half_of_wall(p: Vec3) -> f32 {
    let (across, up) = (150, 200);
    let step = 0.002;
    let each = (0..across * up).map(|i| {
        let at = glam::Vec2::new((i % across) as f32, (i / across) as f32) + 0.5;
        let to_wall = Vec3::new(0.29, at.x * step, at.y * step) - p;
        to_wall.z * to_wall.x / to_wall.length_squared().powi(2) * step * step
    });
    each.sum()
}

/// Irradiance at `p` on a surface that faces −X, by a square of the ground about the origin.
fn from_square(p: Vec3, half: f32, radiance: f32) -> f32 {
    let step = 2.0 * half / 200.0;
    let each = (0..200 * 200).map(|i| {
        let at = glam::Vec2::new((i % 200) as f32, (i / 200) as f32) + 0.5;
        let to_p = p - (at * step - half).extend(0.0);
        radiance * to_p.x.max(0.0) * to_p.z / to_p.length_squared().powi(2) * step * step
    });
    each.sum()
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

#[test]
fn lamp_in_a_golden_ball_makes_no_spots() {
    // A ball of 5 cm before a wall, which sees a lamp in it.
    let gold = Material {
        metallic: 1.0,
        roughness: 0.22,
        ..Material::default()
    };
    let ball = Part {
        material: Arc::new(gold),
        ..part_of(
            primitives::sphere(0.025, 48, 24),
            0.0,
            0.0,
            DMat4::from_translation(glam::DVec3::new(0.0, 0.0, 0.06)),
        )
    };
    let wall = part_of(primitives::plane(0.2, 0.2), 0.8, 0.0, DMat4::IDENTITY);
    let grid = CubeGrid::new(64);
    let lamp = Vec3::new(0.5, 0.2, 0.8).normalize();
    let sky = grid.directions.iter().map(|d| {
        let is_lamp = d.dot(lamp) > 0.06_f32.cos();
        Vec3::splat(if is_lamp { 200.0 } else { 0.1 })
    });
    let light = Lighting {
        radiance: Arc::new(Prefilter::new(64).apply(&sky.collect::<Vec<_>>())),
        ..lighting(1)
    };
    let scene = Scene {
        virtual_parts: vec![ball, wall],
        ..Scene::default()
    };
    let mut solver = IndirectLightSolver::new(&scene, &scene.virtual_parts).unwrap();
    solver.update(&light, real(&[]), &[]);
    let found = &solver.light().on_virtual;
    let at = |x: i32, y: i32| {
        let place = Vec3::new(x as f32, y as f32, 0.0) * 0.006;
        found.on(place, Vec3::Z).x
    };
    let brightest = (-8..=8).map(|x| at(x, 0)).fold(0.0, f32::max);
    let spots = (-8..=8)
        .flat_map(|y| (-8..=8).map(move |x| (x, y)))
        .map(|(x, y)| {
            let around = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1);
            (at(x, y) - 0.25 * around) / brightest
        });
    let worst = spots.fold(0.0, f32::max);
    assert!(worst < 0.2, "{worst}");
}

#[test]
fn sun_in_a_golden_ball_makes_no_spots_on_the_ground_and_no_light_in_its_shade() {
    let gold = Material {
        metallic: 1.0,
        roughness: 0.22,
        ..Material::default()
    };
    let place = DMat4::from_translation(glam::DVec3::new(0.0, 0.0, 0.1));
    let ball = Part {
        material: Arc::new(gold),
        ..part_of(primitives::sphere(0.1, 96, 48), 0.0, 0.0, place)
    };
    let scene = Scene {
        virtual_parts: vec![ball],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    let grid = CubeGrid::new(64);
    let sun = Seen {
        direction: Vec3::new(1.0, 0.0, 0.5).normalize(),
        irradiance: Vec3::ONE,
        angular_radius: 0.03,
    };
    let is_sun = |d: &Vec3| d.distance(sun.direction) < sun.angular_radius;
    let full = grid.directions.iter();
    let full = full.map(|d| Vec3::splat(if is_sun(d) { 2000.0 } else { 0.0 }));
    let full: Vec<Vec3> = full.collect();
    let dark = vec![Vec3::ZERO; full.len()];
    let widths: Vec<f32> = widths(64, level_count(64)).collect();
    let sun = excesses(&grid, &full, &dark, &[(sun, LightPlace::FAR)], &widths);
    let radiance = Prefilter::new(64).apply_without(&full, &sun);
    let light = Lighting {
        radiance: Arc::new(radiance),
        ..lighting(1)
    };
    let mut solver = IndirectLightSolver::new(&scene, &casters(&scene)).unwrap();
    solver.update(&light, real(&[]), &[]);
    let light = solver.light();
    let seen = |x: i32, y: i32| {
        let place = glam::Vec2::new(x as f32, y as f32) * 0.01;
        on_ground(light, &light.change.ground, place)
    };
    let before = || (10..=20).flat_map(|x| (-12..=12).map(move |y| (x, y)));
    let brightest = before().map(|(x, y)| seen(x, y)).fold(0.0, f32::max);
    assert!(brightest > 0.1, "{brightest}");
    let spots = before().map(|(x, y)| {
        let (i, j) = (x - 1, x + 1);
        let around = seen(i, y) + seen(j, y) + seen(x, y - 1) + seen(x, y + 1);
        (seen(x, y) - 0.25 * around) / brightest
    });
    let worst = spots.fold(0.0, f32::max);
    assert!(worst < 0.05, "{worst}");
    for x in -16..=-12 {
        let behind = seen(x, 0) / brightest;
        assert!(behind < 0.02, "{x}: {behind}");
    }
}

/// Light of radiance 1 from everywhere above, over ground that reflects all of it.
fn furnace(generation: u64) -> Lighting {
    let count = 4096;
    let cell = |i: usize| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / (2.0 * count as f32);
        let (sin, cos) = (2.399_963_2 * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        penumbra_lighting::DomeLight {
            direction: Vec3::new(r * cos, r * sin, z),
            irradiance: Vec3::splat(2.0 * std::f32::consts::PI / count as f32),
            angular_radius: 0.02,
            kind: penumbra_lighting::LightKind::Cell,
            place: LightPlace::FAR,
        }
    };
    Lighting {
        ground_radiance: Vec3::ONE,
        lights: (0..count).map(cell).collect(),
        ..lighting(generation)
    }
}

#[test]
fn ground_that_is_brighter_than_its_light_does_not_make_light_grow() {
    let mut solver = box_on_the_ground(1.0, 0.0);
    let mut most = [0.0_f32; 2];
    for generation in 1..=40 {
        let too_bright = Lighting {
            ground_radiance: Vec3::splat(8.0),
            ..furnace(generation)
        };
        solver.update(&too_bright, real(&[]), &[]);
        let shares = solver.light().nearby.ground.iter().map(|share| share.x);
        most = [most[1], shares.fold(0.0, f32::max)];
    }
    assert!(most[1] < 10.0 && most[1] / most[0] < 1.001, "{most:?}");
}

#[test]
fn white_object_in_a_white_furnace_changes_nothing() {
    let mut solver = box_on_the_ground(1.0, 0.0);
    for generation in 1..=4 {
        solver.update(&furnace(generation), real(&[]), &[]);
    }
    for beside in [0.005_f32, 0.01, 0.02, 0.05, 0.1] {
        let share = share_beside(solver.light(), beside);
        assert!((share - 1.0).abs() < 0.05, "{beside}: {share}");
    }
    // Half of what a wall sees is ground.
    for height in [0.01_f32, 0.03, 0.05, 0.09] {
        let on = &solver.light().on_virtual;
        let found = on.on(Vec3::new(0.1, 0.0, height), Vec3::X).x;
        let expected = 0.5 * std::f32::consts::PI;
        assert!((found / expected - 1.0).abs() < 0.05, "{height}: {found}");
    }
}
