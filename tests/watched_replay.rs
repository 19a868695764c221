//! A recording that is watched in a loop, at its own rate, is lit by the light of its own instants.

#![expect(clippy::unwrap_used)]

use penumbra_config::{Config, ReplaySpeed};
use penumbra_rig::prepare::{Preparation, PreparationEvent};
use penumbra_rig::{RigSetup, Source, live_settings};
use penumbra_session::Session;
use penumbra_status::SharedStatus;
use std::path::PathBuf;
use std::sync::Arc;

/// Time of each picture, seconds, whether it is the first of a loop, and how much later the light is
/// in which it is shown, seconds.
fn pictures_of_two_loops() -> Vec<(f64, bool, f64)> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/sessions");
    let source = Source::Recorded(Session::open(&folder.join("desk.mcap")).unwrap());
    let mut config = Config::default();
    config.replay.speed = ReplaySpeed::Factor(1.0);
    config.replay.repeat = true;
    let setup = RigSetup::read(&source, &config).unwrap();
    let status = SharedStatus::new(live_settings(&config));
    let requested = status.settings_receiver();
    let preparation =
        Preparation::start(&setup, &config, &source, requested, Arc::default()).unwrap();
    let mut pictures = Vec::new();
    let mut ends = 0;
    while ends < 2 {
        match preparation.next().unwrap() {
            PreparationEvent::Frame(frame) => {
                let light = frame.light.lighting.as_ref().unwrap();
                let late = light.captured_at.seconds_since(frame.frame.captured_at);
                pictures.push((frame.seconds, frame.is_start, late));
                preparation.give_back(frame.picture);
            }
            PreparationEvent::End(_) => ends += 1,
            _ => (),
        }
    }
    pictures
}

#[test]
fn no_picture_is_shown_in_the_light_of_another_loop() {
    let pictures = pictures_of_two_loops();
    let starts: Vec<usize> = (0..pictures.len()).filter(|i| pictures[*i].1).collect();
    assert_eq!(starts.len(), 2, "{pictures:?}");
    assert!(pictures[starts[1]].0 < 0.5 && pictures[starts[1] - 1].0 > 1.0);
    // The first environment picture of the recording is later than its first picture.
    let latest = pictures.iter().map(|(_, _, late)| *late);
    assert!(latest.fold(f64::MIN, f64::max) < 0.25, "{pictures:?}");
    // The loop waits for the light of its first picture, however slow the machine is.
    assert!(pictures[starts[1]].2.abs() < 0.25, "{pictures:?}");
}
