//! Pictures with shadowing planes, compared with the twin, which casts rays to the same lights.

use crate::comparison::{Rule, assert_like, assert_same_where, untouched, virtual_inside};
use crate::stage::{Stage, gpu, lighting, part, sun};
use glam::{DQuat, DVec2, DVec3, Vec3};
use penumbra_compositor::planes::{PlaneWork, PlanesChoice, Thresholds, bake, repair};
use penumbra_compositor::{Compositor, FrameInput, GpuError};
use penumbra_interface::RigidTransform;
use penumbra_lighting::Lighting;
use penumbra_lighting::geodesic::{FaceLight, GeodesicDome, Membership};
use penumbra_picture::Picture;
use penumbra_scene::PlaneShading;
use penumbra_scene::planes::renew::renew;
use penumbra_scene::planes::{
    Bake, BakeSettings, Image, Layer, PlaneSettings, Receiver, ShadowingPlane, generate,
};
use penumbra_scene::{Part, Scene, primitives};
use std::ops::ControlFlow;
use std::sync::Arc;

pub const EXACT: Thresholds = Thresholds {
    skip_below: 0.0,
    recompute_above: 0.0,
};

/// Lighting in which each face of the dome has its own luminance.
pub fn lit_by(luminance: &[Vec3], generation: u64) -> Lighting {
    let dome = GeodesicDome::new(2).unwrap();
    let lights = dome.faces.iter().zip(luminance);
    let lights = lights.map(|(f, s)| sun(f.centre, *s)).collect();
    let n = luminance.len() as u32;
    let membership = Membership {
        begins: (0..=n).collect(),
        pixels: (0..n).collect(),
        weights: vec![1.0; luminance.len()],
    };
    let mut lighting = lighting(lights, 0.0);
    lighting.generation = generation;
    lighting.faces = Some(Arc::new(FaceLight {
        frequency: 2,
        membership: Arc::new(membership),
        radiance: Arc::new(luminance.iter().map(|s| s.to_array()).collect()),
        sources: Vec::new(),
    }));
    lighting
}

/// A sky, bluer on one side, with a sun in one face.
fn sky() -> Vec<Vec3> {
    let dome = GeodesicDome::new(2).unwrap();
    let of = |(i, f): (usize, &penumbra_lighting::geodesic::Face)| {
        let sky = Vec3::new(0.8, 0.9, 1.0) * (0.04 + 0.02 * f.centre.x);
        sky + if i == 7 {
            Vec3::new(1.2, 1.1, 0.9)
        } else {
            Vec3::ZERO
        }
    };
    dome.faces.iter().enumerate().map(of).collect()
}

fn rectangle(centre: DVec3, right: DVec3, up: DVec3, half: f64, layer: Layer) -> ShadowingPlane {
    ShadowingPlane {
        centre,
        right,
        up,
        half_size: DVec2::splat(half),
        depth: 0.06,
        layer,
        receiver: if layer == Layer::Real {
            Receiver::Plane
        } else {
            Receiver::Surface
        },
        parts: vec![0],
    }
}

/// The table, and the sides of a box of 0.1 m at the origin.
pub fn planes() -> Vec<ShadowingPlane> {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let side = |normal: DVec3, right: DVec3, up: DVec3| {
        rectangle(z * 0.05 + normal * 0.055, right, up, 0.056, Layer::Virtual)
    };
    vec![
        rectangle(DVec3::ZERO, x, y, 0.5, Layer::Real),
        side(z, x, y),
        side(x, y, z),
        side(-x, -y, z),
        side(y, -x, z),
        side(-y, x, z),
    ]
}

pub fn cube() -> Part {
    part(primitives::cuboid(Vec3::splat(0.1)), DVec3::ZERO)
}

pub fn baked(stage: &Stage, planes: Vec<ShadowingPlane>) -> Bake {
    let settings = BakeSettings {
        resolution: 256,
        ..BakeSettings::default()
    };
    bake(&gpu(), &stage.scene, planes, settings, &mut |_, _| {
        ControlFlow::Continue(())
    })
    .unwrap()
}

