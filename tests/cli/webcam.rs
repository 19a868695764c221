//! `penumbra webcam`: sheet, configuration, and the whole rig with a simulated camera.

use crate::live::{Running, status, until};
use crate::program::Desk;
use crate::service::get;
use serde_json::Value;

/// Returns a step of the guide by its name; null before the first status of the rig.
fn step(status: &Value, name: &str) -> Value {
    let steps = status["guide"]["steps"].as_array();
    let found = steps.and_then(|steps| steps.iter().find(|step| step["name"] == name));
    found.cloned().unwrap_or(Value::Null)
}

/// Starts the program; returns it with the address of its page.
fn start(desk: &Desk, more: &[&str]) -> (Running, String) {
    Running::serving(desk, &[&["webcam", "--folder", "w"], more].concat())
}

#[test]
fn simulated_webcam_finds_sheet_ball_and_light_and_shows_the_object() {
    let desk = Desk::new();
    let (running, address) = start(&desk, &["--camera", "simulated", "--size", "480x360"]);
    let done = |name: &str| step(&status(&address), name)["state"] == "done";
    for name in ["sheet", "ball", "light"] {
        until(name, || done(name));
    }
    until("object", || {
        step(&status(&address), "object")["state"] == "open"
    });
    let now = status(&address);
    assert!(
        now["registration"]["reprojection_px"].as_f64().unwrap() < 1.5,
        "{now}"
    );
    assert!(
        now["lighting"]["dome_lights"].as_u64().unwrap() > 0,
        "{now}"
    );
    assert_eq!(now["guide"]["ball_mm"], 70.0);
    assert!(get(&address, "/sheet.pdf").contains("%PDF-1.4"));
    drop(running);
    for file in ["sheet.pdf", "rig.json", "rig.toml", "scene.toml"] {
        assert!(desk.path("w").join(file).is_file(), "{file}");
    }
}

#[test]
fn missing_camera_is_a_failed_step_with_what_to_do() {
    let desk = Desk::new();
    let (_running, address) = start(&desk, &["--camera", "/dev/video-none", "--size", "640x480"]);
    until("failed", || {
        step(&status(&address), "sheet")["state"] == "failed"
    });
    let sheet = step(&status(&address), "sheet");
    assert!(
        sheet["text"].as_str().unwrap().contains("/dev/video-none"),
        "{sheet}"
    );
    assert!(
        sheet["todo"].as_str().unwrap().contains("CAMERA="),
        "{sheet}"
    );
}

#[test]
fn impossible_measures_are_refused_in_one_line() {
    let desk = Desk::new();
    for (option, value, reason) in [
        ("--ball-mm", "30", "50 to 100 mm"),
        ("--ruler-mm", "10", "80 to 125 mm"),
        ("--stand-mm", "99", "0 to 50 mm"),
        ("--camera", "replay:none.mcap", "there is no such session"),
    ] {
        let line = format!("webcam --folder w --prepare-only {option} {value}");
        let printed = desk.refuses(&line);
        assert!(printed.contains(reason), "{option}: {printed}");
    }
}
