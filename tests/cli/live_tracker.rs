//! A whole rig on replayed cameras and a simulated tracker behind a pseudo-terminal: the
//! live code path from the serial port to the picture.
#![cfg(unix)]

use crate::live::{Running, device, status, until};
use crate::program::{Desk, desk_session};
use crate::simulate::Simulation;
use serde_json::Value;
use std::time::Duration;

/// The desk, whose recorded tracker bytes come through a line.
fn configure(desk: &Desk, device: &str, protocol: &str) {
    let session = desk_session().display().to_string();
    desk.put(
        "rig.toml",
        format!(
            "[scene_camera]\ndevice = \"replay:{session}\"\n[environment_camera]\ndevice = \
             \"replay:{session}\"\n[tracker]\ndevice = \"{device}\"\nprotocol = \
             \"{protocol}\"\nsilent_after_ms = 500\n[calibration]\nfrom = \"{session}\"\n\
             [environment]\nlight_count = 8\n"
        ),
    );
}

/// As status knows it, once it does.
fn tracker(address: &str) -> Value {
    let mut s = status(address);
    while s["devices"].as_array().is_none_or(Vec::is_empty) {
        s = status(address);
    }
    device(&s, "tracker")
}

fn composed(address: &str) -> u64 {
    status(address)["frames"]["composed"].as_u64().unwrap()
}

fn paired(address: &str) -> u64 {
    let s = status(address);
    let without = s["frames"]["without_pose"].as_u64().unwrap();
    s["frames"]["composed"].as_u64().unwrap() - without
}

#[test]
fn a_tracker_that_goes_away_leaves_the_picture_and_is_taken_back_within_two_seconds() {
    let desk = Desk::new();
    let link = desk.path("tracker").display().to_string();
    configure(&desk, &link, "fastrak");
    let line = format!("simulate tracker --session DESK --pty {link}");
    let first = Simulation::start(&desk, &line);
    let (rig, address) = Running::rig(&desk, &[]);
    until("poses pair with pictures", || paired(&address) > 5);
    let there = tracker(&address);
    assert_eq!(there["state"], "streaming", "{there}");

    drop(first);
    until("its loss is told", || {
        tracker(&address)["state"] != "streaming"
    });
    let gone = tracker(&address);
    assert!(
        gone["reason"].as_str().is_some_and(|r| !r.is_empty()),
        "{gone}"
    );
    let before = composed(&address);
    until("the picture goes on", || composed(&address) > before + 5);

    let _ = std::fs::remove_file(&link);
    let _second = Simulation::start(&desk, &line);
    let waited = until("it streams again", || {
        tracker(&address)["state"] == "streaming"
    });
    assert!(waited < Duration::from_secs(2), "{waited:?}");
    let before = paired(&address);
    until("poses pair again", || paired(&address) > before + 5);
    assert!(tracker(&address)["losses"].as_u64() >= Some(1));
    rig.end();
}

#[test]
fn a_tracker_of_another_protocol_is_named_by_what_it_says() {
    let desk = Desk::new();
    let link = desk.path("tracker").display().to_string();
    configure(&desk, &link, "fastrak");
    let line = format!("simulate tracker --protocol csv --pty {link}");
    let _simulation = Simulation::start(&desk, &line);
    let (rig, address) = Running::rig(&desk, &[]);
    until("what was seen is told", || {
        let reason = tracker(&address)["reason"].clone();
        reason.as_str().is_some_and(|r| r.contains("csv"))
    });
    until("the picture is there", || composed(&address) > 2);
    rig.end();
}
