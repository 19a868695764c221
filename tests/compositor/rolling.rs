//! Virtual objects under a rolling shutter: they are skewed like the real ones.

use crate::soft_dots;
use crate::stage::{Stage, flat, lighting, looking_from, spiral};
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::RigidTransform;

const SIZE: (u32, u32) = (320, 240);
/// Seconds between successive rows.
const ROW: f64 = 60e-6;

fn camera(distortion: [f64; 5]) -> PinholeCamera {
    PinholeCamera {
        width: SIZE.0,
        height: SIZE.1,
        focal: DVec2::new(300.0, 301.0),
        centre: DVec2::new(158.3, 121.6),
        distortion,
    }
}

/// The camera's pose `seconds` after the middle row: a metre above a table, moved by hand.
fn pose(seconds: f64) -> RigidTransform {
    let still = looking_from(DVec3::Z, DVec3::ZERO);
    RigidTransform::new(
        still.rotation * DQuat::from_scaled_axis(DVec3::new(0.2, -0.9, 0.3) * seconds),
        still.translation + DVec3::new(0.5, 0.2, 0.1) * seconds,
    )
}

/// Position of a point of the world in the picture: seen by the row in which it appears, with the
/// camera's pose at that row's own time.
fn seen(camera: &PinholeCamera, world: DVec3, row_seconds: f64) -> DVec2 {
    let mut pixel = DVec2::ZERO;
    let mut seconds = 0.0;
    for _ in 0..30 {
        let there = pose(seconds).inverse().transform_point(world);
        pixel = camera.project(there).unwrap();
        seconds = (pixel.y - RollingShutter::middle_row(camera)) * row_seconds;
    }
    pixel
}

/// Root mean square and maximum error of 25 dots' positions, pixels.
fn dot_errors(distortion: [f64; 5], moves: bool, rolling: bool) -> (f64, f64) {
    const SIDE: f64 = 0.04;
    let camera = camera(distortion);
    let mut stage = Stage::new(SIZE.0, SIZE.1).without_ground();
    stage.camera = camera.clone();
    stage.pose = Some(pose(0.0));
    stage.picture = flat(SIZE.0, SIZE.1, [0, 0, 0]);
    let mut stage = stage.lit(lighting(spiral(8, 2.0), 0.5));
    let grid = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j)));
    let positions: Vec<DVec3> = grid
        .map(|(i, j)| DVec3::new(0.18 * f64::from(i), 0.135 * f64::from(j), 0.1))
        .collect();
    for position in &positions {
        stage = stage.with_virtual(soft_dots::dot(SIDE, *position));
    }
    let mut compositor = stage.compositor();
    let motion = RollingShutter::between(&pose(-0.01), &pose(0.01), 0.02, ROW);
    stage.rolling_shutter = motion.filter(|_| rolling);
    let out = stage.compose_with(&mut compositor);
    let row = if moves { ROW } else { 0.0 };
    let distance = |position: &DVec3| {
        let truth = soft_dots::truth(SIDE, *position, |world| seen(&camera, world, row));
        soft_dots::found(&out, truth, 12).distance(truth)
    };
    soft_dots::rms_and_worst(&positions.iter().map(distance).collect::<Vec<_>>())
}

fn assert_skewed_by_the_shutter(distortion: [f64; 5]) {
    let (_, baseline) = dot_errors(distortion, false, false);
    let (_, before) = dot_errors(distortion, true, false);
    let (rms, after) = dot_errors(distortion, true, true);
    println!(
        "{distortion:?}: worst of 25 dots {baseline:.3} px at rest; moved {before:.2} px without, \
         {after:.3} px with ({rms:.3} px root mean square)"
    );
    assert!(baseline < 0.06 && before > 0.8, "{baseline} {before}");
    assert!(after < 0.1, "{after}");
}

#[test]
fn objects_are_skewed_by_the_shutter() {
    assert_skewed_by_the_shutter([0.0; 5]);
}

#[test]
fn objects_are_skewed_behind_distorting_lenses() {
    for distortion in [
        [-0.25, 0.07, 0.001, 0.0, 0.0],
        [-0.45, 0.35, -0.001, 0.002, -0.08],
        [0.25, 0.0, -0.002, 0.001, 0.03],
    ] {
        assert_skewed_by_the_shutter(distortion);
    }
}
