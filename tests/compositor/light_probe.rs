//! A mirrored sphere in the camera's own picture as a light probe, and objects lit by its light.

use crate::golden::assert_golden;
use crate::stage::{Stage, painted, part, sun};
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::Response;
use penumbra_camera::{EnvironmentView, MirrorSphere};
use penumbra_interface::MonotonicTime;
use penumbra_lighting::{
    Bracket, EnvironmentEstimator, EnvironmentInput, EnvironmentSettings, Lighting, SpherePosition,
};
use penumbra_picture::Picture;
use penumbra_scene::{
    GroundBrightness, IndirectLightSolver, Material, RealSurfaces, casters, primitives,
};

const SPHERE: DVec3 = DVec3::new(-0.1, 0.03, 0.05);
const RADIUS: f64 = 0.05;

/// A room: walls of many colours, brighter upwards, without clipping.
fn room(d: DVec3) -> Vec3 {
    let wave = ((3.0 * d.x).sin() * (2.0 * d.y).cos()) as f32;
    let up = d.z.max(0.0) as f32;
    Vec3::new(0.35 + 0.2 * wave, 0.3 + 0.1 * up, 0.25 + 0.35 * up)
}

/// Radiance of the table's squares; `None` for rays that go up.
fn table(eye: DVec3, ray: DVec3) -> Option<Vec3> {
    let foot = (ray.z < 0.0).then(|| eye - ray * (eye.z / ray.z))?;
    let odd = ((foot.x / 0.05).floor() + (foot.y / 0.05).floor()) as i64 % 2 != 0;
    Some(if odd {
        Vec3::new(0.1, 0.16, 0.2)
    } else {
        Vec3::new(0.5, 0.45, 0.4)
    })
}

/// Radiance towards `eye` along `ray` from a mirrored sphere in the room; `None` beside it.
fn mirrored(eye: DVec3, ray: DVec3, centre: DVec3) -> Option<Vec3> {
    let ray = ray.normalize();
    let along = ray.dot(centre - eye);
    let inside = RADIUS * RADIUS - ((centre - eye).length_squared() - along * along);
    (inside > 0.0 && along > 0.0).then(|| {
        let at = eye + ray * (along - inside.sqrt());
        let n = (at - centre) / RADIUS;
        let d = ray - n * (2.0 * ray.dot(n));
        table(at, d).unwrap_or_else(|| room(d))
    })
}

/// Mean over a pixel.
fn pixel(x: u32, y: u32, of: impl Fn(DVec2) -> Vec3) -> Vec3 {
    let part = |k: u32| f64::from(k) / 4.0 - 0.375;
    let at = |k: u32| DVec2::new(f64::from(x) + part(k % 4), f64::from(y) + part(k / 4));
    (0..16).map(|k| of(at(k))).sum::<Vec3>() / 16.0
}

/// The picture of a table with a mirrored sphere on it.
fn photograph(stage: &Stage) -> Picture {
    let pose = stage.pose.unwrap();
    let (eye, mut picture) = (pose.translation, stage.picture.clone());
    let shown = |at| {
        let ray = pose.rotation * stage.camera.unproject(at);
        let behind = || table(eye, ray).unwrap_or_else(|| room(ray.normalize()));
        mirrored(eye, ray, SPHERE).unwrap_or_else(behind)
    };
    let width = picture.width;
    for (i, texel) in picture.rgba.chunks_exact_mut(4).enumerate() {
        let linear = pixel(i as u32 % width, i as u32 / width, shown);
        let codes = linear
            .to_array()
            .map(|l| stage.response.code_from_linear(l));
        texel[..3].copy_from_slice(&codes);
    }
    picture
}

/// Reads the light from the sphere, whose assumed position has the error `off`.
fn read(stage: &Stage, off: DVec3) -> Lighting {
    let sphere = MirrorSphere {
        centre_in_world: SPHERE,
        radius: RADIUS,
        position_sigma: 0.0,
        reflectance: [1.0; 3],
        in_scene: true,
    };
    let settings = EnvironmentSettings {
        ground: true,
        ..EnvironmentSettings::default()
    };
    let view = EnvironmentView::SphereInScene { sphere };
    let mut estimator =
        EnvironmentEstimator::new(&view, &Response::srgb(), settings, None).unwrap();
    let brackets = [Bracket {
        ev: 0.0,
        picture: &stage.picture,
    }];
    let input = EnvironmentInput {
        scene: Some((stage.pose.unwrap(), &stage.camera)),
        sphere_position: Some(SpherePosition {
            centre_in_world: SPHERE + off,
            sigma: 1.5,
        }),
        ..EnvironmentInput::new(&brackets, MonotonicTime::default())
    };
    (*estimator.update(&input).unwrap()).clone()
}

