//! The session in the repository is whole, small, and holds nothing of the judge's.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use penumbra::scene::Scene;
use penumbra::session::{Session, SessionEvent};
use std::path::PathBuf;

const LIMIT_BYTES: u64 = 6_000_000;
const JUDGES_ONLY: [&str; 5] = ["truth", "masks", "light_truth", "camera_truth", "truth_rig"];

fn desk() -> Session {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/sessions/desk.mcap");
    Session::open(&path).unwrap()
}

#[test]
fn it_is_whole_and_small() {
    let session = desk();
    assert!(!session.truncated());
    assert!(session.damage().is_empty());
    assert!(
        session.file_len() <= LIMIT_BYTES,
        "{} bytes",
        session.file_len()
    );
    assert_eq!(session.tracker_protocol(), Some("fastrak"));
}

#[test]
fn every_stream_is_in_it() {
    let (mut scene, mut environment, mut tracker) = (0, 0, 0);
    for event in desk().events() {
        match event.unwrap() {
            SessionEvent::Scene(_) => scene += 1,
            SessionEvent::Environment(_) => environment += 1,
            SessionEvent::TrackerBytes { .. } => tracker += 1,
            SessionEvent::Pose(_) | SessionEvent::Tick(_) | SessionEvent::Prepared { .. } => {}
        }
    }
    // Ten instants of the environment camera, each with two brackets.
    assert_eq!((scene, environment, tracker), (60, 30, 285));
}

#[test]
fn its_rig_object_and_phantoms_are_read() {
    let session = desk();
    let (rig, scene) = Scene::from_session(&|name| session.attachment(name)).unwrap();
    assert!(rig.environment.is_some() && rig.tracker.is_some() && rig.chart.is_some());
    assert!(!scene.virtual_parts.is_empty());
    assert!(scene.phantom_parts.len() >= 2);
    assert_eq!(scene.ground_height, Some(0.0));
}

#[test]
fn nothing_of_the_judge_s_is_in_it() {
    for attachment in desk().attachments() {
        for name in JUDGES_ONLY {
            assert!(!attachment.name.contains(name), "{}", attachment.name);
        }
    }
    let rig = desk().attachment("rig.json").unwrap().to_vec();
    let rig = String::from_utf8(rig).unwrap();
    assert!(!rig.contains("truth/"), "rig.json names the judge's files");
}
