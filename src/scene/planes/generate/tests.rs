//! Planes of real and of damaged models.

use super::*;
use crate::gate::temple_gate;
use crate::mesh::{Material, Mesh};
use crate::planes::depth::visible_from;
use crate::primitives;
use glam::{DMat4, DVec2, Vec3};
use std::collections::HashSet;
use std::sync::Arc;

mod bad;

pub(super) fn part(name: &str, mesh: Mesh, at: DVec3) -> Part {
    Part {
        name: name.into(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(at),
        mirror: false,
        albedo: None,
    }
}

fn scene(parts: Vec<Part>) -> Scene {
    Scene {
        virtual_parts: parts,
        phantom_parts: vec![part("ground", primitives::plane(10.0, 10.0), DVec3::ZERO)],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

/// Shares of the area of `parts` that is visible from outside and does not face down: the share that
/// lies in the slab of a plane of `layer` with a cosine above 0.2, and the share that its camera
/// sees, too. Each fragment is represented by a random point.
fn coverage(planes: &[ShadowingPlane], parts: &[Part], layer: Layer) -> (f64, f64) {
    let mut surface = Surface::new(parts, &all(parts)).unwrap();
    let extent = max_extent(surface.bounds());
    surface.weigh(&RayCaster::from_parts(parts), extent);
    let seen: Vec<HashSet<u32>> = planes
        .iter()
        .map(|p| visible_from(p, &surface.fragments).into_iter().collect())
        .collect();
    let mut random = 1u32;
    let mut next = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(random >> 8) / f64::from(1 << 24)
    };
    let (mut held, mut straight, mut total) = (0.0, 0.0, 0.0);
    for (i, f) in surface.fragments.iter().enumerate() {
        if f.normal.z < -0.3 {
            continue;
        }
        total += f.area;
        let (u, v) = (next(), next());
        let (u, v) = if u + v > 1.0 {
            (1.0 - u, 1.0 - v)
        } else {
            (u, v)
        };
        let [a, b, c] = f.corners;
        let point = a + (b - a) * u + (c - a) * v;
        let holds = |p: &ShadowingPlane| p.layer == layer && is_held(p, point, f.normal);
        if planes.iter().any(holds) {
            held += f.area;
        }
        let sees =
            |(p, seen): (&ShadowingPlane, &HashSet<u32>)| holds(p) && seen.contains(&(i as u32));
        if planes.iter().zip(&seen).any(sees) {
            straight += f.area;
        }
    }
    (held / total, straight / total)
}

fn is_held(p: &ShadowingPlane, point: DVec3, normal: DVec3) -> bool {
    let from = point - p.centre;
    let flat = DVec2::new(from.dot(p.right), from.dot(p.up)).abs();
    let depth = -from.dot(p.normal());
    normal.dot(p.normal()) > 0.2
        && flat.cmple(p.half_size).all()
        && (0.0..=p.depth).contains(&depth)
}

/// Generates the planes of `scene`, prints their coverage, and checks both.
fn check(name: &str, scene: &Scene) -> Vec<ShadowingPlane> {
    let start = std::time::Instant::now();
    let planes = generate(scene, &PlaneSettings::default()).unwrap();
    let took = start.elapsed();
    let (held, seen) = coverage(&planes, &scene.virtual_parts, Layer::Virtual);
    let real = planes.iter().filter(|p| p.layer == Layer::Real).count();
    let triangles: usize = scene
        .virtual_parts
        .iter()
        .map(|p| p.mesh.indices.len() / 3)
        .sum();
    eprintln!(
        "{name}: {triangles} triangles, {real} + {} planes, held {held:.4}, seen {seen:.4}, {took:?}",
        planes.len() - real
    );
    assert!(held >= 0.97, "{name}: {held}");
    // Beneath the eaves of a gate some surfaces are always hidden.
    assert!(seen >= 0.8, "{name}: {seen}");
    assert_valid(&planes, 38);
    assert_eq!(planes, generate(scene, &PlaneSettings::default()).unwrap());
    planes
}

/// Checks centres, sizes, axes and parts; the real layer must come first.
pub(super) fn assert_valid(planes: &[ShadowingPlane], max: usize) {
    assert!(planes.len() <= max, "{}", planes.len());
    assert!(planes.is_sorted_by_key(|p| p.layer != Layer::Real));
    for p in planes {
        assert!(p.centre.is_finite() && p.half_size.min_element() > 0.0 && p.half_size.is_finite());
        assert!(p.right.is_normalized() && p.up.is_normalized() && p.right.dot(p.up).abs() < 1e-9);
        assert!(p.depth > 0.0 && p.depth.is_finite());
        assert!(p.layer == Layer::Real || p.normal().z > -0.95);
        assert!(p.parts.is_sorted());
    }
}

/// The phantoms, the mirrored ball and the object of a recorded rig.
fn session(name: &str) -> Option<Scene> {
    let folder = penumbra_test_data::shared(&format!("truth/{name}"))?;
    let rig = std::fs::read(folder.join("rig.json")).unwrap();
    let rig: serde_json::Value = serde_json::from_slice(&rig).unwrap();
    let rows = &rig["object"]["T_world_object"]["matrix_row_major"];
    let cell = |i: usize| rows[i / 4][i % 4].as_f64().unwrap();
    let world_from_object = DMat4::from_cols_array(&std::array::from_fn(cell)).transpose();
    let object = crate::load_gltf(&folder.join("object/object.glb")).unwrap();
    let mut scene = scene(object.placed(world_from_object));
    for phantom in rig["phantoms"].as_array().unwrap() {
        let file = phantom["ply"].as_str().unwrap();
        let bytes = std::fs::read(folder.join(file)).unwrap();
        let mesh = crate::load_ply(&bytes, file).unwrap();
        scene.phantom_parts.push(part(file, mesh, DVec3::ZERO));
    }
    let ball = &rig["environment_camera"]["mirror_sphere"];
    if let (Some(centre), Some(radius)) = (ball["center_world"].as_array(), ball["radius"].as_f64())
    {
        let centre = DVec3::from_slice(&[0, 1, 2].map(|i| centre[i].as_f64().unwrap()));
        let mesh = primitives::sphere(radius as f32, 96, 48);
        scene.phantom_parts.push(Part {
            mirror: true,
            ..part("ball", mesh, centre)
        });
    }
    Some(scene)
}

#[test]
fn covers_the_sessions_objects() {
    for name in [
        "desk",
        "desk-sphere",
        "courtyard",
        "desk-marker",
        "desk-lamp",
    ] {
        let Some(scene) = session(name) else { continue };
        let planes = check(name, &scene);
        assert_eq!(planes[0].receiver, Receiver::Plane);
        let mirror = |p: u32| scene.phantom_parts[p as usize].mirror;
        let real = planes.iter().filter(|p| p.layer == Layer::Real);
        assert!(!real.flat_map(|p| &p.parts).any(|p| mirror(*p)), "{name}");
    }
}

#[test]
fn covers_the_torii() {
    let Some(path) = penumbra_test_data::shared("data/models/torii/scene.gltf") else {
        return;
    };
    let parts = crate::load_gltf(&path).unwrap().placed(DMat4::IDENTITY);
    check("torii", &scene(parts));
}

#[test]
fn covers_the_temple_gate_at_any_size() {
    for scale in [1.0, 0.02, 20.0] {
        let placement = DMat4::from_scale_rotation_translation(
            DVec3::splat(scale),
            glam::DQuat::from_rotation_z(0.4),
            DVec3::new(3.0, -2.0, 0.0),
        );
        let gate = temple_gate(64).placed(placement);
        check(&format!("gate × {scale}"), &scene(gate));
    }
}

#[test]
fn box_has_planes_on_five_sides_and_the_ground() {
    let scene = scene(vec![part(
        "box",
        primitives::cuboid(Vec3::new(0.2, 0.1, 0.3)),
        DVec3::ZERO,
    )]);
    let planes = check("box", &scene);
    let ground: Vec<_> = planes.iter().filter(|p| p.layer == Layer::Real).collect();
    assert_eq!(ground.len(), 3);
    let virtual_planes: Vec<_> = planes
        .iter()
        .filter(|p| p.layer == Layer::Virtual)
        .collect();
    for normal in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z] {
        assert!(
            virtual_planes
                .iter()
                .any(|p| p.normal().dot(normal) > 0.999),
            "{normal}"
        );
    }
    // A convex object is one cluster, and needs no plane twice.
    assert_eq!(virtual_planes.len(), 5);
}

/// Cosines of surfaces that a plane looks at straight may come out above one.
#[test]
fn rotated_box_has_the_same_planes() {
    for degrees in [7.0, 28.65, 45.0, 61.0, 83.0] {
        let turn = DMat4::from_rotation_z(f64::to_radians(degrees));
        let mut cube = cube_at("box", DVec3::ZERO);
        cube.world_from_part = turn;
        let planes = check("turned box", &scene(vec![cube]));
        for normal in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z] {
            let normal = turn.transform_vector3(normal);
            let faces = |p: &ShadowingPlane| p.normal().dot(normal) > 0.999;
            assert!(planes.iter().any(faces), "{degrees}: {normal}");
        }
    }
}

