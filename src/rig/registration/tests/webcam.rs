//! The rig of `penumbra webcam`: pictures of the printed sheet with a ball on it.

use super::super::*;
use crate::registration::placed_ball::PlacedBall;
use glam::DVec2;
use penumbra_calibration::simulation::SimulatedWebcam;
use penumbra_calibration::webcam_sheet::{FAMILY, Paper, WebcamSheet, assumed_lens};
use penumbra_camera::{MirrorSphere, Response};
use penumbra_numerics::Random;

const SIZE: (u32, u32) = (640, 480);
const UNTRACKED: TrackerEstimate = TrackerEstimate {
    pose: None,
    motion: None,
};

fn sheet(ball_mm: f64) -> WebcamSheet {
    WebcamSheet::new(Paper::A4, 100.0, ball_mm, 0.0).unwrap()
}

/// The registration of the rig that the sheet describes, with the lens of `camera`.
fn registration(sheet: &WebcamSheet, camera: &PinholeCamera) -> TagRegistration {
    let (centre_in_world, radius) = sheet.ball();
    let sphere = MirrorSphere {
        centre_in_world,
        radius,
        position_sigma: 0.003,
        reflectance: [0.85; 3],
        in_scene: true,
    };
    TagRegistration {
        detector: Detector::new(&[FAMILY], &Response::srgb()),
        camera: camera.clone(),
        row_seconds: 0.0,
        registrar: Some(Registrar::new(TagMap::new(sheet.tags()).unwrap())),
        hybrid: None,
        rejected: 0,
        marked_sphere: None,
        fixed_sphere: None,
        placed_ball: PlacedBall::new(&sphere),
        refiner: None,
    }
}

/// Registers a second of pictures; returns the last result and the greatest errors of the pose,
/// metres and radians.
fn run(webcam: &SimulatedWebcam, rig: &mut TagRegistration) -> (RegistrationResult, f64, f64) {
    let mut random = Random::new(5);
    let (mut metres, mut radians) = (0.0_f64, 0.0_f64);
    let mut last = None;
    for i in 0..16 {
        let pose = webcam.pose(0.8 * f64::from(i));
        let picture = webcam.picture(pose, 1.0, &mut random);
        let at = MonotonicTime::from_nanos(i64::from(i) * 100_000_000);
        let result = rig.register(&picture, UNTRACKED, at);
        let found = result.world_from_camera.expect("a pose");
        metres = metres.max(found.translation.distance(pose.translation));
        radians = radians.max(found.rotation.angle_between(pose.rotation));
        last = Some(result);
    }
    (last.unwrap(), metres, radians)
}

#[test]
fn sheet_and_ball_are_found_with_a_known_lens() {
    for (ball_mm, off) in [
        (50.0, [0.0, 0.0]),
        (70.0, [0.003, -0.002]),
        (100.0, [-0.002, 0.003]),
    ] {
        let sheet = sheet(ball_mm);
        let lens = assumed_lens(SIZE, 60_f64.to_radians());
        let webcam = SimulatedWebcam::new(&lens, sheet, Some(DVec2::from(off)), 3);
        let (last, metres, radians) = run(&webcam, &mut registration(&sheet, &lens));
        assert!(
            metres < 0.003 && radians < 0.006,
            "{ball_mm}: {metres} {radians}"
        );
        let found = last.sphere.expect("the ball").centre_in_world;
        let truth = webcam.ball().unwrap().0;
        let error = found.distance(truth);
        assert!(error < 0.0015, "{ball_mm}: {found} {truth}");
        let support = last.status.sphere_support.unwrap();
        assert!(support > 0.4, "{ball_mm}: {support}");
        println!(
            "{ball_mm} mm: pose {metres:.5} m {radians:.5} rad, ball {error:.5} m, rim {support:.2}"
        );
    }
}

#[test]
fn empty_ring_is_not_taken_for_a_ball() {
    let sheet = sheet(70.0);
    let lens = assumed_lens(SIZE, 60_f64.to_radians());
    let webcam = SimulatedWebcam::new(&lens, sheet, None, 3);
    let (last, ..) = run(&webcam, &mut registration(&sheet, &lens));
    println!("empty: rim {:?}", last.status.sphere_support);
    assert!(last.is_sphere_lost && last.sphere.is_none());
    assert_eq!(last.status.sphere_off_mm, None);
}

#[test]
fn ball_is_found_with_an_assumed_lens() {
    let sheet = sheet(70.0);
    let webcam = SimulatedWebcam::of_typical_lens(SIZE, sheet, 3);
    let assumed = assumed_lens(SIZE, 65_f64.to_radians());
    let (last, ..) = run(&webcam, &mut registration(&sheet, &assumed));
    println!(
        "assumed: rim {:?} off {:?}",
        last.status.sphere_support, last.status.sphere_off_mm
    );
    assert!(last.sphere.is_some(), "{:?}", last.status);
}
