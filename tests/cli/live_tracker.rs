//! A complete rig with replayed cameras and a simulated tracker on a pseudo-terminal: the live code
//! path from the serial port to the picture.
#![cfg(unix)]

use crate::live::{Running, device, status, until};
use crate::program::{Desk, desk_session};
use crate::simulate::Simulation;
use penumbra_interface::{Clock, SystemClock};
use penumbra_tracker_serial::AnyDecoder;
use serde_json::Value;
use std::time::Duration;

/// Writes the configuration of the bundled session's rig with a tracker on a serial line.
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

/// Waits until the status lists the devices; returns the tracker.
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
fn lost_tracker_keeps_the_picture_and_is_reopened_within_two_seconds() {
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
    until("its loss is reported", || {
        tracker(&address)["state"] != "streaming"
    });
    let lost = tracker(&address);
    assert!(
        lost["reason"].as_str().is_some_and(|r| !r.is_empty()),
        "{lost}"
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
fn names_the_protocol_of_a_wrongly_configured_tracker() {
    let desk = Desk::new();
    let link = desk.path("tracker").display().to_string();
    configure(&desk, &link, "fastrak");
    let line = format!("simulate tracker --protocol csv --pty {link}");
    let _simulation = Simulation::start(&desk, &line);
    let (rig, address) = Running::rig(&desk, &[]);
    until("the protocol is reported", || {
        let reason = tracker(&address)["reason"].clone();
        reason.as_str().is_some_and(|r| r.contains("csv"))
    });
    until("the picture is there", || composed(&address) > 2);
    rig.end();
}

/// Output of the pictures' poses for virtual-production tools.
#[test]
fn sends_the_poses_of_pictures_as_freed() {
    let desk = Desk::new();
    let receiver = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    receiver
        .set_read_timeout(Some(Duration::from_secs(1)))
        .unwrap();
    let address = receiver.local_addr().unwrap();
    desk.put("freed.toml", format!("[output]\nfreed = \"{address}\"\n"));
    let session = desk_session().display().to_string();
    let line = format!(
        "replay {session} --config freed.toml --headless --listen 127.0.0.1:0 --frames 5 --speed max"
    );
    let output = desk.run(&line);
    assert!(
        output.status.success(),
        "{}",
        crate::program::text(&output.stderr)
    );
    let mut decoder = AnyDecoder::for_protocol("freed").unwrap();
    let mut poses = Vec::new();
    let mut bytes = [0; 64];
    while let Ok(len) = receiver.recv(&mut bytes) {
        assert_eq!((len, bytes[0], bytes[1]), (29, 0xd1, 1));
        decoder.push(&bytes[..len], SystemClock.now(), |pose| poses.push(pose));
    }
    assert_eq!(decoder.counters().skipped_bytes, 0);
    // The decoder accepts the first record when the second has arrived.
    assert_eq!(poses.len(), 5, "one for each picture");
    for pose in poses {
        let camera = pose.transmitter_from_sensor;
        // The camera looks down at the desk; FreeD cameras look along +Y.
        let forward = camera.rotation * glam::DVec3::Y;
        assert!(camera.translation.z > 0.1 && camera.translation.length() < 2.0);
        assert!(forward.z < -0.2, "{forward}");
    }
}
