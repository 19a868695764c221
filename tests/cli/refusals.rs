//! Wrong input: a one-line error, a non-zero exit status, no panic, nothing overwritten.

use crate::program::{Desk, desk_session};
use crate::sessions::{put_foreign, put_session, scene_frames};
use penumbra_interface::Frame;
use penumbra_session::{Camera, Session, SessionWriter};
use std::net::TcpListener;

/// Options for a quick refusal: no window, and a free port.
const QUICK: &str = "--headless --speed max --frames 1 --light-count 8 --listen 127.0.0.1:0";

fn replay_error(desk: &Desk, arguments: &str) -> String {
    desk.refuses(&format!("replay {arguments} {QUICK}"))
}

#[track_caller]
fn assert_contains(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
}

#[test]
fn refuses_files_that_are_not_sessions() {
    let desk = Desk::new();
    desk.put("empty.mcap", "");
    desk.put("notes.mcap", "dear diary, today the rig did not work");
    desk.put("cut.mcap", &std::fs::read(desk_session()).unwrap()[..200]);
    put_foreign(&desk, "weather.mcap");
    assert_contains(
        &replay_error(&desk, "nowhere.mcap"),
        &["nowhere.mcap", "no such session", "import"],
    );
    assert_contains(&replay_error(&desk, "empty.mcap"), &["empty.mcap", "empty"]);
    assert_contains(
        &replay_error(&desk, "notes.mcap"),
        &["notes.mcap", "not an MCAP file", "import"],
    );
    assert_contains(
        &replay_error(&desk, "cut.mcap"),
        &["cut.mcap", "truncated before its first complete chunk"],
    );
    assert_contains(
        &replay_error(&desk, "weather.mcap"),
        &["weather.mcap", "/weather"],
    );
    assert_contains(&replay_error(&desk, "."), &["."]);
    for name in ["nowhere", "empty", "notes", "cut", "weather"] {
        let line = desk.refuses(&format!("info {name}.mcap"));
        assert_contains(&line, &[name]);
    }
}

#[test]
fn refuses_incomplete_sessions() {
    let desk = Desk::new();
    put_session(&desk, "bare.mcap", &[]);
    put_session(
        &desk,
        "garbled.mcap",
        &[("rig.json", b"{\"scene_camera\": ")],
    );
    put_session(
        &desk,
        "half.mcap",
        &[("rig.json", b"{\"scene_camera\": {}}")],
    );
    let session = Session::open(&desk_session()).unwrap();
    let attachment = |name: &'static str| (name, session.attachment(name).unwrap());
    let rest = ["rig.json", "phantoms/box.ply", "phantoms/cylinder.ply"].map(attachment);
    put_session(&desk, "no-object.mcap", &rest);
    let broken: (&str, &[u8]) = ("object/object.glb", b"glTF, but not");
    put_session(&desk, "object.mcap", &[&rest[..], &[broken]].concat());
    assert_contains(&replay_error(&desk, "bare.mcap"), &["rig.json"]);
    assert_contains(
        &replay_error(&desk, "garbled.mcap"),
        &["rig.json", "line 1"],
    );
    assert_contains(
        &replay_error(&desk, "half.mcap"),
        &["rig.json", "scene_camera"],
    );
    assert_contains(&replay_error(&desk, "object.mcap"), &["object/object.glb"]);
    assert_contains(
        &replay_error(&desk, "no-object.mcap"),
        &["object/object.glb"],
    );
}

#[test]
fn refuses_wrong_configurations() {
    let desk = Desk::new();
    let cases = [
        (
            "key",
            "[shadows]\nstrenght = 1.0\n",
            vec!["key.toml:2", "strenght", "strength"],
        ),
        (
            "section",
            "[shadow]\nmode = \"ratio\"\n",
            vec!["section.toml:1", "shadow"],
        ),
        (
            "unit",
            "[sync]\ntracker_latency_ms = \"9 ms\"\n",
            vec!["unit.toml:2", "tracker_latency_ms"],
        ),
        (
            "other-unit",
            "[sync]\ntracker_latency_s = 0.009\n",
            vec!["other-unit.toml:2", "_ms"],
        ),
        (
            "range",
            "[environment]\nlight_count = 65\n",
            vec!["range.toml:2", "light_count", "64"],
        ),
        (
            "scene",
            "[scene]\nfile = \"gone.toml\"\n",
            vec!["scene.toml:2", "gone.toml"],
        ),
        ("toml", "[shadows\n", vec!["toml.toml:1"]),
        (
            "open",
            "[status]\nlisten = \"0.0.0.0:0\"\n",
            vec!["open.toml:2", "token"],
        ),
    ];
    for (name, content, parts) in cases {
        desk.put(&format!("{name}.toml"), content);
        assert_contains(
            &replay_error(&desk, &format!("DESK --config {name}.toml")),
            &parts,
        );
        assert_contains(&desk.refuses(&format!("check-config {name}.toml")), &parts);
    }
    assert_contains(
        &replay_error(&desk, "DESK --config gone.toml"),
        &["gone.toml"],
    );
    assert_contains(&desk.refuses("check-config gone.toml"), &["gone.toml"]);
}

