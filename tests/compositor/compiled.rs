//! What was compiled is kept, and what a scene brings is compiled before it is shown.

use crate::stage::{Stage, camera, gpu, lighting, part, spiral};
use glam::{DVec3, Vec3};
use penumbra_camera::RollingShutter;
use penumbra_compositor::{Exposure, Gpu};
use penumbra_scene::{Scene, VirtualLight, VirtualLightKey, VirtualLightKind, casters, primitives};
use std::time::{Duration, Instant};

/// A device on which nothing was compiled yet.
fn fresh_gpu() -> Gpu {
    Gpu::open(Some(&gpu().name)).unwrap()
}

fn lamp() -> VirtualLight {
    VirtualLight {
        name: "lamp".to_owned(),
        kind: VirtualLightKind::Point,
        intensity: Vec3::ONE,
        screen: None,
        keys: vec![VirtualLightKey {
            seconds: 0.0,
            position: DVec3::new(0.0, 0.1, 0.3),
            target: None,
            gain: 1.0,
        }],
        repeat: None,
    }
}

fn stage() -> Stage {
    Stage::new(32, 24)
        .with_virtual(part(
            primitives::cuboid(Vec3::splat(0.1)),
            DVec3::new(0.0, 0.0, 0.05),
        ))
        .lit(lighting(spiral(4, 2.0), 0.2))
}

#[test]
fn first_lamp_of_an_uploaded_scene_is_compiled_before_it_is_shown() {
    let mut stage = stage();
    let device = fresh_gpu();
    let mut compositor = stage.compositor_on(device.clone());
    let dark = stage.compose_with(&mut compositor);

    let scene = Scene {
        lamps: vec![lamp()],
        ..stage.scene.clone()
    };
    let before = device.device.pipelines_compiled();
    let uploaded = compositor.uploader().upload(&scene, &casters(&scene));
    let after_upload = device.device.pipelines_compiled();
    assert!(after_upload > before, "the lamp needs other shaders");
    compositor.show_scene(uploaded);
    scene.lamps_at(0.0, &mut stage.lamps);
    let lit = stage.compose_with(&mut compositor);
    assert!(lit != dark);
    assert_eq!(device.device.pipelines_compiled(), after_upload);
}

#[test]
fn first_lamp_is_compiled_in_an_exposure_too_after_compiling_ahead() {
    let mut stage = stage();
    stage.exposure = Exposure::Stops(-1.0);
    let device = fresh_gpu();
    let mut compositor = stage.compositor_on(device.clone());
    compositor.compile(false, false);
    stage.compose_with(&mut compositor);
    let scene = Scene {
        lamps: vec![lamp()],
        ..stage.scene.clone()
    };
    let uploaded = compositor.uploader().upload(&scene, &casters(&scene));
    let after_upload = device.device.pipelines_compiled();
    compositor.show_scene(uploaded);
    scene.lamps_at(0.0, &mut stage.lamps);
    stage.compose_with(&mut compositor);
    assert_eq!(device.device.pipelines_compiled(), after_upload);
}

#[test]
fn lamp_of_the_first_scene_is_compiled_ahead() {
    let mut stage = stage();
    stage.scene.lamps = vec![lamp()];
    stage.scene.lamps_at(0.0, &mut stage.lamps);
    let device = fresh_gpu();
    let mut compositor = stage.compositor_on(device.clone());
    compositor.compile(false, false);
    let compiled = device.device.pipelines_compiled();
    stage.compose_with(&mut compositor);
    assert_eq!(device.device.pipelines_compiled(), compiled);
}

#[test]
fn new_exposure_is_shown_once_it_is_compiled_and_no_picture_waits() {
    let mut stage = stage();
    stage.settings.in_background = true;
    let device = fresh_gpu();
    let mut compositor = stage.compositor_on(device);
    let own = stage.compose_with(&mut compositor);
    stage.exposure = Exposure::Stops(-1.0);
    let meanwhile = stage.compose_with(&mut compositor);
    assert_eq!(compositor.exposure().stops, 0.0);
    assert_eq!(compositor.exposure().target, -1.0);
    assert!(meanwhile == own);
    let deadline = Instant::now() + Duration::from_secs(60);
    let mut shown = meanwhile;
    while shown == own && Instant::now() < deadline {
        shown = stage.compose_with(&mut compositor);
    }
    assert_eq!(compositor.exposure().stops, -1.0);
    stage.settings.in_background = false;
    assert!(shown == stage.compose_with(&mut stage.compositor_on(fresh_gpu())));
}

#[test]
fn another_compositor_on_the_same_device_compiles_nothing() {
    let stage = stage();
    let device = fresh_gpu();
    let first = stage.compose_with(&mut stage.compositor_on(device.clone()));
    let compiled = device.device.pipelines_compiled();
    let second = stage.compose_with(&mut stage.compositor_on(device.clone()));
    assert!(compiled > 0 && first == second);
    assert_eq!(device.device.pipelines_compiled(), compiled);
}

#[test]
fn change_of_the_camera_and_back_compiles_nothing_more() {
    let device = fresh_gpu();
    let plain = stage();
    let mut rolling = stage();
    rolling.rolling_shutter = Some(RollingShutter {
        rotation_per_row: DVec3::X * 1e-5,
        translation_per_row: DVec3::ZERO,
    });
    let picture = plain.compose_with(&mut plain.compositor_on(device.clone()));
    rolling.camera = camera(32, 24);
    rolling.compose_with(&mut rolling.compositor_on(device.clone()));
    let compiled = device.device.pipelines_compiled();
    let again = plain.compose_with(&mut plain.compositor_on(device.clone()));
    assert!(again == picture);
    assert_eq!(device.device.pipelines_compiled(), compiled);
}
