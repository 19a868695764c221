//! `penumbra simulate`: simulated devices for the live code path.
#![cfg(unix)]

use crate::program::{Desk, text};
use penumbra_tracker_serial::{AnyDecoder, PortName, TrackerSettings, Units, open};
use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// A running simulation; it ends with the test.
pub struct Simulation {
    child: Child,
    address: String,
}

impl Simulation {
    pub fn start(desk: &Desk, line: &str) -> Self {
        let session = crate::program::desk_session().display().to_string();
        let words: Vec<_> = line
            .split(' ')
            .map(|word| word.replace("DESK", &session))
            .collect();
        let mut child = desk.command(&words).stdout(Stdio::piped()).spawn().unwrap();
        let mut address = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut address)
            .unwrap();
        Self {
            child,
            address: address.trim().to_owned(),
        }
    }

    fn interrupt(&self) {
        let id = self.child.id().to_string();
        let killed = std::process::Command::new("kill")
            .args(["-INT", &id])
            .status();
        assert!(killed.unwrap().success());
    }
}

impl Drop for Simulation {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Reads at least `count` poses from a port; returns their distances from the origin, metres.
fn distances(protocol: &str, port: &str, count: usize) -> Vec<f64> {
    let settings = TrackerSettings {
        units: Units::Inches,
        ..TrackerSettings::new(protocol, PortName::parse(port).unwrap())
    };
    let mut tracker = open(&settings).unwrap_or_else(|e| panic!("{port}: {e}"));
    let mut decoder = AnyDecoder::for_protocol(protocol).unwrap();
    let (began, mut found) = (Instant::now(), Vec::new());
    while found.len() < count {
        assert!(
            began.elapsed() < Duration::from_secs(10),
            "{} poses",
            found.len()
        );
        if let Some(read) = tracker.next_bytes(Duration::from_millis(100)).unwrap() {
            decoder.push(&read.bytes, read.arrived_at, |sample| {
                found.push(sample.transmitter_from_sensor.translation.length());
            });
        }
    }
    found
}

#[test]
fn simulated_tracker_is_reachable_by_its_link_until_ctrl_c() {
    let desk = Desk::new();
    let mut simulation =
        Simulation::start(&desk, "simulate tracker --protocol fastrak --pty tracker");
    assert_eq!(simulation.address, "tracker");
    let link = desk.path("tracker");
    let found = distances("fastrak-binary-quaternion", link.to_str().unwrap(), 20);
    assert!(
        found.iter().all(|metres| (0.2..1.0).contains(metres)),
        "{found:?}"
    );
    simulation.interrupt();
    assert!(simulation.child.wait().unwrap().success());
    assert!(link.symlink_metadata().is_err(), "the link is left behind");
}

#[test]
fn plays_the_tracker_bytes_of_a_session() {
    let desk = Desk::new();
    let simulation = Simulation::start(&desk, "simulate tracker --session DESK --pty");
    assert!(
        simulation.address.starts_with("/dev/"),
        "{}",
        simulation.address
    );
    let found = distances("fastrak", &simulation.address, 50);
    assert!(
        found.iter().all(|metres| (0.1..8.0).contains(metres)),
        "{found:?}"
    );
}

#[test]
fn sends_poses_of_a_file_as_freed_datagrams() {
    let desk = Desk::new();
    desk.put("poses.txt", "0 3 0 4 0 0 0 1\n1 3 0 4 0 0 1 0\n");
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = port.local_addr().unwrap();
    drop(port);
    let line = format!("simulate tracker --protocol freed --udp {address} --trajectory poses.txt");
    let simulation = Simulation::start(&desk, &line);
    let found = distances("freed", &simulation.address, 10);
    assert!(
        found.iter().all(|metres| (metres - 5.0).abs() < 1e-4),
        "{found:?}"
    );
}

#[test]
fn refuses_impossible_simulations_in_one_line() {
    let desk = Desk::new();
    desk.put("poses.txt", "0 1 2\n");
    desk.put("port", "");
    for (line, parts) in [
        ("--protocol polaris --pty", &["polaris", "fastrak"][..]),
        ("--pty", &["--protocol"]),
        (
            "--protocol csv --pty --trajectory poses.txt",
            &["poses.txt", "line 1"],
        ),
        ("--protocol csv --pty --trajectory none.txt", &["none.txt"]),
        (
            "--protocol csv --pty --faults splat",
            &["splat", "drop=RATE"],
        ),
        ("--session none.mcap --pty", &["none.mcap"]),
        ("--protocol csv --pty port", &["port"]),
    ] {
        let error = desk.refuses(&format!("simulate tracker {line}"));
        for part in parts {
            assert!(error.contains(part), "{line}: {error}");
        }
    }
    // Errors of the option parser.
    for line in ["--protocol csv", "--pty --protocol csv --rate 0"] {
        let output = desk.run(&format!("simulate tracker {line}"));
        assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    }
}

#[test]
fn simulated_session_has_frame_tree_and_calibrations_for_viewers() {
    let desk = Desk::new();
    desk.works("simulate session --seconds 1 --rate 5 --size 160x120 --tags 3 --out rig.mcap");
    let info = desk.works("info rig.mcap");
    for topic in ["/tf ", "/scene_camera/calibration "] {
        assert!(info.contains(topic), "{info}");
    }
}