#[test]
fn refuses_wrong_scenes() {
    let desk = Desk::new();
    let object = |file: &str| format!("[[object]]\nname = \"it\"\nfile = \"{file}\"\n");
    desk.put("broken.glb", b"glTF\x02\0\0\0 and then nothing of use");
    desk.put("broken.toml", object("broken.glb"));
    desk.put("gone.toml", object("gone.glb"));
    let outside = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",
        "min":[0,0,0],"max":[1,1,1]}],"bufferViews":[{"buffer":0,"byteLength":36}],
        "buffers":[{"uri":"../secret.bin","byteLength":36}]}"#;
    desk.put("secret.bin", [0; 36]);
    desk.put("below/outside.gltf", outside);
    desk.put("below/scene.toml", object("outside.gltf"));
    assert_contains(
        &replay_error(&desk, "DESK --scene broken.toml"),
        &["broken.glb"],
    );
    assert_contains(
        &replay_error(&desk, "DESK --scene gone.toml"),
        &["gone.glb"],
    );
    assert_contains(
        &replay_error(&desk, "DESK --scene below/scene.toml"),
        &["outside.gltf", "../secret.bin"],
    );
    assert_contains(
        &replay_error(&desk, "DESK --scene nowhere.toml"),
        &["nowhere.toml"],
    );
}

#[test]
fn refuses_ports_in_use_and_public_addresses_without_token() {
    let desk = Desk::new();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let line = desk.refuses(&format!(
        "replay DESK --headless --frames 1 --listen {address}"
    ));
    assert_contains(&line, &[&address.port().to_string(), "in use", "--listen"]);
    let line = desk.refuses("replay DESK --headless --frames 1 --listen 0.0.0.0:0");
    assert_contains(&line, &["0.0.0.0:0", "token"]);
}

#[test]
fn refuses_missing_adapters() {
    let desk = Desk::new();
    assert_contains(
        &replay_error(&desk, "DESK --adapter nonesuch"),
        &["nonesuch", "not found"],
    );
    assert_contains(
        &desk.refuses("bench --adapter nonesuch"),
        &["nonesuch", "not found"],
    );
    let bare = Desk::new()
        .with("VK_DRIVER_FILES", "/nonexistent")
        .with("VK_ICD_FILENAMES", "/nonexistent");
    assert_contains(
        &replay_error(&bare, "DESK"),
        &["no graphics adapter", "install", "doctor"],
    );
    assert_contains(
        &bare.refuses("bench"),
        &["no graphics adapter", "install", "doctor"],
    );
}

#[test]
fn refuses_a_window_without_a_window_system() {
    let desk = Desk::new();
    let line = desk.refuses("replay DESK --frames 1 --listen 127.0.0.1:0");
    assert_contains(&line, &["no window", "--headless"]);
}

/// Existing output files are never overwritten without `--force`.
#[test]
fn nothing_is_overwritten_without_force() {
    let desk = Desk::new();
    desk.put("report.json", "mine");
    desk.put("bench.json", "mine");
    desk.put("light/light.json", "mine");
    desk.put("frames/00007.png", "mine");
    desk.put("session.mcap", "mine");
    let quick = format!("replay DESK {QUICK}");
    assert_contains(
        &desk.refuses(&format!("{quick} --report report.json")),
        &["report.json", "--force"],
    );
    assert_contains(
        &desk.refuses(&format!("{quick} --frames-out frames")),
        &["frames", "--force"],
    );
    assert_contains(
        &desk.refuses("bench --json bench.json"),
        &["bench.json", "--force"],
    );
    assert_contains(
        &desk.refuses("light DESK --out light"),
        &["light.json", "--force"],
    );
    assert_contains(
        &desk.refuses("import . session.mcap"),
        &["session.mcap", "--force"],
    );
    for name in [
        "report.json",
        "bench.json",
        "light/light.json",
        "frames/00007.png",
        "session.mcap",
    ] {
        assert_eq!(desk.read(name), b"mine", "{name}");
    }
    assert_eq!(desk.names("frames"), ["00007.png"]);
    assert_contains(
        &desk.refuses(&format!("{quick} --report gone/report.json")),
        &["gone"],
    );
}