pub fn stage_with(luminance: &[Vec3]) -> Stage {
    Stage::new(128, 96)
        .with_virtual(cube())
        .lit(lit_by(luminance, 1))
}

fn input(stage: &Stage, thresholds: Thresholds) -> FrameInput<'_> {
    FrameInput {
        planes: Some(PlanesChoice {
            thresholds,
            shading: PlaneShading::Irradiance,
        }),
        ..stage.input()
    }
}

pub fn compose(
    compositor: &mut Compositor,
    stage: &Stage,
    thresholds: Thresholds,
) -> (Picture, PlaneWork) {
    let mut out = Picture::default();
    compositor.compose(&input(stage, thresholds)).unwrap();
    compositor.read(&mut out).unwrap();
    (
        out,
        compositor
            .plane_work()
            .unwrap()
            .expect("planes are the technique"),
    )
}

fn compositor(stage: &Stage, planes: Vec<ShadowingPlane>) -> Compositor {
    let mut compositor = stage.compositor();
    compositor.set_bake(Some(&baked(stage, planes))).unwrap();
    compositor
}

#[test]
fn shadow_of_one_light_matches_the_twin() {
    let mut luminance = vec![Vec3::splat(0.02); 40];
    luminance[11] = Vec3::new(2.0, 1.8, 1.5);
    let stage = stage_with(&luminance);
    let (ours, _) = compose(&mut compositor(&stage, planes()), &stage, EXACT);
    assert_like("planes-sun", &ours, &stage.twin(), Rule::within(2));
}

#[test]
fn shading_by_a_sky_matches_the_twin() {
    let mut stage = stage_with(&sky());
    let (ours, work) = compose(&mut compositor(&stage, planes()), &stage, EXACT);
    assert_like(
        "planes-sky",
        &ours,
        &stage.twin(),
        Rule {
            calm: 0.1,
            ..Rule::within(2)
        },
    );
    assert!(work.images > 0 && work.images <= work.images_in_sight);
    // Virtual surfaces, without the ground's light on them.
    stage = stage.without_ground();
    let planes = planes().split_off(1);
    let (ours, _) = compose(&mut compositor(&stage, planes), &stage, EXACT);
    let rule = Rule {
        calm: 0.05,
        on_virtual: true,
        ..Rule::within(2)
    };
    assert_like("planes-box", &ours, &stage.twin(), rule);
}

#[test]
fn unshadowed_pixels_keep_the_cameras_codes() {
    let stage = stage_with(&sky());
    let (ours, _) = compose(&mut compositor(&stage, planes()), &stage, EXACT);
    let calm = untouched(&stage.twin(), 3);
    assert!(calm.iter().filter(|c| **c).count() > 100);
    assert_same_where("planes-open", &ours, &stage.picture, &calm);
}

#[test]
fn phantoms_shadow_virtual_objects_and_are_not_counted_twice() {
    let wall = part(
        primitives::cuboid(Vec3::new(0.3, 0.02, 0.25)),
        DVec3::new(0.0, 0.12, 0.0),
    );
    let mut luminance = vec![Vec3::splat(0.02); 40];
    let dome = GeodesicDome::new(2).unwrap();
    let behind = dome
        .faces
        .iter()
        .position(|f| f.centre.y > 0.5 && f.centre.z > 0.4)
        .unwrap();
    luminance[behind] = Vec3::splat(2.0);
    let stage = stage_with(&luminance).with_phantom(wall);
    // The wall receives shadows, too.
    let mut all = planes();
    all.push(ShadowingPlane {
        receiver: Receiver::Surface,
        parts: vec![1],
        ..rectangle(
            DVec3::new(0.0, 0.105, 0.125),
            DVec3::X,
            DVec3::Z,
            0.16,
            Layer::Real,
        )
    });
    let (ours, _) = compose(&mut compositor(&stage, all), &stage, EXACT);
    assert_like(
        "planes-phantom",
        &ours,
        &stage.twin(),
        Rule {
            calm: 0.1,
            ..Rule::within(3)
        },
    );
    // The box stands in the wall's shadow: its top is nearly dark.
    let twin = stage.twin();
    let inside = virtual_inside(&twin, 2);
    let tops = (0..inside.len()).filter(|i| inside[*i] && twin.pixels[*i].normal.z > 0.9);
    let tops: Vec<_> = tops.collect();
    assert!(!tops.is_empty());
    let dark = tops.iter().filter(|i| ours.rgba[4 * **i] < 140).count();
    let expected = tops
        .iter()
        .filter(|i| twin.picture.rgba[4 * **i] < 140)
        .count();
    assert!(
        dark.abs_diff(expected) * 10 <= tops.len(),
        "{dark} {expected} {}",
        tops.len()
    );
}

