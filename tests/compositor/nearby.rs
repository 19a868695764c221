//! Glossy surfaces mirror what stands close by.

use crate::stage::{Stage, even_sky, flat, painted, part};
use glam::{DVec2, DVec3, Vec3};
use penumbra_picture::Picture;
use penumbra_scene::{Material, Part, primitives};

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