#[test]
fn covers_round_objects() {
    for (name, mesh) in [
        ("torus", primitives::torus(0.08, 0.02, 225, 130)),
        ("sphere", primitives::sphere(30.0, 128, 64)),
        ("cone", primitives::cone(0.1, 0.2, 64)),
    ] {
        let scene = scene(vec![part(name, mesh, DVec3::Z * 0.1)]);
        check(name, &scene);
    }
}

fn cube_at(name: &str, at: DVec3) -> Part {
    part(name, primitives::cuboid(Vec3::ONE), at)
}

#[test]
fn ground_planes_are_nested_and_end_at_the_border_of_the_ground() {
    let mut scene = scene(vec![cube_at("box", DVec3::ZERO)]);
    let settings = PlaneSettings::default();
    let ground = |scene: &Scene| -> Vec<ShadowingPlane> {
        let planes = generate(scene, &settings).unwrap();
        planes
            .into_iter()
            .filter(|p| p.receiver == Receiver::Plane)
            .collect()
    };
    let planes = ground(&scene);
    assert_eq!(planes.len(), 3);
    assert!(planes.is_sorted_by(|a, b| a.half_size.x < b.half_size.x));
    // The shadow of a light 9.1° high from the top edge, and the table's edges at 5 m.
    assert!((planes[2].half_size.x - 5.0).abs() < 1e-9, "{planes:?}");
    assert!(
        planes
            .iter()
            .all(|p| p.parts == [0] && p.normal() == DVec3::Z)
    );
    scene.phantom_parts.clear();
    let endless = ground(&scene);
    assert!(endless[2].half_size.x > 0.5 + 6.2 && endless[2].parts.is_empty());
    scene.ground_height = None;
    assert!(ground(&scene).is_empty());
    // Beside the model there is nothing to catch a shadow on.
    scene.phantom_parts = vec![part("ground", primitives::plane(1.0, 1.0), DVec3::X * 90.0)];
    assert!(ground(&scene).is_empty());
}

