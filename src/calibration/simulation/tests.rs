use super::*;
use penumbra_fiducials::Detector;
use penumbra_rig_model::RigDocument;

#[test]
fn detected_tags_match_ground_truth() {
    let rig = SimulatedRig::new(SimulationOptions::default());
    let mut random = Random::new(3);
    let lens = rig.scene.lens().clone();
    let camera = lens.as_pinhole().unwrap();
    let mut detector = Detector::new(&[Family::Tag36h11], &Response::srgb());
    let (mut count, mut squares, mut tags) = (0.0_f64, 0.0_f64, 0);
    for i in 0..4 {
        let t = 1.7 * f64::from(i);
        let codes = rig.scene_picture(t, &mut random);
        let seen = detector.detect_grey(&codes, 640, 480, Some(&camera));
        let camera_from_world = rig.world_from_camera(t).inverse();
        tags += seen.len();
        for tag in seen {
            let truth = rig.tags.iter().find(|k| k.id == tag.id).unwrap();
            for (corner, pixel) in truth.corners().into_iter().zip(tag.corners) {
                let projected = camera
                    .project(camera_from_world.transform_point(corner))
                    .unwrap();
                squares += projected.distance_squared(pixel);
                count += 1.0;
            }
        }
    }
    let rms = (squares / count).sqrt();
    assert!(tags >= 18, "{tags} tags");
    assert!(rms < 0.15, "{rms} px");
}

#[test]
fn chessboard_is_detected() {
    let board = Board::parse("chess:7x5:0.03").unwrap();
    let rig = SimulatedRig::new(SimulationOptions {
        board: Some(board),
        ..SimulationOptions::default()
    });
    let codes = rig.scene_picture(0.4, &mut Random::new(1));
    let grey = Grey::from_bytes(640, 480, &codes);
    let found = crate::intrinsics::detect::find_chessboard(&grey, 7, 5).unwrap();
    let camera_from_world = rig.world_from_camera(0.4).inverse();
    for c in found.correspondences(0.03) {
        let world = flat_on_table(0.0, DVec3::ZERO).transform_point(c.point.extend(0.0));
        let projected = rig
            .scene
            .lens()
            .project(camera_from_world.transform_point(world));
        assert!(
            projected.unwrap().distance(c.pixel) < 0.3,
            "{c:?} {projected:?}"
        );
    }
}

#[test]
fn rig_json_reads_back_with_markers_and_tracker() {
    let rig = SimulatedRig::new(SimulationOptions {
        known_markers: true,
        known_tracker: true,
        environment: EnvironmentMount::Carried,
        ..SimulationOptions::default()
    });
    let bytes = serde_json::to_vec(&rig.rig_json()).unwrap();
    let document = RigDocument::parse(&bytes).unwrap();
    assert_eq!(document.markers.len(), 9);
    let tracker = document.calibration.tracker.unwrap();
    let measured = tracker.world_from_scene_camera(rig.transmitter_from_sensor(2.5));
    let truth = rig.world_from_camera(2.5);
    assert!(measured.translation.distance(truth.translation) < 1e-9);
    assert_eq!(tracker.metres_per_unit, 0.01);
}
