//! Reprojection of a finished picture to the pose at which it is displayed.

use crate::stage::{Stage, camera, flat, lighting, looking_from, matt, painted, spiral};
use glam::{DQuat, DVec2, DVec3, Vec3};
use penumbra_camera::PinholeCamera;
use penumbra_compositor::{LensOutput, Reprojection};
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;
use penumbra_scene::primitives;

const SIZE: (u32, u32) = (320, 240);

fn lens(distortion: [f64; 5]) -> PinholeCamera {
    PinholeCamera {
        focal: DVec2::new(260.0, 262.0),
        centre: DVec2::new(157.3, 121.6),
        distortion,
        ..camera(SIZE.0, SIZE.1)
    }
}

/// Waves of a dozen pixels painted on a wall at `depth` from the eye.
fn paint(p: DVec2) -> [u8; 3] {
    let wave = |along: f64| (127.0 + 90.0 * along.sin()).round() as u8;
    [
        wave(130.0 * p.x),
        wave(110.0 * p.y),
        wave(90.0 * (p.x + p.y)),
    ]
}

/// The direction on z = 1 that a pixel shows.
fn direction(camera: &PinholeCamera, pixel: DVec2) -> DVec2 {
    let ray = camera.unproject(pixel);
    ray.truncate() / ray.z
}

/// The camera's view of the wall; the camera's pose relative to the eye is `eye_from_camera`.
fn seen(camera: &PinholeCamera, eye_from_camera: RigidTransform, depth: f64) -> Picture {
    let mut picture = flat(camera.width, camera.height, [0, 0, 0]);
    for (i, rgba) in picture.rgba.chunks_exact_mut(4).enumerate() {
        let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
        let ray = direction(camera, DVec2::new(x.into(), y.into())).extend(1.0);
        let (from, along) = (eye_from_camera.translation, eye_from_camera.rotation * ray);
        let point = from + along * ((depth - from.z) / along.z);
        rgba[..3].copy_from_slice(&paint(point.truncate() / depth));
    }
    picture
}

/// Maximum and mean difference of two pictures, without a margin.
fn differences(a: &Picture, b: &Picture, margin: u32) -> (u8, f64) {
    let (mut worst, mut sum, mut count) = (0, 0.0, 0.0);
    for y in margin..a.height - margin {
        for x in margin..a.width - margin {
            let i = 4 * (y * a.width + x) as usize;
            for c in 0..3 {
                let off = a.rgba[i + c].abs_diff(b.rgba[i + c]);
                worst = worst.max(off);
                sum += f64::from(off);
                count += 1.0;
            }
        }
    }
    (worst, sum / count)
}

fn moved() -> Reprojection {
    Reprojection {
        camera_from_eye: RigidTransform::new(
            DQuat::from_euler(glam::EulerRot::YXZ, 0.04, -0.03, 0.02),
            DVec3::new(0.02, -0.012, 0.015),
        ),
        depth: 0.7,
    }
}

#[test]
fn reprojected_wall_matches_the_view_from_the_eye() {
    let lenses = [
        [0.0; 5],
        [-0.28, 0.09, 0.004, -0.003, 0.0],
        [0.2, -0.04, 0.0, 0.001, 0.0],
    ];
    for distortion in lenses {
        let camera = lens(distortion);
        let reprojection = moved();
        let there = reprojection.camera_from_eye.inverse();
        let mut stage = Stage::new(SIZE.0, SIZE.1).without_ground();
        stage.camera = camera.clone();
        stage.picture = seen(&camera, there, reprojection.depth);
        let mut compositor = stage.compositor();
        stage.reprojection = Some(reprojection);
        let out = stage.compose_with(&mut compositor);
        let truth = seen(&camera, RigidTransform::IDENTITY, reprojection.depth);
        let (worst, mean) = differences(&out, &truth, 30);
        let (_, before) = differences(&stage.picture, &truth, 30);
        println!(
            "{distortion:?}: worst {worst}, mean {mean:.2} codes; not reprojected {before:.1}"
        );
        assert!(worst <= 4 && mean < 0.6, "{distortion:?}: {worst}, {mean}");
        assert!(before > 20.0, "{before}");
        // Without reprojection the picture is the camera's again, bit for bit.
        stage.reprojection = None;
        assert_eq!(stage.compose_with(&mut compositor).rgba, stage.picture.rgba);
    }
}

/// Virtual objects are reprojected with the picture: an object on the wall appears where a camera
/// at the eye would draw it.
#[test]
fn virtual_objects_are_reprojected_with_the_picture() {
    let reprojection = moved();
    let eye = looking_from(DVec3::new(0.0, 0.0, reprojection.depth), DVec3::ZERO);
    let plate = |at: DVec3| {
        painted(
            primitives::plane(0.12, 0.09),
            at,
            matt(Vec3::new(0.9, 0.3, 0.1)),
        )
    };
    let mut stage = Stage::new(SIZE.0, SIZE.1)
        .without_ground()
        .with_virtual(plate(DVec3::new(0.05, -0.03, 0.0)))
        .lit(lighting(spiral(8, 2.0), 0.5));
    stage.camera = lens([-0.2, 0.05, 0.0, 0.0, 0.0]);
    stage.picture = flat(SIZE.0, SIZE.1, [40, 60, 50]);
    stage.pose = Some(eye * reprojection.camera_from_eye.inverse());
    let mut compositor = stage.compositor();
    for lens_output in [LensOutput::Camera, LensOutput::Undistorted] {
        compositor.set_lens_output(lens_output);
        stage.reprojection = Some(reprojection);
        let out = stage.compose_with(&mut compositor);
        stage.reprojection = None;
        let original = stage.compose_with(&mut compositor);
        let there = Stage {
            pose: Some(eye),
            ..stage.clone()
        };
        let truth = there.compose_with(&mut compositor);
        let (_, mean) = differences(&out, &truth, 30);
        let (_, before) = differences(&original, &truth, 30);
        println!("{lens_output:?}: mean {mean:.3} codes, not reprojected {before:.3}");
        assert!(mean < 0.15 * before, "{mean} of {before}");
    }
}
