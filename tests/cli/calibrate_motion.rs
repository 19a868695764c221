//! `penumbra calibrate map`, `latency` and `tracker` on recordings of simulated rigs.

use crate::program::{Desk, text};
use crate::sessions::put_without_attachments;
use penumbra_session::Session;
use serde_json::Value;

fn vector(value: &Value) -> Vec<f64> {
    let numbers = value.as_array().unwrap().iter();
    numbers.map(|n| n.as_f64().unwrap()).collect()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Returns the translation of a row-major matrix.
fn translation(matrix: &Value) -> Vec<f64> {
    let rows = matrix["matrix_row_major"].as_array().unwrap();
    rows[..3].iter().map(|r| r[3].as_f64().unwrap()).collect()
}

#[test]
fn recovers_map_tracker_and_latency_from_one_recording() {
    let desk = Desk::new();
    desk.works(
        "simulate session --seconds 9 --rate 24 --size 400x300 --tags 5 --seed 4 \
         --out a.mcap --truth truth.json",
    );
    let truth = desk.json("truth.json");
    desk.put("rig/calibration/note.txt", "");

    let output = desk.run("calibrate map --session a.mcap --out map.json");
    let printed = text(&output.stderr);
    assert!(
        !output.status.success() && printed.contains("--size METRES"),
        "{printed}"
    );
    let printed =
        desk.works("calibrate map --session a.mcap --size 0.08 --out rig/calibration/markers.json");
    assert!(printed.contains("5 tags"), "{printed}");
    let map = desk.json("rig/calibration/markers.json");
    for (found, truth) in map["markers"]
        .as_array()
        .unwrap()
        .iter()
        .zip(truth["markers"].as_array().unwrap())
    {
        let error = distance(
            &vector(&found["pose"]["position"]),
            &translation(&truth["T_world_marker"]),
        );
        assert!(error < 0.0015, "{error} m: {found}");
    }

    let output = desk.run("calibrate tracker --session a.mcap --out b.json");
    let printed = text(&output.stderr);
    assert!(
        !output.status.success() && printed.contains("calibrate map"),
        "{printed}"
    );
    desk.works("calibrate tracker --session a.mcap --rig rig --out rig/calibration/tracker.json");
    let tracker = desk.json("rig/calibration/tracker.json");
    let found = vector(&tracker["sensor_from_scene_camera"]["position"]);
    let error = distance(&found, &translation(&truth["T_sensor_cam"]));
    assert!(error < 0.003, "{error} m");

    let printed = desk
        .works("calibrate latency --session a.mcap --rig rig --out rig/calibration/latency.json");
    assert!(printed.contains("from poses"), "{printed}");
    let latency = desk.json("rig/calibration/latency.json");
    let error = latency["tracker_minus_scene"]["seconds"].as_f64().unwrap() - 0.0173;
    assert!(error.abs() < 0.002, "{error} s");
    let report = text(&desk.read("rig/calibration/latency.html"));
    assert!(report.contains("Correlation over the offset") && report.contains("<svg"));

    // The folder with these files is a valid rig.
    let printed = desk.works("calibrate latency --session a.mcap --rig rig --out c.json");
    assert!(printed.contains("good"), "{printed}");
}
#[test]
fn rig_option_replaces_the_rig_json_that_a_recording_lacks() {
    let desk = Desk::new();
    desk.works(
        "simulate session --seconds 9 --rate 24 --size 400x300 --tags 5 --seed 4 --out full.mcap",
    );
    let full = Session::open(&desk.path("full.mcap")).unwrap();
    desk.put("desk-rig.json", full.attachment("rig.json").unwrap());
    desk.put("folder/rig.json", full.attachment("rig.json").unwrap());
    put_without_attachments(&desk, &full, "bare.mcap");

    let line = "calibrate map --session bare.mcap --size 0.08 --out";
    let error = desk.refuses(&format!("{line} none.json"));
    assert!(error.contains("rig.json"), "{error}");
    for rig in ["desk-rig.json", "folder"] {
        let printed = desk.works(&format!("{line} {rig}-map.json --rig {rig}"));
        assert!(printed.contains("5 tags"), "{rig}: {printed}");
    }
    let error = desk.refuses(&format!("{line} none.json --rig missing.json"));
    assert!(error.contains("missing.json"), "{error}");
}
