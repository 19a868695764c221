//! Tests poses by markers under a rolling shutter.
use super::*;

/// Readout time from one row to the next, seconds: 29 ms for the picture, typical of cheap sensors.
const ROW: f64 = 60e-6;
/// Time from one picture to the next, seconds.
const STEP: f64 = 1.0 / 30.0;
/// Number of pictures; the first has no predecessor that determines the camera's motion.
const PICTURES: u32 = 3;

/// `map_from_camera` at `seconds` after the first picture's middle row: a hand-held camera half a
/// metre from the tags.
fn pose(seconds: f64) -> RigidTransform {
    let start = RigidTransform::new(
        DQuat::from_euler(glam::EulerRot::XYZ, 0.45, -0.25, 0.1),
        DVec3::new(0.02, -0.03, 0.5),
    );
    let start = start.inverse();
    RigidTransform::new(
        start.rotation * DQuat::from_scaled_axis(DVec3::new(0.2, -0.6, 0.3) * seconds),
        start.translation + DVec3::new(0.25, 0.1, 0.05) * seconds,
    )
}

fn camera() -> PinholeCamera {
    PinholeCamera {
        distortion: [-0.2, 0.05, 0.001, 0.0, 0.0],
        ..synthetic::camera()
    }
}

fn tags() -> [Tag; 3] {
    [
        synthetic::tag(1, 0.07, DVec3::new(-0.13, -0.1, 0.0)),
        synthetic::tag(2, 0.07, DVec3::new(0.12, -0.08, 0.0)),
        synthetic::tag(3, 0.07, DVec3::new(0.0, 0.11, 0.0)),
    ]
}

fn registration(tags: &[Tag], row_seconds: f64) -> TagRegistration {
    TagRegistration {
        detector: Detector::new(&[Family::Tag36h11], &Response::srgb()),
        camera: camera(),
        row_seconds,
        registrar: Some(Registrar::new(TagMap::new(tags.to_vec()).unwrap())),
        hybrid: None,
        rejected: 0,
        marked_sphere: None,
        fixed_sphere: None,
        placed_ball: None,
        refiner: None,
    }
}

/// Errors of the last picture's pose relative to the ground truth of its middle row: largest
/// displacement of points around the tags, pixels; position, millimetres; orientation, degrees.
fn pose_error(tags: &[Tag], row_seconds: f64, tracked: bool) -> [f64; 3] {
    let camera = camera();
    let middle = RollingShutter::middle_row(&camera);
    let mut registration = registration(tags, row_seconds);
    let mut found = None;
    for k in 0..PICTURES {
        let at = f64::from(k) * STEP;
        let of_row = |row: f64| pose(at + (row - middle) * ROW);
        let codes = synthetic::render_rolling(&camera, of_row, tags, 1.0);
        let picture = Picture {
            width: camera.width,
            height: camera.height,
            rgba: codes.iter().flat_map(|&c| [c, c, c, 255]).collect(),
        };
        let ends = [pose(at - 0.01), pose(at + 0.01)];
        let tracker = TrackerEstimate {
            pose: None,
            motion: RollingShutter::between(&ends[0], &ends[1], 0.02, row_seconds)
                .filter(|_| tracked),
        };
        let nanos = MonotonicTime::from_nanos((at * 1e9) as i64);
        found = registration
            .register(&picture, tracker, nanos)
            .world_from_camera;
    }
    let (found, truth) = (found.unwrap(), pose(STEP * f64::from(PICTURES - 1)));
    let pixel = |pose: &RigidTransform, point| {
        let point = pose.inverse().transform_point(point);
        camera.project(point).unwrap()
    };
    let points = [-0.1, 0.0, 0.1].map(|x| [-0.1, 0.0, 0.1].map(|y| DVec3::new(x, y, -0.03)));
    let distance = |p: &DVec3| pixel(&found, *p).distance(pixel(&truth, *p));
    [
        points.iter().flatten().map(distance).fold(0.0, f64::max),
        1e3 * found.translation.distance(truth.translation),
        found.rotation.angle_between(truth.rotation).to_degrees(),
    ]
}

fn print_error(what: &str, [pixels, mm, degrees]: [f64; 3]) -> f64 {
    println!("{what}: {pixels:.2} px, {mm:.2} mm, {degrees:.3} degrees");
    pixels
}

#[test]
fn corrects_tag_corners_to_the_middle_row() {
    let before = print_error("without correction", pose_error(&tags(), 0.0, false));
    let by_tracker = print_error("motion from the tracker", pose_error(&tags(), ROW, true));
    let by_poses = print_error(
        "motion from the previous picture",
        pose_error(&tags(), ROW, false),
    );
    assert!(before > 0.6, "{before}");
    assert!(
        by_tracker < 0.15 && by_poses < 0.3,
        "{by_tracker} {by_poses}"
    );
}

#[test]
fn corrects_corners_of_a_single_tag_to_the_middle_row() {
    let one = [synthetic::tag(3, 0.12, DVec3::new(0.05, 0.08, 0.0))];
    let before = print_error("without correction", pose_error(&one, 0.0, false));
    let by_tracker = print_error("motion from the tracker", pose_error(&one, ROW, true));
    assert!(by_tracker < 0.3 && before > 1.5, "{before} {by_tracker}");
}