#[test]
fn added_differences_equal_recomputed_sums() {
    let mut luminance = sky();
    let mut stage = stage_with(&luminance);
    let mut ours = compositor(&stage, planes());
    let (_, first) = compose(&mut ours, &stage, EXACT);
    assert_eq!(first.recomputed, first.visible);
    for step in 0..6_u8 {
        luminance[usize::from(3 * step)] *= 1.5;
        luminance[30 - usize::from(step)] *= 0.5;
        stage.lighting = Some(lit_by(&luminance, 2 + u64::from(step)));
        let (picture, work) = compose(&mut ours, &stage, EXACT);
        // At most two lights on each plane; some planes face away from them.
        assert!(
            work.images > 0 && work.images <= 2 * work.visible,
            "{work:?}"
        );
        let (fresh, _) = compose(&mut compositor(&stage, planes()), &stage, EXACT);
        let off = picture
            .rgba
            .iter()
            .zip(&fresh.rgba)
            .map(|(a, b)| a.abs_diff(*b))
            .max();
        assert!(off <= Some(1), "{off:?}");
    }
}

#[test]
fn steady_light_needs_no_images_and_faint_lights_are_skipped() {
    let luminance = sky();
    let mut stage = stage_with(&luminance);
    let mut ours = compositor(&stage, planes());
    let faint = Thresholds {
        skip_below: 0.02,
        recompute_above: 0.05,
    };
    let (_, first) = compose(&mut ours, &stage, faint);
    assert!(first.lights_skipped > 0, "{first:?}");
    let thresholds = Thresholds {
        skip_below: 0.002,
        ..faint
    };
    let (_, repaired) = compose(&mut ours, &stage, thresholds);
    assert!(
        repaired.images > 0 && repaired.lights_skipped == 0,
        "{repaired:?}"
    );
    let (_, steady) = compose(&mut ours, &stage, thresholds);
    assert_eq!((steady.images, steady.recomputed), (0, 0));
    // Noise of one per cent.
    let noisy: Vec<_> = luminance
        .iter()
        .enumerate()
        .map(|(i, s)| *s * if i % 2 == 0 { 1.01 } else { 0.99 })
        .collect();
    stage.lighting = Some(lit_by(&noisy, 2));
    let (_, noise) = compose(&mut ours, &stage, thresholds);
    assert_eq!((noise.images, noise.recomputed), (0, 0));
    let mut cloudy = luminance;
    cloudy[7] *= 0.5;
    stage.lighting = Some(lit_by(&cloudy, 3));
    let (_, cloud) = compose(&mut ours, &stage, thresholds);
    assert!(
        cloud.images > 0 && cloud.images <= cloud.visible,
        "{cloud:?}"
    );
}

#[test]
fn hidden_planes_need_no_images_and_catch_up_when_visible() {
    let luminance = sky();
    let mut stage = stage_with(&luminance);
    let mut ours = compositor(&stage, planes());
    let (_, front) = compose(&mut ours, &stage, EXACT);
    assert!(front.visible < planes().len(), "{front:?}");
    stage.pose = Some(crate::stage::looking_from(
        DVec3::new(0.06, 0.4, 0.34),
        DVec3::ZERO,
    ));
    let (picture, back) = compose(&mut ours, &stage, EXACT);
    assert!(
        back.recomputed > 0 && back.recomputed < back.visible,
        "{back:?}"
    );
    let (fresh, _) = compose(&mut compositor(&stage, planes()), &stage, EXACT);
    assert_eq!(picture, fresh);
}

