use super::super::super::frame_input::FrameInput;
use super::*;
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::{CubeMap, Harmonics, Lighting};
use penumbra_picture::Picture;
use penumbra_scene::indirect_light::NearbyRadiance;
use penumbra_scene::{IndirectLight, Material, Mesh, Part, Scene, primitives};
use std::sync::Arc;

const EYE: Vec3 = Vec3::new(0.0, -0.5, 0.4);

fn part(mesh: Mesh, at: Vec3, material: Material) -> Part {
    Part {
        name: "part".to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(material),
        world_from_part: DMat4::from_translation(at.as_dvec3()),
        mirror: false,
        albedo: None,
    }
}

fn mirror() -> Material {
    Material {
        metallic: 1.0,
        roughness: 0.0,
        ..Material::default()
    }
}

/// Of radiance 2.
fn green_lamp() -> Material {
    Material {
        emissive: Vec3::new(0.0, 2.0, 0.0),
        base_colour: Vec3::ZERO.extend(1.0),
        specular: 0.0,
        ..Material::default()
    }
}

/// A mirror of a square metre about the origin, level or facing the camera's side.
fn level_mirror() -> Part {
    part(primitives::plane(1.0, 1.0), Vec3::ZERO, mirror())
}

fn scene(virtual_parts: Vec<Part>, phantom_parts: Vec<Part>) -> Scene {
    Scene {
        virtual_parts,
        phantom_parts,
        ..Scene::default()
    }
}

fn camera() -> PinholeCamera {
    PinholeCamera {
        width: 200,
        height: 200,
        focal: DVec2::splat(150.0),
        centre: DVec2::splat(99.5),
        distortion: [0.0; 5],
    }
}

fn pose() -> RigidTransform {
    let forward = -EYE.as_dvec3().normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    RigidTransform::new(DQuat::from_mat3(&axes), EYE.as_dvec3())
}

