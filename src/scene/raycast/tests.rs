use super::*;
use crate::mesh::{Material, Mesh, Vertex};
use crate::primitives;
use glam::{DMat4, Vec2, Vec3, Vec4};
use proptest::prelude::*;
use std::sync::Arc;

fn part(mesh: Mesh, world_from_part: DMat4) -> Part {
    Part {
        name: "p".into(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part,
        mirror: false,
        albedo: None,
    }
}

/// A square of side 2 about the origin, in z = 0, with a triangle of an invalid index.
fn square(world_from_part: DMat4, mirror: bool) -> Part {
    let corner = |x: f32, y: f32| Vertex {
        position: Vec3::new(x, y, 0.0),
        normal: Vec3::Z,
        uv: Vec2::ZERO,
        tangent: Vec4::ZERO,
    };
    let mesh = Mesh {
        vertices: vec![
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ],
        indices: vec![0, 1, 2, 0, 2, 3, 0, 9, 1],
    };
    Part {
        mirror,
        ..part(mesh, world_from_part)
    }
}

fn several_parts() -> Vec<Part> {
    let rotated = DMat4::from_rotation_z(0.4) * DMat4::from_translation(DVec3::new(1.0, 0.5, 0.2));
    let stretched = DMat4::from_scale(DVec3::new(1.0, 2.0, -0.5));
    vec![
        part(primitives::plane(10.0, 10.0), DMat4::IDENTITY),
        part(primitives::torus(0.8, 0.2, 40, 20), rotated),
        part(primitives::sphere(0.7, 24, 12), stretched),
    ]
}

#[test]
fn hits_a_plane_at_the_right_distance_from_both_sides() {
    let caster = RayCaster::from_parts(&[part(
        primitives::plane(4.0, 4.0),
        DMat4::from_translation(DVec3::Z),
    )]);
    let (origin, direction) = (DVec3::new(0.5, 0.5, 3.0), DVec3::new(0.25, 0.0, -0.5));
    let hit = caster.nearest(origin, direction).unwrap();
    assert!((hit.distance - 4.0).abs() < 1e-12);
    assert!(hit.point.distance(DVec3::new(1.5, 0.5, 1.0)) < 1e-12);
    assert_eq!((hit.normal, hit.surface), (DVec3::Z, 0));
    assert_eq!(hit.shading_normal, DVec3::Z);
    // Seen from below, the plane faces down; beside it there is nothing.
    let from_below = caster.nearest(DVec3::ZERO, DVec3::Z).unwrap();
    assert_eq!(
        (from_below.normal, from_below.shading_normal),
        (DVec3::NEG_Z, DVec3::NEG_Z)
    );
    let beside = DVec3::new(3.0, 0.0, 3.0);
    assert_eq!(caster.nearest(beside, DVec3::NEG_Z), None);
    assert_eq!(caster.nearest(DVec3::Z * 3.0, DVec3::Z), None);
    assert!(caster.is_blocked(DVec3::ZERO, DVec3::Z, 1.01));
    assert!(!caster.is_blocked(DVec3::ZERO, DVec3::Z, 0.99));
    assert!(caster.is_blocked(DVec3::ZERO, DVec3::Z * 4.0, 0.26));
    assert!(!caster.is_blocked(DVec3::ZERO, DVec3::Z * 4.0, 0.24));
}

#[test]
fn interpolates_the_normals_of_a_stretched_sphere() {
    let axes = DVec3::new(1.0, 2.0, -0.5) * 0.7;
    let matrix = DMat4::from_scale(DVec3::new(1.0, 2.0, -0.5));
    let caster = RayCaster::from_parts(&[part(primitives::sphere(0.7, 256, 128), matrix)]);
    for direction in [
        DVec3::new(1.0, 1.0, 1.0),
        DVec3::new(-1.0, 0.3, 0.2),
        DVec3::new(0.1, -1.0, -2.0),
    ] {
        let hit = caster.nearest(direction * 5.0, -direction).unwrap();
        let expected = (hit.point / (axes * axes)).normalize();
        assert!(
            hit.shading_normal.dot(expected) > 0.9999,
            "{hit:?} {expected}"
        );
        assert!(hit.normal.dot(expected) > 0.999, "{hit:?} {expected}");
    }
}

#[test]
fn returns_the_nearest_of_ground_and_phantoms() {
    let mut ground = square(DMat4::from_scale(DVec3::splat(9.0)), false);
    ground.albedo = Some(Vec3::new(0.5, 0.25, 0.125));
    let caster = RayCaster::from_phantoms(&Scene {
        phantom_parts: vec![
            square(DMat4::from_translation(DVec3::Z), false),
            square(DMat4::from_translation(DVec3::Z * 2.0), true),
            ground,
        ],
        ground_height: Some(0.0),
        ..Scene::default()
    });
    let above = DVec3::new(0.3, 0.2, 5.0);
    let from_above = caster.nearest(above, DVec3::NEG_Z).unwrap();
    assert_eq!((from_above.surface, from_above.mirror), (1, true));
    assert!((from_above.distance - 3.0).abs() < 1e-12);
    assert_eq!(from_above.normal, DVec3::Z);
    let from_between = caster.nearest(DVec3::new(0.3, 0.2, 1.5), DVec3::Z).unwrap();
    assert_eq!(from_between.surface, 1);
    assert_eq!(from_between.normal, DVec3::NEG_Z);
    let aside = DVec3::new(1.3, 0.2, 5.0);
    let beside = caster.nearest(aside, DVec3::NEG_Z).unwrap();
    assert_eq!((beside.surface, beside.point.z), (GROUND, 0.0));
    assert_eq!(caster.nearest(aside, DVec3::Z), None);
    assert_eq!(caster.nearest(DVec3::Z * 5.0, DVec3::X), None);
    assert_eq!(caster.albedo(GROUND), Some(DVec3::new(0.5, 0.25, 0.125)));
    assert_eq!(caster.albedo(0), None);
    assert_eq!(caster.albedo(7), None);
}

#[test]
fn level_ground_is_an_unbounded_plane() {
    let scene = Scene {
        ground_height: Some(1.0),
        phantom_parts: vec![part(
            primitives::sphere(1.0, 16, 8),
            DMat4::from_translation(DVec3::Z * 3.0),
        )],
        ..Scene::default()
    };
    let caster = RayCaster::from_phantoms(&scene);
    let far = caster
        .nearest(DVec3::new(500.0, 0.0, 2.0), DVec3::NEG_Z)
        .unwrap();
    assert_eq!(
        (far.distance, far.surface, far.normal),
        (1.0, GROUND, DVec3::Z)
    );
    let below = caster
        .nearest(DVec3::new(500.0, 0.0, 0.0), DVec3::Z)
        .unwrap();
    assert_eq!((below.distance, below.normal), (1.0, DVec3::NEG_Z));
    assert_eq!(
        caster
            .nearest(DVec3::Z * 9.0, DVec3::NEG_Z)
            .unwrap()
            .surface,
        0
    );
    assert!(caster.is_blocked(DVec3::new(500.0, 0.0, 2.0), DVec3::NEG_Z, 1.01));
    assert!(!caster.is_blocked(DVec3::new(500.0, 0.0, 2.0), DVec3::NEG_Z, 0.99));
    let nothing = RayCaster::from_phantoms(&Scene::default());
    assert_eq!(nothing.nearest(DVec3::ZERO, DVec3::X), None);
    assert!(!nothing.is_blocked(DVec3::ZERO, DVec3::X, f64::INFINITY));
}

#[test]
fn meshed_sphere_is_hit_as_a_sphere_from_outside_only() {
    let mut sphere = square(DMat4::from_translation(DVec3::Z * 3.0), true);
    sphere.mesh = Arc::new(primitives::sphere(0.5, 48, 24));
    let caster = RayCaster::from_phantoms(&Scene {
        phantom_parts: vec![sphere],
        ..Scene::default()
    });
    let origin = DVec3::new(0.25, 0.0, 0.0);
    let hit = caster.nearest(origin, DVec3::Z).unwrap();
    let height = 3.0 - (0.25f64 - 0.0625).sqrt();
    assert!((hit.point.z - height).abs() < 1e-6 && hit.mirror);
    assert!((hit.normal.x - 0.5).abs() < 1e-6);
    assert_eq!(hit.shading_normal, hit.normal);
    // The direction's length counts.
    let longer = caster.nearest(origin, DVec3::Z * 4.0).unwrap();
    assert!((longer.distance - 0.25 * hit.distance).abs() < 1e-12);
    assert!((longer.point - hit.point).length() < 1e-12);
    // A ray that starts on its surface leaves it.
    assert_eq!(caster.nearest(hit.point, hit.normal), None);
    assert_eq!(caster.nearest(DVec3::Z * 3.0, DVec3::X), None);
}

#[test]
fn sphere_is_hit_on_its_near_side() {
    let hit = |centre: DVec3| sphere_hit(centre, 1.0, DVec3::ZERO, DVec3::Z);
    assert_eq!(hit(DVec3::new(0.0, 0.0, 5.0)), Some(4.0));
    assert_eq!(hit(DVec3::new(0.0, 2.0, 5.0)), None);
    assert_eq!(hit(DVec3::new(0.0, 0.0, -5.0)), None);
}

/// The nearest distance by trying every surface, metres.
fn by_trying_all(caster: &RayCaster, origin: DVec3, direction: DVec3) -> Option<f64> {
    let ray = Ray::new(origin, direction)?;
    let leaves = 0..(caster.triangles.len() + caster.spheres.len()) as u32;
    let distances = leaves.filter_map(|leaf| caster.distance_to(leaf, &ray));
    let ground = caster.ground_hit(origin, direction);
    distances
        .chain(ground.map(|hit| hit.distance * ray.length))
        .min_by(f64::total_cmp)
        .map(|distance| distance / ray.length)
}

fn assert_same_as_trying_all(caster: &RayCaster, origin: DVec3, direction: DVec3) {
    let expected = by_trying_all(caster, origin, direction);
    let hit = caster.nearest(origin, direction);
    let close = |(a, b): (f64, f64)| (a - b).abs() <= 1e-15 * b;
    let found = hit.map(|h| h.distance);
    assert!(
        found == expected || found.zip(expected).is_some_and(close),
        "{origin} {direction}: {found:?} {expected:?}"
    );
    assert_eq!(
        hit.is_some(),
        caster.is_blocked(origin, direction, f64::INFINITY)
    );
    if let Some(hit) = hit {
        assert!(hit.normal.is_normalized() && hit.shading_normal.is_normalized());
        assert!(hit.normal.dot(direction) <= 0.0);
        assert!(hit.normal.dot(hit.shading_normal) >= 0.0);
    }
}

/// Rays exactly through corners and along edges of boxes that share planes.
#[test]
fn no_ray_slips_between_boxes_that_touch() {
    let parts = [part(primitives::plane(2.0, 2.0), DMat4::IDENTITY)];
    let caster = RayCaster::from_parts(&parts);
    for i in -10..=10 {
        let x = f64::from(i) * 0.1;
        for origin in [DVec3::new(x, x, 1.0), DVec3::new(x, 0.0, 1000.0)] {
            assert!(
                caster.is_blocked(origin, DVec3::NEG_Z, f64::INFINITY),
                "{origin}"
            );
        }
        let towards = DVec3::new(x, x, 0.0);
        // At the rim of the plane rounding decides whether the triangle is hit.
        for origin in [DVec3::new(0.3, -0.7, 50.0), DVec3::new(1e5, 1e5, 1e5)] {
            assert_same_as_trying_all(&caster, origin, towards - origin);
        }
    }
}

proptest! {
    #[test]
    fn hierarchy_finds_what_trying_every_surface_finds(
        o in prop::array::uniform3(-3.0f64..3.0), d in prop::array::uniform3(-1.0f64..1.0),
    ) {
        let (origin, direction) = (DVec3::from(o), DVec3::from(d));
        assert_same_as_trying_all(&RayCaster::from_parts(&several_parts()), origin, direction);
        let phantoms = Scene {
            phantom_parts: several_parts(),
            ground_height: Some(-1.0),
            ..Scene::default()
        };
        assert_same_as_trying_all(&RayCaster::from_phantoms(&phantoms), origin, direction);
    }

    #[test]
    fn unusual_rays_never_panic(
        o in prop::array::uniform3(any::<f64>()), d in prop::array::uniform3(any::<f64>()),
    ) {
        let caster = RayCaster::from_parts(&several_parts());
        let _ = caster.nearest(DVec3::from(o), DVec3::from(d));
    }

    #[test]
    fn unusual_meshes_never_panic(
        corners in prop::collection::vec(prop::array::uniform3(any::<f32>()), 0..20),
        indices in prop::collection::vec(0u32..22, 0..60),
    ) {
        let vertex = |p: &[f32; 3]| Vertex {
            position: Vec3::from(*p),
            normal: Vec3::NAN,
            uv: Vec2::ZERO,
            tangent: Vec4::ZERO,
        };
        let mesh = Mesh { vertices: corners.iter().map(vertex).collect(), indices };
        let scene = Scene {
            phantom_parts: vec![part(mesh, DMat4::from_scale(DVec3::new(1.0, 1e-20, 1e20)))],
            ground_height: Some(0.0),
            ..Scene::default()
        };
        let caster = RayCaster::from_phantoms(&scene);
        let _ = caster.nearest(DVec3::new(0.1, 0.2, 0.3), DVec3::new(1.0, 2.0, 3.0));
    }
}