/// Fraction of the codes that differ by more than 3.
fn share_off(a: &Picture, b: &Picture) -> f64 {
    let differ = |(a, b): &(&u8, &u8)| a.abs_diff(**b) > 3;
    let count = a.rgba.iter().zip(&b.rgba).filter(differ).count();
    count as f64 / a.rgba.len() as f64
}

/// Light that is kept on surfaces is that of the planes of every pixel, for every
/// viewer, also after pictures with shadow maps.
#[test]
fn planes_on_surfaces_give_the_light_of_pixels() {
    let wall = part(
        primitives::cuboid(Vec3::new(0.3, 0.02, 0.25)),
        DVec3::new(0.0, 0.12, 0.0),
    );
    let mut stage = stage_with(&sky()).with_phantom(wall);
    let all = || {
        let centre = DVec3::new(0.0, 0.105, 0.125);
        let on_wall = ShadowingPlane {
            receiver: Receiver::Surface,
            parts: vec![1],
            ..rectangle(centre, DVec3::X, DVec3::Z, 0.16, Layer::Real)
        };
        planes().into_iter().chain([on_wall]).collect()
    };
    let turned = RigidTransform::new(DQuat::from_rotation_z(1.9), DVec3::ZERO);
    let behind = stage.pose.map(|pose| turned * pose);
    let before = std::mem::replace(&mut stage.pose, behind);
    let (expected_behind, _) = compose(&mut compositor(&stage, all()), &stage, EXACT);
    stage.pose = before;
    let (expected, _) = compose(&mut compositor(&stage, all()), &stage, EXACT);
    assert!(share_off(&expected, &expected_behind) > 0.05);

    stage.settings.cached = true;
    let mut kept = compositor(&stage, all());
    let (front, _) = compose(&mut kept, &stage, EXACT);
    assert!(share_off(&front, &expected) < 0.02);
    stage.pose = behind;
    let (picture, work) = compose(&mut kept, &stage, EXACT);
    assert_eq!(work.images, 0, "no plane is out of sight of a surface");
    assert!(share_off(&picture, &expected_behind) < 0.02);
    kept.compose(&stage.input()).unwrap();
    let (again, _) = compose(&mut kept, &stage, EXACT);
    assert_eq!(again, picture);
}

/// A model that is rotated and moved over the ground, under rotated light and seen by a camera that
/// moves with it, looks as before; nothing is baked again.
#[test]
fn moved_model_keeps_its_bake() {
    let luminance = sky();
    let before = stage_with(&luminance);
    let rotation = DQuat::from_rotation_z(0.6);
    let motion = RigidTransform::new(rotation, DVec3::new(0.3, -0.2, 0.0));
    let mut after = stage_with(&luminance);
    after.pose = before.pose.map(|pose| motion * pose);
    for part in &mut after.scene.virtual_parts {
        part.world_from_part = motion.to_matrix() * part.world_from_part;
    }
    // The faces rotate with the planes; the other lights are rotated here.
    let lighting = after.lighting.as_mut().unwrap();
    for light in &mut lighting.lights {
        light.direction = rotation.as_quat() * light.direction;
    }
    let mut moved = compositor(&before, planes());
    let (expected, _) = compose(&mut moved, &before, EXACT);
    moved.set_scene(&after.scene, &penumbra_scene::casters(&after.scene));
    moved.move_planes(motion);
    let (picture, work) = compose(&mut moved, &after, EXACT);
    assert_eq!(work.images, 0, "earlier sums remain valid");
    assert!(share_off(&picture, &expected) < 0.005);
    moved.move_planes(RigidTransform::IDENTITY);
    let (left_behind, _) = compose(&mut moved, &after, EXACT);
    assert!(share_off(&left_behind, &expected) > 0.02);
}

