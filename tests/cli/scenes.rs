//! Scene files and models that are chosen and uploaded while the rig runs.

use crate::program::{Desk, text};
use crate::reload::{Running, scene};
use crate::service::get;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// A triangle as PLY.
const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
    property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n0.1 0 0\n0 0.1 0\n3 0 1 2\n";

/// Posts a body; returns status and answer.
pub fn post(address: &str, path: &str, content_type: &str, body: &[u8]) -> (u16, Value) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\
         Content-Type: {content_type}\r\nContent-Length: {}\r\n\r\n",
        body.len()
    );
    let _ = stream.write_all(&[head.as_bytes(), body].concat());
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let answer = text(&answer);
    let status = answer.split(' ').nth(1).unwrap().parse().unwrap();
    let (_, body) = answer.split_once("\r\n\r\n").unwrap();
    (status, serde_json::from_str(body).unwrap())
}

fn show(rig: &Running, name: &str) -> (u16, Value) {
    let body = json!({ "show": name }).to_string();
    post(
        rig.address(),
        "/scenes",
        "application/json",
        body.as_bytes(),
    )
}

fn upload(rig: &Running, name: &str, content: impl AsRef<[u8]>) -> (u16, Value) {
    let path = format!("/scenes/upload?name={name}");
    let content_type = "application/octet-stream";
    post(rig.address(), &path, content_type, content.as_ref())
}

fn files(rig: &Running) -> Vec<String> {
    let answer = get(rig.address(), "/scenes");
    let (_, body) = answer.split_once("\r\n\r\n").unwrap();
    let folder: Value = serde_json::from_str(body).unwrap();
    let files = folder["files"].as_array().unwrap();
    files
        .iter()
        .map(|f| f["name"].as_str().unwrap().to_owned())
        .collect()
}

#[test]
fn scenes_and_models_of_the_folder_are_shown() {
    let desk = Desk::new();
    desk.put("scenes/a.toml", scene([0.0, 0.1], ""));
    desk.put("scenes/broken.toml", "[[object]]\nshape = \"boks\"\n");
    desk.put("scenes/triangle.ply", TRIANGLE);
    desk.put("scenes/notes.txt", "");
    desk.put("outside.toml", scene([0.0, 0.1], ""));
    let rig = Running::start(&desk, "--speed max");
    rig.until("the first picture", |s| {
        s["frames"]["composed"].as_u64() > Some(0)
    });
    assert_eq!(files(&rig), ["a.toml", "broken.toml", "triangle.ply"]);
    assert_eq!(show(&rig, "a.toml").0, 202);
    let status = rig.until("the scene", |s| s["scene"]["loads"] == 1);
    assert_eq!(status["scene"]["file"], "scenes/a.toml");
    assert_eq!(status["objects"]["list"].as_array().unwrap().len(), 2);
    let (refused, answer) = show(&rig, "broken.toml");
    assert_eq!(refused, 422, "{answer}");
    let reason = answer["error"].as_str().unwrap();
    assert!(
        reason.starts_with("scenes/broken.toml:2: `object[0].shape`"),
        "{reason}"
    );
    assert_eq!(show(&rig, "gone.toml").0, 404);
    assert_eq!(show(&rig, "../outside.toml").0, 422);
    assert_eq!(rig.status()["scene"]["file"], "scenes/a.toml");
    // The chosen file is read again when it changes.
    desk.put("scenes/a.toml", scene([0.0, 0.2], ""));
    rig.until("the change", |s| s["scene"]["loads"] == 2);
    assert_eq!(show(&rig, "triangle.ply").0, 202);
    let status = rig.until("the model", |s| s["scene"]["loads"] == 3);
    assert_eq!(status["objects"]["list"].as_array().unwrap().len(), 1);
    assert_eq!(show(&rig, "none").0, 202);
    let status = rig.until("nothing", |s| s["scene"]["loads"] == 4);
    assert_eq!(status["objects"]["list"].as_array().unwrap().len(), 0);
    assert_eq!(show(&rig, "session").0, 202);
    let status = rig.until("the session's own", |s| s["scene"]["loads"] == 5);
    assert!(status["scene"]["file"].is_null());
    assert_eq!(status["objects"]["list"].as_array().unwrap().len(), 1);
    assert_eq!(status["warnings"].as_array().unwrap().len(), 0, "{status}");
}

