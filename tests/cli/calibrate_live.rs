//! `penumbra calibrate` on a live rig: on the command line, and over HTTP in a running rig.

use crate::board;
use crate::live::{Running, post, until};
use crate::program::{Desk, text};
use crate::service::get;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::process::Stdio;

/// Creates a rig whose scene camera sees a board, and a folder for its files.
fn rig() -> Desk {
    let desk = Desk::new();
    board::record(&desk.path("board.mcap"));
    desk.put("files/note.txt", "the rig's files");
    desk.put(
        "rig.toml",
        "[scene_camera]\ndevice = \"replay:board.mcap\"\n[calibration]\nfrom = \"files\"\n",
    );
    desk
}

const COMMAND: &str = "calibrate intrinsics --config rig.toml --listen 127.0.0.1:0 --board";

fn focal(desk: &Desk, file: &str) -> f64 {
    desk.json(file)["focal"][0].as_f64().unwrap()
}

#[test]
fn live_calibration_is_written_to_the_rig_folder_and_used_without_a_rig_json() {
    let desk = rig();
    let printed = desk.works(&format!("{COMMAND} {} --seconds 40", board::BOARD));
    assert!(
        printed.contains("px RMS") && printed.contains("calibration: "),
        "{printed}"
    );
    let file = "files/calibration/scene_camera.json";
    let found = desk.json(file);
    let error = focal(&desk, file) / board::FOCAL - 1.0;
    assert!(error.abs() < 0.01, "{error}");
    assert_eq!(found["source"], "live");
    assert_eq!(found["device"]["name"], "replay:board.mcap");
    assert!(desk.path("files/calibration/scene_camera.html").exists());
    // A second run backs up the first result, and the lens file provides the picture size.
    let printed = desk.works(&format!("{COMMAND} {} --seconds 40", board::BOARD));
    assert!(printed.contains("backup: "), "{printed}");
    assert_eq!(desk.names("files/calibration").len(), 4);
    let printed = desk.works(
        "run --config rig.toml --headless --listen 127.0.0.1:0 --frames 2 --frames-out frames",
    );
    assert!(printed.contains("2 frames composed"), "{printed}");
    let png = desk.read(format!("frames/{}", desk.names("frames")[0]));
    let frame = image::load_from_memory(&png).unwrap();
    assert_eq!((frame.width(), frame.height()), (320, 240));
}

#[cfg(unix)]
#[test]
fn signal_or_enter_ends_the_step_with_a_verdict() {
    let desk = rig();
    let line = format!("{COMMAND} {} --out lens.json --force", board::BOARD);
    for trigger in ["-INT", "Enter"] {
        let mut command = desk.command(&line.split(' ').collect::<Vec<_>>());
        let command = command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let mut keys = child.stdin.take().unwrap();
        let mut running = Running::from_child(child);
        let mut out = BufReader::new(running.stdout());
        let mut printed = String::new();
        out.read_line(&mut printed).unwrap();
        let address = printed.trim_end().strip_prefix("status page: http://");
        let address = address.unwrap().trim_end_matches('/').to_owned();
        until("a view", || {
            let message = calibration(&address)["message"].clone();
            message
                .as_str()
                .is_some_and(|m| !m.starts_with('0') && m.contains("views"))
        });
        let refused = post(&address, "/calibration/start", r#"{"step": "intrinsics"}"#);
        assert!(refused.contains("runs a single step"), "{refused}");
        if trigger == "Enter" {
            keys.write_all(b"\n").unwrap();
        } else {
            running.signal(trigger);
        }
        let mut rest = String::new();
        out.read_to_string(&mut rest).unwrap();
        // After so few pictures it may be refused, but there is a verdict and a report in any case.
        let is_named = ["report: lens.html", "report: lens.refused.html"];
        assert!(
            is_named.iter().any(|name| rest.contains(name)),
            "{trigger}: {rest}"
        );
    }
}

#[test]
fn rejects_invalid_requests_before_opening_devices() {
    let desk = rig();
    desk.put(
        "bare.toml",
        "[scene_camera]\ndevice = \"replay:board.mcap\"\n",
    );
    for (line, expected) in [
        (
            "--config bare.toml --board chess:7x5:0.03",
            "or name a file with --out",
        ),
        (
            "--config rig.toml --camera environment --board chess:7x5:0.03",
            "no environment camera",
        ),
        (
            "--config rig.toml --board charuco:8x6:0.03:0.04:4x4_50",
            "marker",
        ),
        (
            "--session board.mcap --config rig.toml --board chess:7x5:0.03",
            "--out FILE.json",
        ),
    ] {
        let output = desk.run(&format!("calibrate intrinsics {line}"));
        let printed = text(&output.stderr);
        assert!(
            !output.status.success() && printed.contains(expected),
            "{printed}"
        );
    }
}

fn calibration(address: &str) -> Value {
    let answer = get(address, "/calibration");
    serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap()
}

#[cfg(unix)]
#[test]
fn calibrates_a_running_rig_over_http() {
    let desk = rig();
    let (rig, address) = Running::rig(&desk, &["--light-count", "8"]);
    let idle = calibration(&address);
    assert_eq!(idle["state"], "idle");
    assert_eq!(idle["steps"][0]["name"], "intrinsics");
    assert!(get(&address, "/calibration/report").starts_with("HTTP/1.1 404"));
    assert!(get(&address, "/calibration/picture.jpg").starts_with("HTTP/1.1 404"));
    let none = post(&address, "/calibration/finish", "{}");
    assert!(
        none.starts_with("HTTP/1.1 409") && none.contains("no step is running"),
        "{none}"
    );
    let wrong = json!({"step": "intrinsics", "parameters": {"board": "9x6"}}).to_string();
    let wrong = post(&address, "/calibration/start", &wrong);
    assert!(
        wrong.starts_with("HTTP/1.1 422") && wrong.contains("chess:COLUMNSxROWS"),
        "{wrong}"
    );

    let request = json!({"step": "intrinsics", "parameters": {"board": board::BOARD}}).to_string();
    let started = post(&address, "/calibration/start", &request);
    assert!(
        started.starts_with("HTTP/1.1 202") && started.contains("\"running\""),
        "{started}"
    );
    let again = post(&address, "/calibration/start", &request);
    assert!(again.starts_with("HTTP/1.1 409") && again.contains("`intrinsics` is running"));
    until("a picture with overlay points", || {
        let marks = calibration(&address)["picture"]["points"].clone();
        marks.as_array().is_some_and(|marks| marks.len() >= 20)
    });
    assert!(get(&address, "/calibration/picture.jpg?revision=1").contains("image/jpeg"));
    until("the end of the step", || {
        calibration(&address)["state"] == "finished"
    });
    let view = calibration(&address);
    assert_ne!(view["result"]["grade"], "refused", "{view}");
    let error = focal(&desk, "files/calibration/scene_camera.json") / board::FOCAL - 1.0;
    assert!(error.abs() < 0.01, "{error}");
    let report = get(&address, "/calibration/report");
    assert!(report.contains("Lens of the scene camera"), "{report}");
    assert!(report.contains("sandbox") && !report.contains("script-src 'self'"));
    rig.end();
}
