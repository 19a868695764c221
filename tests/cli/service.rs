//! The status page and signals.

use crate::program::{Desk, text};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};
use std::time::Duration;

/// Starts a looped replay; returns it with its address.
fn looping(desk: &Desk) -> (Child, String) {
    looping_with(desk, "--speed max --report r.json")
}

/// Starts a looped replay with other options.
pub fn looping_with(desk: &Desk, options: &str) -> (Child, String) {
    let session = crate::program::desk_session().display().to_string();
    let line = format!("--loop --headless --light-count 8 --listen 127.0.0.1:0 {options}");
    let arguments = ["replay", &session].into_iter().chain(line.split(' '));
    let mut command = desk.command(&arguments.collect::<Vec<_>>());
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut printed = String::new();
    BufReader::new(child.stdout.as_mut().unwrap())
        .read_line(&mut printed)
        .unwrap();
    let address = printed
        .trim_end()
        .strip_prefix("status page: http://")
        .and_then(|a| a.strip_suffix('/'));
    let address = address.unwrap_or_else(|| panic!("{printed:?}")).to_owned();
    (child, address)
}

pub fn get(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    write!(
        stream,
        "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    text(&answer)
}

/// Whether a line of `/metrics` counts at least one composed frame.
fn has_composed_frames(line: &str) -> bool {
    let value = line.strip_prefix("penumbra_frames_composed_total ");
    value.is_some_and(|v| v.trim().parse::<f64>().unwrap() > 0.0)
}

#[cfg(unix)]
#[test]
fn signal_ends_a_looped_replay() {
    for signal in ["-INT", "-TERM"] {
        let desk = Desk::new();
        let (child, address) = looping(&desk);
        let answer = get(&address, "/status");
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        assert!(answer.contains("\"version\""), "{answer}");
        while !get(&address, "/metrics").lines().any(has_composed_frames) {
            std::thread::sleep(Duration::from_millis(50));
        }
        let id = child.id().to_string();
        assert!(
            std::process::Command::new("kill")
                .args([signal, &id])
                .status()
                .unwrap()
                .success()
        );
        let output = child.wait_with_output().unwrap();
        assert!(
            output.status.success(),
            "{signal}: {}",
            text(&output.stderr)
        );
        assert!(
            output.stderr.is_empty(),
            "{signal}: {}",
            text(&output.stderr)
        );
        assert!(desk.json("r.json")["frames"]["composed"].as_u64().unwrap() >= 1);
    }
}

/// Replays that write files at full speed may run side by side; the second has no status page, which
/// was not requested.
#[test]
fn writes_frames_although_the_default_port_is_in_use() {
    let Ok(_listener) = TcpListener::bind("127.0.0.1:8780") else {
        eprintln!(
            "SKIPPED writes_frames_although_the_default_port_is_in_use: port 8780 is not free"
        );
        return;
    };
    let desk = Desk::new();
    let line = "replay DESK --headless --light-count 8 --frames 1";
    let output = desk.run(&format!("{line} --speed max --frames-out out"));
    let printed = text(&output.stderr);
    assert!(output.status.success(), "{printed}");
    assert!(
        printed.contains("8780") && printed.lines().count() == 1,
        "{printed}"
    );
    assert_eq!(desk.names("out"), ["00000.png"]);
    assert!(desk.refuses(line).contains("8780"));
}