#[test]
fn uploads_are_checked_and_stay_in_the_folder() {
    let desk = Desk::new();
    desk.put("secret.ply", TRIANGLE);
    let rig = Running::start(&desk, "--speed max");
    rig.until("the first picture", |s| {
        s["frames"]["composed"].as_u64() > Some(0)
    });
    let (status, answer) = upload(&rig, "..%2F..%2Ftriangle.ply", TRIANGLE);
    assert_eq!((status, &answer["name"]), (202, &"triangle.ply".into()));
    assert_eq!(desk.read("scenes/triangle.ply"), TRIANGLE.as_bytes());
    // None is overwritten.
    assert_eq!(upload(&rig, "triangle.ply", "ply").0, 409);
    assert_eq!(desk.read("scenes/triangle.ply"), TRIANGLE.as_bytes());
    let model = "[[object]]\nfile = \"triangle.ply\"\n";
    assert_eq!(upload(&rig, "s.toml", model).0, 202);
    assert_eq!(show(&rig, "s.toml").0, 202);
    rig.until("the upload", |s| s["scene"]["loads"] == 1);
    for (name, content, part) in [
        ("broken.toml", "[[object]]\nshape = 1\n", "broken.toml:2"),
        (
            "out.toml",
            "[[object]]\nfile = \"../secret.ply\"\n",
            "outside",
        ),
        ("broken.glb", "glTF", "broken.glb"),
        ("broken.png", "PNG", "broken.png"),
    ] {
        let (status, answer) = upload(&rig, name, content);
        let reason = answer["error"].as_str().unwrap();
        assert!(status == 422 && reason.contains(part), "{name}: {reason}");
        assert!(!reason.contains("unchecked"), "{reason}");
    }
    assert_eq!(desk.names("scenes"), ["s.toml", "triangle.ply"]);
}

/// Moves the first object.
fn move_first(rig: &Running, request: Value) {
    let body = request.to_string();
    let (status, answer) = post(
        rig.address(),
        "/objects",
        "application/json",
        body.as_bytes(),
    );
    assert_eq!(status, 202, "{answer}");
    rig.until("the move", |s| {
        s["objects"]["shown"] == s["objects"]["requested"]
    });
}

fn save(rig: &Running, body: &str) -> (u16, Value) {
    post(
        rig.address(),
        "/scenes/save",
        "application/json",
        body.as_bytes(),
    )
}

/// The eighth picture of the session with a scene.
fn picture(desk: &Desk, scene: &str) -> Vec<u8> {
    let frames = scene.replace('/', "-");
    let line = "replay DESK --headless --light-count 8 --frames 8 --speed max --quality live";
    let out = desk.run(&format!(
        "{line} --frames-out {frames} --scene {scene} --force"
    ));
    assert!(out.status.success(), "{}", text(&out.stderr));
    desk.read(format!("{frames}/00007.png"))
}

#[test]
fn the_sessions_object_is_saved_where_it_was_moved() {
    let desk = Desk::new();
    let rig = Running::start(&desk, "--speed max");
    rig.until("the first picture", |s| {
        s["frames"]["composed"].as_u64() > Some(0)
    });
    // Unmoved, the saved scene shows what the session shows.
    assert_eq!(save(&rig, r#"{"file": "same.toml"}"#).0, 202);
    assert_eq!(
        picture(&desk, "scenes/same.toml"),
        picture(&desk, "session")
    );
    move_first(
        &rig,
        json!({"object": 0, "offset_m": [0.05, 0.0, 0.0], "turn_deg": 30, "scale": 0.5}),
    );
    let (status, answer) = save(&rig, r#"{"file": "moved.toml"}"#);
    assert_eq!(
        (status, &answer["file"]),
        (202, &"scenes/moved.toml".into())
    );
    assert_eq!(
        desk.names("scenes"),
        ["moved.glb", "moved.toml", "same.glb", "same.toml"]
    );
    assert_eq!(save(&rig, r#"{"file": "moved.toml"}"#).0, 409);
    assert_ne!(
        picture(&desk, "scenes/moved.toml"),
        picture(&desk, "scenes/same.toml")
    );
    // Shown and saved again, it is where it was, and without a change the text is the same.
    assert_eq!(show(&rig, "moved.toml").0, 202);
    rig.until("the saved scene", |s| s["scene"]["loads"] == 1);
    assert_eq!(save(&rig, r#"{"file": "again.toml"}"#).0, 202);
    assert_eq!(
        desk.read("scenes/again.toml"),
        desk.read("scenes/moved.toml")
    );
    let (status, answer) = save(&rig, "{}");
    assert_eq!(status, 202, "{answer}");
    assert_eq!(show(&rig, "none").0, 202);
    rig.until("nothing", |s| s["scene"]["loads"] == 2);
    assert_eq!(save(&rig, "{}").0, 422);
}