/// A virtual sphere of this roughness to the right of the real one.
fn beside(roughness: f32) -> (Stage, DVec3) {
    let position = DVec3::new(0.06, 0.0, 0.05);
    let mirror = Material {
        metallic: 1.0,
        roughness,
        ..Material::default()
    };
    let sphere_part = painted(primitives::sphere(RADIUS as f32, 128, 64), position, mirror);
    let real = part(primitives::sphere(RADIUS as f32, 64, 32), SPHERE);
    let mut stage = Stage::new(200, 150)
        .with_virtual(sphere_part)
        .with_phantom(real);
    stage.picture = photograph(&stage);
    (stage, position)
}

#[test]
fn golden_a_virtual_sphere_beside_a_mirrored_one() {
    let (stage, _) = beside(0.25);
    let light = read(&stage, DVec3::new(0.001, 0.0, 0.0015));
    assert_golden("light-probe", &stage.lit(light).compose());
}

/// A virtual mirror shows the room that the real one showed, in spite of errors of the pose.
#[test]
fn virtual_mirror_shows_the_room_of_the_real_mirror() {
    for off in [DVec3::ZERO, DVec3::new(0.002, 0.0, -0.0015)] {
        let (stage, position) = beside(0.0);
        let light = read(&stage, off);
        let (pose, camera) = (stage.pose.unwrap(), stage.camera.clone());
        let composed = stage.clone().lit(light).compose();
        let mut differences = Vec::new();
        for (x, y) in (0..150).flat_map(|y| (0..200).map(move |x| (x, y))) {
            let ray = |at| pose.rotation * camera.unproject(at);
            let ray = ray(DVec2::new(f64::from(x), f64::from(y))).normalize();
            let along = ray.dot(position - pose.translation);
            let miss = (position - pose.translation - ray * along).length();
            let Some(shown) = mirrored(pose.translation, ray, position) else {
                continue;
            };
            let at = pose.translation + ray * (along - (RADIUS * RADIUS - miss * miss).sqrt());
            let n = (at - position) / RADIUS;
            // The upper half, without the rim.
            if (ray - n * (2.0 * ray.dot(n))).z > 0.1 && miss < 0.9 * RADIUS {
                let codes = shown.to_array().map(|l| stage.response.code_from_linear(l));
                let pairs = composed.rgb(x, y).into_iter().zip(codes);
                differences.extend(pairs.map(|(a, b)| f64::from(a.abs_diff(b))));
            }
        }
        let mean = differences.iter().sum::<f64>() / differences.len() as f64;
        assert!(differences.len() > 600 && mean < 4.0, "{off}: {mean}");
    }
}

fn pixel_of(stage: &Stage, at: DVec3) -> (u32, u32) {
    let seen = stage.pose.unwrap().inverse().transform_point(at);
    let pixel = stage.camera.project(seen).unwrap();
    (pixel.x.round() as u32, pixel.y.round() as u32)
}

/// A red box tints the table beside it by indirect light.
#[test]
fn golden_a_red_box_tints_the_table() {
    let red = Material {
        base_colour: Vec3::new(0.8, 0.05, 0.03).extend(1.0),
        roughness: 1.0,
        ..Material::default()
    };
    let cuboid = primitives::cuboid(Vec3::new(0.08, 0.08, 0.1));
    let light = crate::stage::lighting(vec![sun(Vec3::new(0.3, -0.8, 0.5), Vec3::splat(1.6))], 0.3);
    let mut stage = Stage::new(200, 150)
        .with_virtual(painted(cuboid, DVec3::new(0.0, 0.06, 0.0), red))
        .lit(light.clone());
    stage.picture = Stage::new(200, 150).picture;
    let plain = stage.compose();
    let virtual_casters = casters(&stage.scene);
    let mut near = IndirectLightSolver::new(&stage.scene, &virtual_casters).unwrap();
    let real = RealSurfaces {
        phantoms: &[],
        ground: &GroundBrightness::default(),
    };
    near.update(&light, real, &[]);
    stage.near = Some(near.light().clone());
    let tinted = stage.compose();
    // In front of the box's lit side: redder, and not darker.
    let (x, y) = pixel_of(&stage, DVec3::ZERO);
    let (before, after) = (plain.rgb(x, y), tinted.rgb(x, y));
    assert!(after[0] > before[0] + 4, "{before:?} {after:?}");
    assert!(after[2].abs_diff(before[2]) <= 4, "{before:?} {after:?}");
    assert_golden("red-box", &tinted);
}
