//! Basis images against closed-form ground truth: one light, one plane, one box.

use crate::stage::{gpu, part};
use glam::{DVec2, DVec3, Vec3};
use penumbra_compositor::planes::bake;
use penumbra_lighting::geodesic::GeodesicDome;
use penumbra_scene::planes::{
    Bake, BakeSettings, Image, Layer, Receiver, ReceiverImage, ShadowingPlane,
};
use penumbra_scene::{Scene, primitives};
use std::ops::ControlFlow;

const SIDE: u32 = 128;

/// A horizontal plane, two metres a side.
pub fn ground() -> ShadowingPlane {
    ShadowingPlane {
        centre: DVec3::ZERO,
        right: DVec3::X,
        up: DVec3::Y,
        half_size: DVec2::splat(1.0),
        depth: 0.05,
        layer: Layer::Real,
        receiver: Receiver::Plane,
        parts: Vec::new(),
    }
}

const LOW: DVec3 = DVec3::new(-0.15, -0.2, 0.1);
const HIGH: DVec3 = DVec3::new(0.15, 0.2, 0.4);

/// A box above the ground.
pub fn floating_box() -> Scene {
    let size = (HIGH - LOW).as_vec3();
    Scene {
        virtual_parts: vec![part(primitives::cuboid(size), DVec3::new(0.0, 0.0, LOW.z))],
        phantom_parts: vec![part(primitives::plane(8.0, 8.0), DVec3::ZERO)],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

/// Whether a ray hits the box (slab method).
fn hidden(from: DVec3, towards: DVec3) -> bool {
    let (a, b) = ((LOW - from) / towards, (HIGH - from) / towards);
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    near.max(0.0) < far
}

fn texel_in_world(plane: &ShadowingPlane, x: f64, y: f64) -> DVec3 {
    let at = DVec2::new(x, f64::from(SIDE) - y) / f64::from(SIDE) * 2.0 - 1.0;
    plane.centre + plane.right * (at.x * plane.half_size.x) + plane.up * (at.y * plane.half_size.y)
}

/// Fraction of a texel in the box's shadow, from 100 of its points.
fn covered(plane: &ShadowingPlane, x: f64, y: f64, towards: DVec3) -> f64 {
    let at = |k: i32| (f64::from(k) + 0.5) / 10.0;
    let points = (0..100).map(|k| texel_in_world(plane, x + at(k % 10), y + at(k / 10)));
    points.filter(|p| hidden(*p, towards)).count() as f64 / 100.0
}

/// Fraction of a light that arrives, 0 to 255; `cosine` is the light's on the plane. The lost light
/// is stored in steps of 1/255, so that the fraction has larger steps for low lights.
fn arriving(bake: &Bake, image: Image, cosine: f32) -> Vec<u8> {
    let one = bake.settings.resolution.pow(2) as usize;
    let share = |lost: &u8| (255.0 - f32::from(*lost) / cosine).round().max(0.0) as u8;
    match image {
        Image::Black => vec![0; one],
        Image::White => vec![255; one],
        Image::Stored(i) => {
            let lost = &bake.texels[i as usize * one..][..one];
            lost.iter().map(share).collect()
        }
    }
}

fn baked(scene: &Scene, planes: Vec<ShadowingPlane>, samples: u32) -> Bake {
    let settings = BakeSettings {
        resolution: SIDE,
        frequency: 2,
        samples,
    };
    bake(&gpu(), scene, planes, settings, &mut |_, _| {
        ControlFlow::Continue(())
    })
    .unwrap()
}

#[test]
fn shadow_of_a_box_on_a_plane_is_exact() {
    let plane = ground();
    let bake = baked(&floating_box(), vec![plane.clone()], 1);
    let dome = GeodesicDome::new(2).unwrap();
    assert_eq!(bake.lights(), dome.faces.len());
    for (face, basis) in dome.faces.iter().zip(&bake.images) {
        assert_eq!(basis.past_phantoms, Image::White);
        let towards = face.centre.as_dvec3();
        let image = arriving(&bake, basis.past_all, face.centre.z);
        // Half a quantisation step.
        let step = (0.5 / face.centre.z).ceil() as u8;
        let (mut sum, mut exact) = (0.0, 0.0);
        for (i, open) in image.iter().enumerate() {
            let (x, y) = ((i as u32 % SIDE) as f64, (i as u32 / SIDE) as f64);
            // Nine points, spread beyond the texel by the blur of a map's texel.
            let point = |k: i32, wide: f64| {
                let o = DVec2::new(f64::from(k % 3), f64::from(k / 3)) - 1.0;
                hidden(
                    texel_in_world(&plane, x + 0.5 + o.x * wide, y + 0.5 + o.y * wide),
                    towards,
                )
            };
            let hits = (0..9).filter(|k| point(*k, 0.75)).count();
            match hits {
                0 => assert!(*open >= 255 - step, "{x} {y} {towards}: {open}"),
                9 => assert!(*open <= step, "{x} {y} {towards}: {open}"),
                _ => (),
            }
            sum += 1.0 - f64::from(*open) / 255.0;
            exact += covered(&plane, x, y, towards);
        }
        assert!(
            (sum - exact).abs() < (0.01 + f64::from(step) / 255.0) * exact,
            "{towards}: {sum} {exact}"
        );
    }
}

#[test]
fn images_of_lights_behind_a_wall_are_black_and_dropped() {
    let wall = ShadowingPlane {
        centre: DVec3::new(0.0, -0.22, 0.25),
        right: DVec3::X,
        up: DVec3::Z,
        half_size: DVec2::new(0.2, 0.2),
        depth: 0.1,
        layer: Layer::Virtual,
        receiver: Receiver::Surface,
        parts: vec![0],
    };
    assert_eq!(wall.normal(), DVec3::NEG_Y);
    let bake = baked(&floating_box(), vec![wall, ground()], 1);
    // Planes of the real layer come first.
    assert_eq!(bake.planes[0].layer, Layer::Real);
    let receiver = &bake.receivers[1];
    let centre = (SIDE * SIDE / 2 + SIDE / 2) as usize;
    let depth = f64::from(receiver.depths[centre]) / 65534.0 * 0.1;
    assert!((depth - 0.02).abs() < 1e-4, "{depth}");
    assert_eq!(receiver.depths[0], ReceiverImage::NOTHING);
    let dome = GeodesicDome::new(2).unwrap();
    let of_wall = &bake.images[dome.faces.len()..];
    for (face, basis) in dome.faces.iter().zip(of_wall) {
        // Nothing blocks the wall: it receives all of a light or nothing.
        let expected = if face.centre.y < 0.0 {
            Image::White
        } else {
            Image::Black
        };
        assert_eq!(basis.past_all, expected, "{:?}", face.centre);
    }
    let (lit, all) = bake.counts();
    assert_eq!(all, 80);
    assert_eq!(
        lit,
        40 + dome.faces.iter().filter(|f| f.centre.y < 0.0).count()
    );
}

#[test]
fn phantoms_have_their_own_basis_images() {
    let mut scene = floating_box();
    scene.phantom_parts.push(part(
        primitives::cuboid(Vec3::splat(0.3)),
        DVec3::new(0.5, 0.5, 0.0),
    ));
    let bake = baked(&scene, vec![ground()], 1);
    let dome = GeodesicDome::new(2).unwrap();
    for (face, basis) in dome.faces.iter().zip(&bake.images) {
        let (all, phantoms) = (
            arriving(&bake, basis.past_all, face.centre.z),
            arriving(&bake, basis.past_phantoms, face.centre.z),
        );
        let under = |x: f64, y: f64| {
            let column = ((x + 1.0) / 2.0 * f64::from(SIDE)) as usize;
            let row = ((1.0 - y) / 2.0 * f64::from(SIDE)) as usize;
            row * SIDE as usize + column
        };
        // Inside the phantom's footprint no light arrives, with or without virtual objects.
        assert!(phantoms[under(0.5, 0.5)] <= 3 && all[under(0.5, 0.5)] <= 3);
        assert_eq!(phantoms[under(-0.9, -0.9)], 255);
        // Virtual objects can only block more light.
        assert!(all.iter().zip(&phantoms).all(|(a, p)| a <= p));
        assert!(all.iter().zip(&phantoms).any(|(a, p)| a < p));
    }
}

#[test]
fn more_directions_per_face_soften_shadows_and_keep_the_light() {
    let hard = baked(&floating_box(), vec![ground()], 1);
    let soft = baked(&floating_box(), vec![ground()], 16);
    let dome = GeodesicDome::new(2).unwrap();
    for (face, (a, b)) in dome.faces.iter().zip(hard.images.iter().zip(&soft.images)) {
        let cosine = face.centre.z;
        let (a, b) = (
            arriving(&hard, a.past_all, cosine),
            arriving(&soft, b.past_all, cosine),
        );
        let between = |t: &[u8]| t.iter().filter(|v| (20..236).contains(*v)).count();
        assert!(between(&b) > between(&a), "{} {}", between(&b), between(&a));
        let lost = |t: &[u8]| t.iter().map(|v| 255.0 - f64::from(*v)).sum::<f64>();
        // Shadows of low lights extend beyond the plane, for some directions more than for others.
        assert!(
            (lost(&a) / lost(&b) - 1.0).abs() < 0.35,
            "{} {}",
            lost(&a),
            lost(&b)
        );
    }
}

#[test]
fn invalid_settings_are_refused_in_one_line() {
    for (resolution, frequency, samples) in [(130, 2, 1), (128, 0, 1), (128, 2, 3), (8, 2, 1)] {
        let settings = BakeSettings {
            resolution,
            frequency,
            samples,
        };
        let result = bake(
            &gpu(),
            &floating_box(),
            vec![ground()],
            settings,
            &mut |_, _| ControlFlow::Continue(()),
        );
        let text = result.unwrap_err().to_string();
        assert!(
            !text.contains('\n') && text.contains("cannot run"),
            "{text}"
        );
    }
}