#[test]
fn unknown_words_print_the_usage() {
    let desk = Desk::new();
    let lines = [
        "replay",
        "replay DESK --speed fast",
        "replay DESK --light-count 65",
        "replay DESK --lights best",
        "replay DESK --headless --fullscreen",
        "bench --case cornell",
        "bench --size 800",
        "light DESK",
        "sing",
    ];
    for line in lines {
        let output = desk.run(line);
        assert_eq!(output.status.code(), Some(2), "{line}");
        assert!(!output.stderr.is_empty(), "{line}");
    }
}

#[test]
fn check_config_looks_at_what_the_configuration_names() {
    let desk = Desk::new();
    desk.put("broken/rig.json", "{ \"scene_camera\": 3 }");
    desk.put("cut.mcap", "\u{89}MCAP0");
    desk.put("file", "");
    let cases = [
        (
            "[calibration]\nfrom = \"gone\"\n",
            vec!["`calibration.from`", "gone"],
        ),
        (
            "[calibration]\nfrom = \"broken\"\n",
            vec!["`calibration.from`", "rig.json"],
        ),
        (
            "[calibration]\nfrom = \"cut.mcap\"\n",
            vec!["`calibration.from`", "cut.mcap"],
        ),
        (
            "[scene_camera]\ndevice = \"replay:gone.mcap\"\n",
            vec!["`scene_camera.device`", "gone.mcap"],
        ),
        (
            "[tracker]\ndevice = \"replay:cut.mcap\"\n",
            vec!["`tracker.device`", "cut.mcap"],
        ),
        (
            "[recording]\nfolder = \"file\"\n",
            vec!["`recording.folder`", "file"],
        ),
        (
            "[scene]\nfolder = \"file\"\n",
            vec!["`scene.folder`", "file"],
        ),
        (
            "[status]\nguide = \"gone.pdf\"\n",
            vec!["[status] guide", "gone.pdf"],
        ),
    ];
    for (content, mut parts) in cases {
        desk.put("c.toml", content);
        parts.push("c.toml");
        assert_contains(&desk.refuses("check-config c.toml"), &parts);
    }
}

#[test]
fn record_refuses_a_broken_rig_json() {
    let desk = Desk::new();
    desk.put("rig/rig.json", "{ \"scene_camera\": 3 }");
    let session = desk_session().display().to_string();
    desk.put(
        "c.toml",
        format!("[scene_camera]\ndevice = \"replay:{session}\"\n[calibration]\nfrom = \"rig\"\n"),
    );
    let error = desk.refuses("record out.mcap --config c.toml --duration 1");
    assert_contains(&error, &["rig.json"]);
    assert!(!desk.path("out.mcap").exists());
}

#[test]
fn replay_refuses_pictures_of_another_size_than_the_calibration() {
    let desk = Desk::new();
    let session = Session::open(&desk_session()).unwrap();
    let rig = String::from_utf8(session.attachment("rig.json").unwrap().to_vec()).unwrap();
    let mut rig: serde_json::Value = serde_json::from_str(&rig).unwrap();
    rig["scene_camera"]["image_size"] = serde_json::json!([800, 480]);
    let rig = rig.to_string();
    let attachments = session.attachments().iter();
    let attachments: Vec<_> = attachments
        .map(|a| match a.name.as_str() {
            "rig.json" => ("rig.json", rig.as_bytes()),
            name => (name, &a.data[..]),
        })
        .collect();
    put_session(&desk, "other.mcap", &attachments);
    assert_contains(
        &replay_error(&desk, "other.mcap --scene none"),
        &["other.mcap: its pictures have ", "800x"],
    );
}

#[test]
fn replay_refuses_a_session_of_damaged_pictures() {
    let desk = Desk::new();
    let session = Session::open(&desk_session()).unwrap();
    let mut writer = SessionWriter::create(&desk.path("damaged.mcap")).unwrap();
    for attachment in session.attachments() {
        writer.attach(&attachment.name, &attachment.data).unwrap();
    }
    for frame in scene_frames(3) {
        let data = bytes::Bytes::from_static(b"\xff\xd8\xff\xe0 and then nothing");
        let damaged = Frame { data, ..frame };
        writer.frame(Camera::Scene, &damaged).unwrap();
    }
    writer.finish().unwrap();
    assert_contains(
        &replay_error(&desk, "damaged.mcap"),
        &[
            "damaged.mcap: all 3 pictures of the scene camera are damaged (scene picture: damaged Jpeg",
        ],
    );
}
