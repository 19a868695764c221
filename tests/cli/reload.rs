//! Scene files that are changed while the rig runs.

use crate::program::Desk;
use crate::service::{get, looping_with};
use serde_json::Value;
use std::process::Child;
use std::time::{Duration, Instant};

/// A running program and its address; the program ends with the test.
pub struct Running(Child, String);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    pub fn start(desk: &Desk, options: &str) -> Self {
        let (child, address) = looping_with(desk, options);
        Self(child, address)
    }

    pub fn address(&self) -> &str {
        &self.1
    }

    pub fn status(&self) -> Value {
        let answer = get(&self.1, "/status");
        let (_, body) = answer.split_once("\r\n\r\n").unwrap();
        serde_json::from_str(body).unwrap()
    }

    /// Waits until a condition on the status holds; returns the status.
    pub fn until(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let status = self.status();
            if holds(&status) {
                return status;
            }
            let waited = begun.elapsed();
            assert!(waited < Duration::from_secs(120), "{what}: {status}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

pub fn scene(boxes: [f64; 2], model: &str) -> String {
    let cube = |x: f64| {
        format!(
            "[[object]]\nshape = \"box\"\nsize_m = [0.05, 0.05, 0.05]\nposition_m = [{x}, 0, 0]\n"
        )
    };
    let boxes = boxes.map(cube).concat();
    // Without phantoms other than the ground, the bake moves with the model.
    format!("session_phantoms = false\n{model}\n{boxes}[ground]\nsize_m = 2.0\n")
}

#[test]
fn changed_scene_is_shown_and_a_broken_one_is_not() {
    let desk = Desk::new();
    desk.put("s.toml", scene([0.0, 0.1], ""));
    let rig = Running::start(&desk, "--scene s.toml --speed max");
    let status = rig.until("the first picture", |s| {
        s["frames"]["composed"].as_u64() > Some(0)
    });
    assert_eq!(status["scene"]["file"], "s.toml");
    assert_eq!(status["scene"]["loads"], 0);
    desk.put("s.toml", scene([0.0, 0.2], ""));
    rig.until("the change", |s| s["scene"]["loads"] == 1);
    desk.put("s.toml", "[[object]]\nshape = \"boks\"\n");
    let status = rig.until("the mistake", |s| s["scene"]["reason"].is_string());
    let reason = status["scene"]["reason"].as_str().unwrap();
    assert!(
        reason.starts_with("s.toml:2: `object[0].shape`"),
        "{reason}"
    );
    assert!(status["warnings"].to_string().contains("object[0].shape"));
    assert_eq!(status["scene"]["loads"], 1);
    let composed = status["frames"]["composed"].as_u64();
    rig.until("more pictures", |s| {
        s["frames"]["composed"].as_u64() > composed
    });
    // A missing model, which is then added.
    desk.put("s.toml", "[[object]]\nfile = \"late.ply\"\n");
    let late = |s: &Value| s["scene"]["reason"].to_string().contains("late.ply");
    rig.until("the missing model", late);
    desk.put("late.ply", TRIANGLE);
    let status = rig.until("the model", |s| s["scene"]["loads"] == 2);
    assert!(status["scene"]["reason"].is_null());
    assert_eq!(status["warnings"].as_array().unwrap().len(), 0, "{status}");
}

/// A glTF with one triangle whose corners are in a separate file.
const MODEL: &str = r#"{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "buffers": [{"byteLength": 36, "uri": "corners.bin"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3,
        "min": [0, 0, 0], "max": [1, 1, 1]}]}"#;

fn corners(size: f32) -> Vec<u8> {
    let corners = [0.0, 0.0, 0.0, size, 0.0, 0.0, 0.0, size, 0.0];
    corners.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn watches_the_files_of_a_model_and_keeps_the_scene_on_errors() {
    let desk = Desk::new();
    desk.put("m.gltf", MODEL);
    desk.put("corners.bin", corners(0.1));
    let moving = |at: f64| {
        let keys = format!("keys = [{{ at_s = 0 }}, {{ at_s = {at}, position_m = [0.1, 0, 0] }}]");
        format!("[[object]]\nfile = \"m.gltf\"\n{keys}\n")
    };
    desk.put("s.toml", moving(2.0));
    let rig = Running::start(
        &desk,
        "--scene s.toml --speed max --technique shadowing-planes",
    );
    let status = rig.until("the first picture", |s| {
        s["frames"]["composed"].as_u64() > Some(0)
    });
    // Moving objects use the shadows of the dome lights; the status gives the reason.
    assert_eq!(status["planes"]["state"], "failed", "{status}");
    let reason = status["planes"]["reason"].to_string();
    assert!(reason.contains("moves"), "{reason}");
    desk.put("corners.bin", [corners(0.2), vec![0; 4]].concat());
    rig.until("the other corners", |s| s["scene"]["loads"] == 1);
    desk.put("s.toml", moving(0.0));
    let status = rig.until("the mistake", |s| s["scene"]["reason"].is_string());
    let reason = status["scene"]["reason"].as_str().unwrap();
    assert!(
        reason.starts_with("s.toml:3: `object[0].keys[1].at_s`"),
        "{reason}"
    );
    assert_eq!(status["scene"]["loads"], 1);
    desk.put(
        "s.toml",
        moving(1.0).replace("keys", "animation = \"walk\"\nkeys"),
    );
    let unknown = |s: &Value| s["scene"]["reason"].to_string().contains("no animation");
    rig.until("the unknown animation", unknown);
}

const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n\
    property float y\nproperty float z\nelement face 1\n\
    property list uchar int vertex_indices\nend_header\n0 0 0\n0.1 0 0\n0 0.1 0\n3 0 1 2\n";

/// Moving the complete model does not bake again; changing one object does, while the rig keeps
/// composing pictures.
#[test]
fn bakes_planes_again_only_for_changed_objects() {
    let desk = Desk::new();
    desk.put("s.toml", scene([0.0, 0.1], ""));
    desk.put(
        "c.toml",
        "[planes]\ncount = 12\nresolution = 32\ncache = \"kept\"\n",
    );
    let rig = Running::start(
        &desk,
        "--scene s.toml --config c.toml --technique shadowing-planes --speed max",
    );
    let ready = |s: &Value| s["planes"]["state"] == "ready";
    let first = rig.until("the bake", ready);
    let elsewhere = "[model]\nposition_m = [0.05, 0.02, 0]";
    desk.put("s.toml", scene([0.0, 0.1], elsewhere));
    let moved = rig.until("the motion", |s| s["scene"]["loads"] == 1);
    assert_eq!(moved["planes"]["state"], "ready");
    let bake = |s: &Value| {
        (
            s["planes"]["bake_seconds"].clone(),
            s["planes"]["planes"].clone(),
        )
    };
    assert_eq!(bake(&moved), bake(&first), "nothing was baked again");
    assert!(moved["planes"]["planes_seen"].as_u64() > Some(0));
    desk.put("s.toml", scene([0.0, 0.15], elsewhere));
    let changed = rig.until("the new bake", |s| s["scene"]["loads"] == 2 && ready(s));
    assert_ne!(bake(&changed).0, bake(&first).0);
    // Updated bakes are not cached.
    assert_eq!(desk.names("kept").len(), 1);
}