/// Calls `with` with what traces a scene under a sky of radiance 1, with phantoms of radiance 0.25.
pub fn traced<T>(scene: &Scene, with: impl FnOnce(Tracer<'_>) -> T) -> T {
    traced_from(None, scene, with)
}

/// The same, with an environment that was seen from a place.
fn traced_from<T>(seen_from: Option<Vec3>, scene: &Scene, with: impl FnOnce(Tracer<'_>) -> T) -> T {
    let (camera, pose) = (camera(), pose());
    let picture = Picture {
        width: 200,
        height: 200,
        rgba: vec![255; 160_000],
    };
    let lighting = Lighting {
        captured_at: MonotonicTime::from_nanos(0),
        generation: 1,
        radiance: Arc::new(CubeMap {
            size: 1,
            levels: vec![vec![[1.0; 3]; 6]],
            seen_from,
            ..CubeMap::default()
        }),
        irradiance: Harmonics::default(),
        lights: Vec::new(),
        ground_radiance: Vec3::splat(0.5),
        faces: None,
    };
    let near = IndirectLight {
        generation: 1,
        nearby: NearbyRadiance {
            phantoms: vec![[Vec3::splat(0.25); 6]; 4],
            ..NearbyRadiance::default()
        },
        ..IndirectLight::default()
    };
    let input = FrameInput {
        world_from_camera: Some(pose),
        lighting: Some(&lighting),
        indirect_light: Some(&near),
        ..FrameInput::new(&picture, &camera)
    };
    let response = Response::srgb();
    with(Tracer {
        scene: &NearbyScene::new(scene).expect("glossy"),
        light: NearbyLight::new(&input, &response).expect("lit"),
        view: View::new(&camera, pose),
        spacing: 0.002,
    })
}

/// What the surface mirrors at each of `points`.
fn mirrored(scene: &Scene, rays: usize, points: &[Vec3]) -> Vec<Nearby> {
    let fixed = slopes(rays);
    let lobes = Lobes {
        fixed: &fixed,
        soft: None,
    };
    let (camera, pose) = (camera(), pose());
    let pixel = |p: &Vec3| {
        let own = pose.inverse().transform_point(p.as_dvec3());
        camera.project(own).expect("in front").as_vec2()
    };
    let at = |tracer: &Tracer<'_>, p| tracer.trace(lobes, [pixel(p); LANES])[LANES - 1];
    traced(scene, |tracer| {
        points.iter().map(|p| at(&tracer, p)).collect()
    })
}

/// The point of the level mirror in which `p` appears.
fn image_of(p: Vec3) -> Vec3 {
    let image = p * Vec3::new(1.0, 1.0, -1.0);
    EYE + (image - EYE) * (EYE.z / (EYE.z - image.z))
}

#[test]
fn side_that_the_camera_sees_edge_on_has_its_mean_radiance() {
    // Its right side is at x = -0.01, which the camera sees at a cosine of 0.013.
    let body = part(
        primitives::cuboid(Vec3::new(0.1, 0.2, 0.2)),
        Vec3::new(-0.06, 0.2, 0.0),
        Material::default(),
    );
    let scene = scene(vec![level_mirror()], vec![body]);
    let at = [image_of(Vec3::new(-0.01, 0.2, 0.06))];
    let found = mirrored(&scene, 1, &at)[0];
    assert!(found.seen < 0.01 && found.open < 0.01, "{found:?}");
    assert!((found.light - 0.25).length() < 0.01, "{found:?}");
}

#[test]
fn mirror_shows_a_box_that_the_camera_sees_at_its_true_place() {
    // Its front is at y = 0.2, its top at z = 0.1.
    let size = Vec3::new(0.4, 0.1, 0.1);
    let body = part(
        primitives::cuboid(size),
        Vec3::new(0.0, 0.25, 0.0),
        Material::default(),
    );
    let scene = scene(vec![level_mirror()], vec![body]);
    let front = Vec3::new(0.05, 0.2, 0.06);
    let above = Vec3::new(0.05, 0.2, 0.11);
    let beside = Vec3::new(0.22, 0.2, 0.06);
    let at = [front, above, beside].map(image_of);
    let [front_seen, above_seen, beside_seen] = mirrored(&scene, 1, &at)[..] else {
        panic!("three points");
    };
    assert!(front_seen.seen > 0.99 && front_seen.open < 0.01);
    let in_camera = pose().inverse().transform_point(front.as_dvec3());
    let pixel = camera().project(in_camera).expect("in front").as_vec2();
    // The front is seen at an angle.
    let cosine = (EYE - front).normalize().dot(Vec3::NEG_Y);
    let width = cosine * at[0].distance(front) / in_camera.z as f32;
    let place = ((pixel + 0.5) / 200.0).extend(width);
    assert!(front_seen.place.distance(place) < 1e-4, "{front_seen:?}");
    assert!(front_seen.light.length() < 0.01);
    for open in [above_seen, beside_seen] {
        assert_eq!((open.open, open.seen, open.light), (1.0, 0.0, Vec3::ZERO));
    }
}

#[test]
fn side_that_the_camera_does_not_see_has_its_mean_radiance() {
    // Above the camera, seen from below in the mirror alone.
    let body = part(
        primitives::cuboid(Vec3::splat(0.1)),
        Vec3::new(0.0, 0.3, 0.9),
        Material::default(),
    );
    let scene = scene(vec![level_mirror()], vec![body]);
    let lowest = image_of(Vec3::new(0.0, 0.3, 0.9));
    let found = mirrored(&scene, 1, &[lowest])[0];
    assert_eq!((found.open, found.seen), (0.0, 0.0));
    assert!((found.light - 0.25).length() < 1e-6, "{found:?}");
}

#[test]
fn faces_about_an_edge_are_mirrored_each_as_the_picture_shows_it() {
    let glossy = Material {
        roughness: 0.25,
        ..mirror()
    };
    let size = Vec3::new(0.2, 0.2, 0.2);
    let body = part(
        primitives::cuboid(size),
        Vec3::new(0.4, 0.3, 0.0),
        Material::default(),
    );
    let ground = part(primitives::plane(2.0, 2.0), Vec3::ZERO, glossy);
    let scene = scene(vec![ground], vec![body]);
    // On the front, and on the edge between that and the left side, which the camera sees, too.
    let at = [Vec3::new(0.4, 0.2, 0.08), Vec3::new(0.3, 0.2, 0.08)].map(image_of);
    let [front, edge] = mirrored(&scene, 24, &at)[..] else {
        panic!("two points");
    };
    assert!(front.seen > 0.9 && front.light.length() < 0.05, "{front:?}");
    // The picture is white.
    assert!(edge.seen == 0.0 && edge.light.x > 0.3, "{edge:?}");
    assert!((edge.light.x + edge.open - 1.0).abs() < 0.05, "{edge:?}");
}

#[test]
fn virtual_surfaces_mirror_each_other_twice() {
    let lamp = green_lamp();
    let at = Vec3::new(0.0, 0.25, 0.0);
    let cube = |material| part(primitives::cuboid(Vec3::splat(0.1)), at, material);
    let front = image_of(Vec3::new(0.0, 0.2, 0.05));
    let lit = mirrored(
        &scene(vec![level_mirror(), cube(lamp)], Vec::new()),
        1,
        &[front],
    )[0];
    assert_eq!((lit.open, lit.seen), (0.0, 0.0));
    assert!((lit.light - Vec3::new(0.0, 2.0, 0.0)).length() < 1e-5);
    // A mirrored front shows the sky behind the camera.
    let twice = scene(vec![level_mirror(), cube(mirror())], Vec::new());
    let twice = mirrored(&twice, 1, &[front])[0];
    assert!((twice.light - 1.0).length() < 1e-4, "{twice:?}");
}

#[test]
fn third_reflection_shows_what_it_meets() {
    let lamp = green_lamp();
    let body = |size, at, material| part(primitives::cuboid(size), at, material);
    let front = Vec3::new(0.0, 0.2, 0.05);
    // Above the camera's rays, where the front reflects to, and behind the front, where this reflects to.
    let slope = (EYE.z + front.z) / (front.y - EYE.y);
    let second = Vec3::new(0.0, -0.1, front.z + slope * 0.3);
    let third = Vec3::new(0.0, 1.0, second.z + slope * 1.1);
    let parts = vec![
        level_mirror(),
        body(Vec3::splat(0.1), Vec3::new(0.0, 0.25, 0.0), mirror()),
        body(
            Vec3::new(0.1, 0.02, 0.1),
            second - Vec3::new(0.0, 0.01, 0.05),
            mirror(),
        ),
        body(Vec3::splat(0.2), third + Vec3::new(0.0, 0.1, -0.1), lamp),
    ];
    let found = mirrored(&scene(parts, Vec::new()), 1, &[image_of(front)])[0];
    assert!(
        (found.light - Vec3::new(0.0, 2.0, 0.0)).length() < 1e-5,
        "{found:?}"
    );
}

#[test]
fn real_mirror_shows_what_is_virtual_and_keeps_the_rest() {
    let lamp = green_lamp();
    let cube = |x, material| {
        let size = Vec3::splat(0.1);
        part(primitives::cuboid(size), Vec3::new(x, 0.25, 0.0), material)
    };
    let plate = Part {
        mirror: true,
        albedo: Some(Vec3::splat(0.5)),
        ..level_mirror()
    };
    let scene = scene(vec![cube(-0.1, lamp)], vec![plate, cube(0.1, mirror())]);
    let at = [-0.1, 0.1, 0.3].map(|x| image_of(Vec3::new(x, 0.2, 0.05)));
    let [glowing, real, nothing] = mirrored(&scene, 1, &at)[..] else {
        panic!("three points");
    };
    assert!(glowing.z < 0.0 && glowing.open == 0.0, "{glowing:?}");
    assert!((glowing.light - Vec3::new(0.0, 1.0, 0.0)).length() < 1e-5);
    for kept in [real, nothing] {
        assert_eq!((kept.open, kept.seen, kept.light), (1.0, 0.0, Vec3::ZERO));
    }
}

#[test]
fn real_mirror_that_reaches_below_the_ground_keeps_its_picture() {
    let ball = Part {
        mirror: true,
        ..part(primitives::sphere(0.1, 48, 24), Vec3::ZERO, mirror())
    };
    let far = part(primitives::cuboid(Vec3::splat(0.1)), Vec3::X, mirror());
    let scene = Scene {
        ground_height: Some(0.05),
        ..scene(vec![far], vec![ball])
    };
    // It reflects downwards there.
    let low = Vec3::new(0.0, -0.094, -0.034);
    let found = mirrored(&scene, 1, &[low])[0];
    assert!(found.z < 0.0 && found.open == 1.0, "{found:?}");
}

#[test]
fn shares_of_a_lobe_add_up_to_one_without_any_loss() {
    let rough = Material {
        metallic: 1.0,
        roughness: 0.5,
        ..Material::default()
    };
    let floor = part(primitives::plane(1.0, 1.0), Vec3::ZERO, rough);
    let wall = part(
        primitives::cuboid(Vec3::new(0.6, 0.1, 0.12)),
        Vec3::new(0.0, 0.25, 0.0),
        Material::default(),
    );
    let scene = scene(vec![floor], vec![wall]);
    let points: Vec<Vec3> = (0..20)
        .map(|i| Vec3::new(0.02 * i as f32 - 0.2, 0.1, 0.0))
        .collect();
    for found in mirrored(&scene, 12, &points) {
        // What is not open or seen has the phantoms' mean.
        let mean = (1.0 - found.open - found.seen) * 0.25;
        assert!((found.light - mean).length() < 1e-5, "{found:?}");
        assert!(found.open > 0.05 && found.seen > 0.05, "{found:?}");
    }
}

#[test]
fn rough_scenes_have_nothing_to_trace() {
    let matt = part(
        primitives::plane(1.0, 1.0),
        Vec3::ZERO,
        Material {
            roughness: 0.5,
            ..Material::default()
        },
    );
    assert!(NearbyScene::new(&scene(vec![matt], Vec::new())).is_none());
}

#[test]
fn an_outline_is_the_mean_of_the_nearest_surface_alone() {
    let place = |z: f32, light: f32, open: f32| Nearby {
        light: Vec3::splat(light),
        open,
        z,
        ..Nearby::NOTHING
    };
    let mut mean = PixelMean::default();
    for each in [
        place(0.9, 8.0, 0.0),
        place(0.5, 1.0, 1.0),
        Nearby::NOTHING,
        place(0.501, 3.0, 0.5),
    ] {
        mean.add(each);
    }
    let mean = mean.mean();
    assert_eq!(
        (mean.light, mean.open, mean.z),
        (Vec3::splat(2.0), 0.75, 0.5)
    );
    assert_eq!(PixelMean::default().mean(), Nearby::NOTHING);
}

#[test]
fn ground_that_the_camera_does_not_see_is_as_the_environment_camera_saw_it() {
    let scene = scene(vec![level_mirror()], Vec::new());
    let at = |seen_from, p| traced_from(seen_from, &scene, |t| t.light.hidden_ground(p));
    // The environment is 1 all around, the mean of the ground 0.5.
    assert_eq!(at(Some(EYE), Vec3::ZERO), Vec3::ONE);
    assert_eq!(at(None, Vec3::ZERO), Vec3::splat(0.5));
    let above = EYE + Vec3::Z;
    assert_eq!(at(Some(EYE), above), Vec3::splat(0.5));
}