/// One of two objects changes: the repaired bake has the images of a complete new bake.
#[test]
#[expect(clippy::too_many_lines, reason = "steps of one scene")]
fn repaired_bake_equals_a_complete_bake() {
    let cube = |x: f64, size: f32| part(primitives::cuboid(Vec3::splat(size)), DVec3::X * x);
    let scene = |parts: Vec<Part>| Stage {
        scene: Scene {
            virtual_parts: parts,
            ..Stage::new(128, 96).scene
        },
        ..Stage::new(128, 96)
    };
    let old = scene(vec![cube(-0.5, 0.1), cube(0.2, 0.1)]).scene;
    let new = scene(vec![cube(-0.5, 0.1), cube(0.25, 0.12)]).scene;
    let generated = PlaneSettings {
        count: 20,
        ..PlaneSettings::default()
    };
    let bake_all = |scene: &Scene, planes: Vec<ShadowingPlane>| {
        let settings = BakeSettings {
            resolution: 64,
            ..BakeSettings::default()
        };
        let go_on = &mut |_, _| ControlFlow::Continue(());
        bake(&gpu(), scene, planes, settings, go_on).unwrap()
    };
    let before = bake_all(&old, generate(&old, &generated).unwrap());
    let renewal = renew(&before, &old, &new, &generated).unwrap();
    let (planes, images) = renewal.counts();
    assert!(
        planes > 0 && images > 0 && images < renewal.drawn.len(),
        "{planes} {images}"
    );
    let (mut reported_lights, mut all) = (Vec::new(), 0);
    let repaired = repair(&gpu(), &new, &before, &renewal, &mut |done, of| {
        reported_lights.push(done);
        all = of;
        ControlFlow::Continue(())
    });
    let repaired = repaired.unwrap();
    assert_eq!((reported_lights.last(), all), (Some(&40), 40));
    let fresh = bake_all(&new, renewal.planes.clone());
    assert_eq!(
        (&repaired.planes, &repaired.receivers),
        (&fresh.planes, &fresh.receivers)
    );
    let stored = |bake: &Bake, image: Image| match image {
        Image::Stored(n) => bake.texels[n as usize * 64 * 64..][..64 * 64].to_vec(),
        Image::Black => vec![255],
        Image::White => vec![0],
    };
    let mut off = 0;
    for (a, b) in repaired.images.iter().zip(&fresh.images) {
        for (a, b) in [(a.past_all, b.past_all), (a.past_phantoms, b.past_phantoms)] {
            let (a, b) = (stored(&repaired, a), stored(&fresh, b));
            // Maps are fitted to all casters: an edge may fall into another of their texels.
            let differ = a.iter().zip(&b).filter(|(a, b)| a.abs_diff(**b) > 40);
            assert!(
                a.len() == b.len() && differ.count() <= 12,
                "{} {}",
                a.len(),
                b.len()
            );
            off += usize::from(a != b);
        }
    }
    assert!(
        off * 4 < repaired.images.len(),
        "{off} of {}",
        repaired.images.len()
    );
    let stopped = repair(&gpu(), &new, &before, &renewal, &mut |_, _| {
        ControlFlow::Break(())
    });
    assert!(matches!(stopped, Err(GpuError::Stopped)));
}

#[test]
fn six_lights_and_all_lights_shade_similarly_on_average() {
    let stage = stage_with(&sky()).without_ground();
    let planes = planes().split_off(1);
    let mut ours = compositor(&stage, planes);
    let mut mean = |shading| {
        let choice = PlanesChoice {
            thresholds: EXACT,
            shading,
        };
        let mut out = Picture::default();
        let input = FrameInput {
            planes: Some(choice),
            ..stage.input()
        };
        ours.compose(&input).unwrap();
        ours.read(&mut out).unwrap();
        let inside = virtual_inside(&stage.twin(), 1);
        let codes = (0..inside.len())
            .filter(|i| inside[*i])
            .map(|i| f64::from(out.rgba[4 * i]));
        let (sum, n) = codes.fold((0.0, 0), |(s, n), v| (s + v, n + 1));
        sum / f64::from(n)
    };
    let [exact, all, six] = [
        PlaneShading::Irradiance,
        PlaneShading::Lights,
        PlaneShading::Six,
    ]
    .map(&mut mean);
    // The environment's lights are the faces' own here.
    assert!((exact - all).abs() < 1.0, "{exact} {all}");
    assert!(
        (six / all - 1.0).abs() < 0.25 && (six - all).abs() > 0.1,
        "{six} {all}"
    );
}
