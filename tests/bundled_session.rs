//! The sessions in the repository are complete and small, and hold no ground truth.

#![expect(clippy::unwrap_used)]

use penumbra_rig_model::RigDocument;
use penumbra_session::{Session, SessionEvent};
use std::path::PathBuf;

/// Names and how many bytes they may have.
const SESSIONS: [(&str, u64); 2] = [("desk.mcap", 6_000_000), ("courtyard.mcap", 3_000_000)];
const GROUND_TRUTH: [&str; 5] = ["truth", "masks", "light_truth", "camera_truth", "truth_rig"];

fn open(name: &str) -> Session {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/sessions");
    Session::open(&folder.join(name)).unwrap()
}

#[test]
fn sessions_are_complete_and_small() {
    for (name, limit) in SESSIONS {
        let session = open(name);
        assert!(
            !session.truncated() && session.damage().is_empty(),
            "{name}"
        );
        assert!(session.file_len() <= limit, "{} bytes", session.file_len());
        assert_eq!(session.tracker_protocol(), Some("fastrak"), "{name}");
    }
}

fn counts(name: &str) -> (u32, u32, u32) {
    let (mut scene, mut environment, mut tracker) = (0, 0, 0);
    for event in open(name).events() {
        match event.unwrap() {
            SessionEvent::Scene(_) => scene += 1,
            SessionEvent::Environment(_) => environment += 1,
            SessionEvent::TrackerBytes { .. } => tracker += 1,
            SessionEvent::Pose(_) | SessionEvent::Tick(_) | SessionEvent::Prepared { .. } => {}
        }
    }
    (scene, environment, tracker)
}

#[test]
fn sessions_hold_every_stream() {
    // Ten instants of the environment camera, each with two brackets; 24, each with three.
    assert_eq!(counts("desk.mcap"), (60, 30, 285));
    assert_eq!(counts("courtyard.mcap"), (48, 96, 753));
}

#[test]
fn rigs_objects_and_phantoms_are_read() {
    for (name, _) in SESSIONS {
        let session = open(name);
        let find = |name: &str| session.attachment(name);
        let rig = RigDocument::from_session(&find).unwrap();
        let scene = rig.scene(&find).unwrap();
        let rig = rig.calibration;
        assert!(rig.environment.is_some() && rig.tracker.is_some() && rig.chart.is_some());
        assert!(!scene.virtual_parts.is_empty(), "{name}");
        assert!(scene.phantom_parts.len() >= 2, "{name}");
        assert_eq!(scene.ground_height, Some(0.0), "{name}");
    }
}

#[test]
fn sessions_hold_no_ground_truth() {
    for (name, _) in SESSIONS {
        let session = open(name);
        for attachment in session.attachments() {
            for name in GROUND_TRUTH {
                assert!(!attachment.name.contains(name), "{}", attachment.name);
            }
        }
        let rig = session.attachment("rig.json").unwrap().to_vec();
        let rig = String::from_utf8(rig).unwrap();
        assert!(!rig.contains("truth/"), "rig.json refers to ground truth");
    }
}
