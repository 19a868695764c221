//! The technique is changed while the rig runs.

use crate::live::post;
use crate::program::Desk;
use crate::reload::{Running, scene};
use serde_json::Value;

/// A looping rig with image-based shadowing, after its first picture.
fn rig(desk: &Desk, scene: &str, planes: &str) -> Running {
    desk.put("s.toml", scene);
    desk.put("c.toml", format!("[planes]\n{planes}\n"));
    let options = "--scene s.toml --config c.toml --technique image-based-shadowing --speed max";
    let rig = Running::start(desk, options);
    rig.until("the first picture", |s| composed(s) > 0);
    rig
}

fn composed(status: &Value) -> u64 {
    status["frames"]["composed"].as_u64().unwrap()
}

fn change_to(rig: &Running, technique: &str) {
    let body = format!(r#"{{"technique": "{technique}"}}"#);
    let answer = post(rig.address(), "/settings", &body);
    assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
}

/// Pictures go on while the planes are baked, also when the technique is changed back meanwhile.
#[test]
fn changing_to_planes_does_not_stop_the_picture() {
    let desk = Desk::new();
    let planes = "count = 24\nresolution = 128\ncache = \"kept\"";
    let rig = rig(&desk, &scene([0.0, 0.1], ""), planes);
    let baking = |s: &Value| s["planes"]["state"] == "baking";
    change_to(&rig, "shadowing-planes");
    rig.until("the bake", baking);
    change_to(&rig, "image-based-shadowing");
    rig.until("the end of the bake", |s| s["planes"]["state"] == "off");
    change_to(&rig, "shadowing-planes");
    let begun = rig.until("the second bake", baking);
    let later = rig.until("pictures", |s| composed(s) > composed(&begun) + 2);
    assert!(baking(&later), "{}", later["planes"]);
    let counted = rig.until("progress", |s| s["planes"]["done"].as_u64() > Some(0));
    assert_eq!(counted["planes"]["total"], 40, "{}", counted["planes"]);
    let ready = rig.until("planes", |s| s["planes"]["planes_seen"].as_u64() > Some(0));
    assert_eq!(ready["planes"]["state"], "ready");
    assert!(ready["planes"]["bake_seconds"].is_number());
}

/// Planes that are impossible end neither the program nor the picture; the status gives the reason.
#[test]
fn impossible_planes_are_reported_while_pictures_go_on() {
    let desk = Desk::new();
    let keys = "keys = [{ at_s = 0 }, { at_s = 2.0, position_m = [0.1, 0, 0] }]";
    let moving = scene([0.0, 0.1], "").replace("[ground]", &format!("{keys}\n[ground]"));
    let rig = rig(&desk, &moving, "count = 24");
    change_to(&rig, "shadowing-planes");
    let failed = rig.until("the failure", |s| s["planes"]["state"] == "failed");
    let reason = failed["planes"]["reason"].to_string();
    assert!(reason.contains("moves"), "{reason}");
    rig.until("pictures", |s| composed(s) > composed(&failed) + 2);
}
