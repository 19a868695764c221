//! Glossy surfaces mirror what stands close by.

use crate::stage::{Stage, even_sky, flat, lighting, looking_from, painted, part};
use glam::{DMat4, DVec2, DVec3, Vec3};
use penumbra_lighting::{DomeLight, LightKind, LightPlace};
use penumbra_picture::Picture;
use penumbra_scene::{Material, Part, primitives};
use std::f64::consts::FRAC_PI_2;

/// The sky's code, and that of everything real.
const SKY: f32 = 0.1;
const REAL: [u8; 3] = [200, 90, 40];

fn mirror() -> Part {
    let material = Material {
        metallic: 1.0,
        roughness: 0.0,
        ..Material::default()
    };
    painted(primitives::plane(0.4, 0.4), DVec3::ZERO, material)
}

/// A level mirror under a dim sky, seen from above and from the front.
fn stage() -> Stage {
    let mut stage = Stage::new(160, 120)
        .without_ground()
        .with_virtual(mirror())
        .lit(even_sky(SKY));
    stage.picture = flat(160, 120, REAL);
    stage
}

/// The colour of the mirror where it shows `p`.
fn shown(stage: &Stage, picture: &Picture, p: DVec3) -> [u8; 3] {
    let pose = stage.pose.unwrap();
    let image = DVec3::new(p.x, p.y, -p.z);
    let pixel = stage
        .camera
        .project(pose.inverse().transform_point(image))
        .unwrap();
    let at: DVec2 = pixel.round();
    picture.rgb(at.x as u32, at.y as u32)
}

fn is_near(a: [u8; 3], b: [u8; 3], within: u8) -> bool {
    a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= within)
}

/// The front of the box is at y = 0.1, its top at z = 0.06.
fn box_at_the_back() -> Part {
    let size = Vec3::new(0.1, 0.06, 0.06);
    part(primitives::cuboid(size), DVec3::new(0.0, 0.13, 0.0))
}

/// The same, with a green radiance of a half.
fn glowing_box() -> Part {
    let material = Material {
        emissive: Vec3::new(0.0, 0.5, 0.0),
        base_colour: Vec3::ZERO.extend(1.0),
        specular: 0.0,
        ..Material::default()
    };
    Part {
        material: material.into(),
        ..box_at_the_back()
    }
}

const FRONT: DVec3 = DVec3::new(0.0, 0.1, 0.03);
const ABOVE: DVec3 = DVec3::new(0.0, 0.1, 0.08);
const BESIDE: DVec3 = DVec3::new(0.08, 0.1, 0.03);

#[test]
fn mirror_beside_a_box_shows_the_picture_of_its_front() {
    for step in [1, 2, 4] {
        let mut stage = stage().with_phantom(box_at_the_back());
        stage.settings.reflection_step = step;
        let sky = stage.response.code_from_linear(SKY);
        let picture = stage.compose();
        let front = shown(&stage, &picture, FRONT);
        assert!(is_near(front, REAL, 3), "step {step}: {front:?}");
        for p in [ABOVE, BESIDE] {
            let open = shown(&stage, &picture, p);
            assert!(is_near(open, [sky; 3], 3), "step {step}: {p} {open:?}");
        }
    }
}

#[test]
fn mirror_shows_a_virtual_box() {
    let glowing = glowing_box();
    let stage = stage().with_virtual(glowing);
    let code = stage.response.code_from_linear(0.5);
    let picture = stage.compose();
    let front = shown(&stage, &picture, FRONT);
    assert!(is_near(front, [0, code, 0], 3), "{front:?}");
}

#[test]
fn real_mirror_shows_a_virtual_box_and_is_else_left_as_it_is() {
    let glowing = glowing_box();
    let reflectance = Vec3::new(0.9, 0.6, 0.9);
    let real = Part {
        mirror: true,
        albedo: Some(reflectance),
        name: "plate".to_owned(),
        ..mirror()
    };
    for step in [1, 2] {
        let mut stage = Stage::new(160, 120)
            .without_ground()
            .with_phantom(real.clone())
            .with_virtual(glowing.clone())
            .lit(even_sky(SKY));
        stage.picture = flat(160, 120, REAL);
        stage.settings.reflection_step = step;
        let code = stage.response.code_from_linear(0.5 * reflectance.y);
        let picture = stage.compose();
        let front = shown(&stage, &picture, FRONT);
        assert!(is_near(front, [0, code, 0], 3), "step {step}: {front:?}");
        for p in [ABOVE, BESIDE] {
            assert_eq!(shown(&stage, &picture, p), REAL, "step {step}: {p}");
        }
    }
}

