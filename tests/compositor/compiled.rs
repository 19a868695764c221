//! What was compiled is kept, and what a scene brings is compiled before it is shown.

use crate::stage::{Stage, camera, gpu, lighting, part, spiral};
use glam::{DVec3, Vec3};
use penumbra_camera::RollingShutter;
use penumbra_compositor::Gpu;
use penumbra_scene::{Scene, VirtualLight, VirtualLightKey, VirtualLightKind, casters, primitives};

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