#[test]
fn only_near_phantoms_that_are_no_mirrors_have_planes() {
    let mut scene = scene(vec![cube_at("box", DVec3::ZERO)]);
    scene.phantom_parts.push(cube_at("near", DVec3::X * 2.0));
    scene.phantom_parts.push(cube_at("far", DVec3::X * 40.0));
    scene.phantom_parts.push(cube_at("ball", DVec3::Y * 2.0));
    scene.phantom_parts[3].mirror = true;
    let planes = generate(&scene, &PlaneSettings::default()).unwrap();
    assert_valid(&planes, 38);
    let has = |part: u32| {
        planes
            .iter()
            .any(|p| p.layer == Layer::Real && p.parts.contains(&part))
    };
    assert_eq!([0, 1, 2, 3].map(has), [true, true, false, false]);
    // The side that has the box behind itself takes no shadow of it.
    let real = || {
        planes
            .iter()
            .filter(|p| p.parts == [1] && p.layer == Layer::Real)
    };
    assert!(real().all(|p| p.normal().x < 0.9) && real().any(|p| p.normal().x < -0.9));
    let near = &planes
        .iter()
        .find(|p| p.parts == [1] && p.layer == Layer::Real)
        .unwrap();
    assert_eq!(near.receiver, Receiver::Surface);
}

#[test]
fn hidden_parts_have_no_plane() {
    let small = part(
        "inner",
        primitives::cuboid(Vec3::splat(0.2)),
        DVec3::Z * 0.4,
    );
    let planes = generate(
        &scene(vec![cube_at("outer", DVec3::ZERO), small]),
        &PlaneSettings::default(),
    )
    .unwrap();
    let inner = |p: &&ShadowingPlane| p.layer == Layer::Virtual && p.parts.contains(&1);
    assert_eq!(planes.iter().find(inner), None);
}

#[test]
fn fewer_planes_are_the_most_valuable_ones() {
    let scene = scene(temple_gate(16).placed(DMat4::IDENTITY));
    let mut last = 0.0;
    for count in [2, 8, 24] {
        let settings = PlaneSettings {
            count,
            ..PlaneSettings::default()
        };
        let planes = generate(&scene, &settings).unwrap();
        assert_valid(&planes, count as usize);
        assert_eq!(planes[0].layer, Layer::Real);
        let (held, _) = coverage(&planes, &scene.virtual_parts, Layer::Virtual);
        assert!(held > last, "{count}: {held}");
        last = held;
    }
}

#[test]
fn planes_by_hand_replace_those_of_their_layer() {
    let mut scene = scene(vec![cube_at("box", DVec3::ZERO)]);
    let made = generate(&scene, &PlaneSettings::default()).unwrap();
    let (real, own): (Vec<_>, Vec<_>) = made.into_iter().partition(|p| p.layer == Layer::Real);
    scene.planes = vec![own[0].clone()];
    let planes = generate(&scene, &PlaneSettings::default()).unwrap();
    assert_eq!(planes[..real.len()], real);
    assert_eq!(planes[real.len()..], own[..1]);
    scene.planes.push(real[0].clone());
    let planes = generate(&scene, &PlaneSettings::default()).unwrap();
    assert_eq!(planes, [real[0].clone(), own[0].clone()]);
}