#[test]
fn scene_without_gloss_after_one_with_it_mirrors_nothing() {
    let with_box = stage().with_phantom(box_at_the_back());
    let without = stage();
    let mut compositor = with_box.compositor();
    let _ = with_box.compose_with(&mut compositor);
    compositor.set_scene(&without.scene, &without.scene.virtual_parts);
    assert!(without.compose_with(&mut compositor) == without.compose());
}

/// Height of a lamp above the origin, metres.
const HEIGHT: f32 = 0.3;

/// A mirror on a table under a lamp; beside the mirror's foot, the table is out of the picture.
fn beside_the_picture(inverse_distance: f32) -> Stage {
    let lamp = DomeLight {
        direction: Vec3::Z,
        irradiance: Vec3::ONE,
        angular_radius: 0.01,
        kind: LightKind::Compact,
        place: LightPlace {
            reference: Vec3::ZERO,
            inverse_distance,
        },
    };
    let faces_left =
        DMat4::from_translation(DVec3::new(-0.12, 0.0, 0.05)) * DMat4::from_rotation_y(-FRAC_PI_2);
    let wall = Part {
        world_from_part: faces_left,
        mesh: primitives::plane(1.0, 1.0).into(),
        ..mirror()
    };
    let mut stage = Stage::new(160, 120)
        .with_virtual(wall)
        .lit(lighting(vec![lamp], 0.0));
    stage.pose = Some(looking_from(
        DVec3::new(-0.35, -0.1, 0.25),
        DVec3::new(-0.05, 0.0, 0.05),
    ));
    stage.picture = flat(160, 120, REAL);
    stage
}

#[test]
fn ground_beside_the_picture_is_darker_far_from_a_near_lamp() {
    let far = beside_the_picture(0.0);
    let near = beside_the_picture(1.0 / HEIGHT);
    let pictures = [&far, &near].map(Stage::compose);
    let pose = far.pose.unwrap();
    let (camera, size) = (&far.camera, DVec2::new(160.0, 120.0));
    let pixel_of = |p: DVec3| camera.project(pose.inverse().transform_point(p));
    let on_ground = |pixel: DVec2| {
        let ray = pose.rotation * camera.unproject(pixel);
        pose.translation - ray * (pose.translation.z / ray.z)
    };
    let lit = |p: DVec3| (1.0 + p.length_squared() / f64::from(HEIGHT * HEIGHT)).powf(-1.5);
    let mut compared = 0;
    for (x, y) in (0..10).flat_map(|i| (0..4).map(move |j| (i, j))) {
        let foot = DVec3::new(-0.16 - 0.03 * f64::from(y), 0.1 + 0.02 * f64::from(x), 0.0);
        let image = DVec3::new(-0.24 - foot.x, foot.y, 0.0);
        let (Some(beside), Some(shown)) = (pixel_of(foot), pixel_of(image)) else {
            continue;
        };
        let edge = beside.clamp(DVec2::splat(-0.5), size - 0.5);
        let at = shown.round();
        if edge == beside || at.cmplt(DVec2::ZERO).any() || at.cmpge(size).any() {
            continue;
        }
        let [far_code, near_code] = pictures
            .each_ref()
            .map(|picture| picture.rgb(at.x as u32, at.y as u32)[0]);
        let [far, near] =
            [far_code, near_code].map(|code| near.response.linear_from_rgb([code; 3])[0]);
        let expected = lit(foot) / lit(on_ground(edge));
        let found = f64::from(near / far);
        assert!(
            (found / expected - 1.0).abs() < 0.1,
            "{foot} {found} {expected} {far_code}"
        );
        compared += 1;
    }
    assert!(compared > 10, "{compared}");
}
