//! `replay`: the frames that it writes, and the report.

use crate::program::{Desk, desk_session, text};
use crate::sessions::{put_rig_folder, put_tum_folder, put_with_flipped_byte, scene_frames};
use penumbra_picture::{Picture, YuvEncoding};
use penumbra_session::{Camera, Session, SessionEvent, SessionWriter};

const QUIET: &str = "--headless --speed max --listen 127.0.0.1:0";

fn picture(desk: &Desk, name: &str) -> Picture {
    Picture::from_file_bytes(&desk.read(name)).unwrap()
}

#[test]
fn same_input_gives_identical_frames() {
    let desk = Desk::new();
    let line = format!("replay DESK {QUIET} --frames 3");
    desk.works(&format!("{line} --frames-out first --report report.json"));
    desk.works(&format!("{line} --frames-out second"));
    let names = ["00000.png", "00001.png", "00002.png"];
    assert_eq!(desk.names("first"), names);
    assert_eq!(desk.names("second"), names);
    for name in names {
        assert_eq!(
            desk.read(format!("first/{name}")),
            desk.read(format!("second/{name}"))
        );
    }
    assert_object_is_drawn(&desk);
    assert_report_is_complete(&desk);
}

#[test]
fn moving_objects_are_identical_in_every_replay() {
    let desk = Desk::new();
    desk.put(
        "s.toml",
        "[[object]]\nshape = \"box\"\nsize_m = [0.06, 0.06, 0.06]\neasing = \"linear\"\n\
         keys = [{ at_s = 0 }, { at_s = 0.4, position_m = [0.1, 0, 0] }]\n",
    );
    // Indirect light is updated half a second after the beginning.
    let line = format!("replay DESK {QUIET} --scene s.toml --light-count 8 --frames 16");
    desk.works(&format!("{line} --frames-out first"));
    desk.works(&format!("{line} --frames-out second"));
    let names = desk.names("first");
    assert_eq!(names, desk.names("second"));
    for name in &names {
        assert_eq!(
            desk.read(format!("first/{name}")),
            desk.read(format!("second/{name}")),
            "{name}"
        );
    }
}

fn assert_object_is_drawn(desk: &Desk) {
    let frame = &scene_frames(1)[0];
    let seen = Picture::decode(frame, &YuvEncoding::default()).unwrap();
    let drawn = picture(desk, "first/00000.png");
    let changed = drawn
        .rgba
        .chunks(4)
        .zip(seen.rgba.chunks(4))
        .filter(|(a, b)| a != b)
        .count();
    // A teapot and its shadow cover several per cent of 640×480.
    assert!(
        changed > 10_000,
        "{changed} pixels differ from the camera's"
    );
}

fn assert_report_is_complete(desk: &Desk) {
    let report = desk.json("report.json");
    assert_eq!(report["version"], 1);
    assert_eq!(report["session"], "desk.mcap");
    assert_eq!(report["truncated"], false);
    assert_eq!(report["resolution"], serde_json::json!([640, 480]));
    let frames = &report["frames"];
    assert_eq!(frames["composed"], 3);
    for key in ["skipped", "damaged", "without_pose"] {
        assert_eq!(frames[key], 0, "{key}");
    }
    assert!(frames["in_session"].as_u64().unwrap() >= 3);
    assert!(
        report["adapter"]
            .as_str()
            .is_some_and(|name| !name.is_empty())
    );
    assert_eq!(report["lights"], 64);
    assert!(report["skew_ms"]["max"].as_f64().unwrap() >= 0.0);
    let gains = report["white_balance"]["gains"].as_array().unwrap();
    assert!(gains.len() == 3 && gains.iter().all(|g| g.as_f64().unwrap() > 0.0));
    let stages = report["stages"].as_array().unwrap();
    for name in ["decode", "environment", "composite", "output", "total"] {
        let stage = stages
            .iter()
            .find(|s| s["name"] == name)
            .unwrap_or_else(|| panic!("{name}"));
        let (p50, p99) = (
            stage["p50_ms"].as_f64().unwrap(),
            stage["p99_ms"].as_f64().unwrap(),
        );
        assert!(p50 > 0.0 && p99 >= p50, "{name}: {p50} {p99}");
    }
}

#[test]
fn picture_without_virtual_objects_equals_the_cameras() {
    let desk = Desk::new();
    for mode in ["ratio", "subtract"] {
        let line = format!("replay DESK {QUIET} --scene none --frames 2 --light-count 8");
        desk.works(&format!("{line} --shadow-mode {mode} --frames-out {mode}"));
        for (i, frame) in scene_frames(2).iter().enumerate() {
            let seen = Picture::decode(frame, &YuvEncoding::default()).unwrap();
            let written = picture(&desk, &format!("{mode}/{i:05}.png"));
            assert_eq!((written.width, written.height), (seen.width, seen.height));
            assert!(written.rgba == seen.rgba, "{mode}: picture {i} differs");
        }
    }
}

#[test]
fn plays_the_readable_part_of_a_truncated_session() {
    let desk = Desk::new();
    let complete = std::fs::read(desk_session()).unwrap();
    desk.put("cut.mcap", &complete[..complete.len() * 7 / 10]);
    let line = format!("replay cut.mcap {QUIET} --frames 1 --light-count 8 --report report.json");
    let output = desk.run(&line);
    let printed = text(&output.stderr);
    assert!(output.status.success(), "{printed}");
    assert_eq!(printed.lines().count(), 1, "{printed}");
    assert!(
        printed.contains("cut.mcap") && printed.contains("cut off"),
        "{printed}"
    );
    assert_eq!(desk.json("report.json")["truncated"], true);
}

#[test]
fn force_overwrites_existing_files() {
    let desk = Desk::new();
    desk.put(
        "report.json",
        "mine, and longer than any other file should be".repeat(1000),
    );
    desk.put("frames/00000.png", "mine");
    let line = format!("replay DESK {QUIET} --frames 1 --light-count 8 --force");
    desk.works(&format!("{line} --report report.json --frames-out frames"));
    assert_eq!(desk.json("report.json")["frames"]["composed"], 1);
    assert_eq!(picture(&desk, "frames/00000.png").width, 640);
}

/// Options of the command line override the file; all other settings are the file's.
#[test]
fn command_line_overrides_the_configuration() {
    let desk = Desk::new();
    let config = "[output]\nwindow = false\nframes = \"pictures\"\n\
        [replay]\nspeed = \"max\"\n[environment]\nlight_count = 24\n[status]\nlisten = \"127.0.0.1:0\"\n";
    desk.put("settings/rig.toml", config);
    desk.works("replay DESK --config settings/rig.toml --frames 1 --report 24.json");
    assert_eq!(desk.json("24.json")["lights"], 24);
    assert_eq!(desk.names("settings/pictures"), ["00000.png"]);
    let typed = "--light-count 8 --frames-out here --report 8.json";
    desk.works(&format!(
        "replay DESK --config settings/rig.toml --frames 1 {typed}"
    ));
    assert_eq!(desk.json("8.json")["lights"], 8);
    assert_eq!(desk.names("here"), ["00000.png"]);
}

#[test]
fn imported_folder_plays_like_its_session() {
    let desk = Desk::new();
    // With the environment picture after the last frame: light is interpolated between two.
    put_rig_folder(&desk, "rig", 14);
    let printed = desk.works("import rig rig.mcap");
    assert!(
        printed.contains("rig.mcap") && printed.contains("14 scene pictures"),
        "{printed}"
    );
    let line = format!("{QUIET} --frames 2 --light-count 8 --frames-out");
    desk.works(&format!("replay rig.mcap {line} imported"));
    desk.works(&format!("replay DESK {line} bundled"));
    for name in ["00000.png", "00001.png"] {
        let same = desk.read(format!("imported/{name}")) == desk.read(format!("bundled/{name}"));
        assert!(same, "{name} differs");
    }
}

#[test]
fn plays_a_tum_folder() {
    let desk = Desk::new();
    put_tum_folder(&desk, "tum");
    let printed = desk.works("import tum tum.mcap");
    assert!(
        printed.contains("2 scene pictures") && printed.contains("3 poses"),
        "{printed}"
    );
    desk.works(&format!(
        "replay tum.mcap {QUIET} --frames-out out --report report.json"
    ));
    assert_eq!(desk.names("out"), ["00000.png", "00001.png"]);
    let report = desk.json("report.json");
    assert_eq!(report["frames"]["composed"], 2);
    assert_eq!(report["frames"]["without_pose"], 0);
    assert_eq!(report["white_balance"], serde_json::Value::Null);
    assert_eq!(report["lights"], 0);
}

/// Puts an environment map in which radiance is 1 everywhere but for a lamp above +Y.
fn put_map(desk: &Desk, name: &str) {
    let mut texels = [[128, 128, 128, 129]; 16 * 32];
    texels[5 * 32 + 8] = [128, 128, 128, 137];
    let mut file = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n".to_vec();
    file.extend(texels.as_flattened());
    desk.put(name, &file);
}

#[test]
fn stated_light_and_pose_serve_a_recording_that_has_neither() {
    let desk = Desk::new();
    put_tum_folder(&desk, "tum");
    std::fs::remove_file(desk.path("tum/groundtruth.txt")).unwrap();
    put_map(&desk, "map.hdr");
    desk.works("import tum tum.mcap");
    let light = "[environment]\nsource = \"map\"\nmap = \"map.hdr\"\n";
    let pose = "[registration]\nfixed_position_m = [0, -0.5, 0.4]\nfixed_look_at_m = [0, 0, 0]\n";
    desk.put(
        "box.toml",
        "[[object]]\nshape = \"box\"\nsize_m = [0.2, 0.2, 0.2]\n",
    );
    desk.put("dark.toml", pose);
    desk.put("bright.toml", format!("{light}map_ev = 1\n{pose}"));
    let mean = |name: &str| {
        desk.works(&format!(
            "replay tum.mcap {QUIET} --config {name}.toml --scene box.toml --frames-out {name} \
             --report {name}.json"
        ));
        let report = desk.json(&format!("{name}.json"));
        assert_eq!(report["frames"]["without_pose"], 0);
        let picture = picture(&desk, &format!("{name}/00000.png"));
        let sum: u64 = picture.rgba.iter().map(|code| u64::from(*code)).sum();
        (report["lights"].clone(), sum)
    };
    let (none, dark) = mean("dark");
    let (all, bright) = mean("bright");
    assert_eq!((none, all), (0.into(), 64.into()));
    assert!(bright > dark, "{bright} {dark}");
}

#[test]
fn exposure_is_reproducible_and_zero_changes_nothing() {
    let desk = Desk::new();
    desk.put(
        "auto.toml",
        "[exposure]\nmode = \"auto\"\nkey = 0.9\nadaptation_s = 0.05\n\
         [shadows]\nsoft = false\n",
    );
    let line = format!("replay DESK {QUIET} --config auto.toml --frames 5 --light-count 8");
    for (folder, exposure) in [
        ("off", "--exposure off"),
        ("none", "--exposure 0"),
        ("shorter", "--exposure -1.5"),
        ("auto", ""),
        ("again", ""),
    ] {
        desk.works(&format!("{line} {exposure} --frames-out {folder}"));
    }
    let files = |folder: &str| -> Vec<Vec<u8>> {
        let names = desk.names(folder).into_iter();
        names.map(|n| desk.read(format!("{folder}/{n}"))).collect()
    };
    assert!(files("off").len() == 5 && files("off") == files("none"));
    assert!(files("auto") == files("again"));
    // The exposure measured in one picture is used two pictures later.
    assert!(files("auto")[..2] == files("off")[..2] && files("auto")[4] != files("off")[4]);
    let sum = |name: &str| -> u64 {
        picture(&desk, name)
            .rgba
            .iter()
            .map(|v| u64::from(*v))
            .sum()
    };
    assert!(sum("shorter/00004.png") < sum("off/00004.png"));
    assert!(sum("auto/00004.png") > sum("off/00004.png"));
}

#[test]
fn one_flipped_byte_is_said_with_all_that_it_costs() {
    let desk = Desk::new();
    put_with_flipped_byte(&desk, "damaged.mcap", 5);
    let described = desk.works("info damaged.mcap");
    let line = described.lines().find(|l| l.contains("damaged at byte"));
    let line = line.unwrap_or_else(|| panic!("{described}"));
    assert!(line.contains(" of /scene_camera/image from "), "{line}");

    let output = desk.run(&format!(
        "replay damaged.mcap {QUIET} --light-count 0 --report report.json"
    ));
    assert!(output.status.success());
    let error = text(&output.stderr);
    let lost = line.split("lost: ").nth(1).unwrap();
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(error.contains("WARN") && error.contains(lost), "{error}");
    let report = desk.json("report.json");
    let frames = &report["frames"];
    let number = frames["lost"].as_u64().unwrap();
    assert_eq!(number + frames["composed"].as_u64().unwrap(), 60);
    assert!(number > 0 && text(&output.stdout).contains(&format!("{number} lost")));
    assert_eq!(report["inputs"]["damaged_stretches"], 1);
    let streams = report["damage"][0]["lost"].as_array().unwrap();
    let scene = streams
        .iter()
        .find(|l| l["stream"] == "/scene_camera/image");
    assert_eq!(scene.unwrap()["messages"].as_u64(), Some(number));
}

#[test]
fn damage_is_said_by_whatever_reads_the_session() {
    let desk = Desk::new();
    put_with_flipped_byte(&desk, "damaged.mcap", 0);
    let session = desk.path("damaged.mcap").display().to_string();
    let calibration = desk_session().display().to_string();
    desk.put(
        "rig.toml",
        format!(
            "[scene_camera]\ndevice = \"replay:{session}\"\n[calibration]\nfrom = \
             \"{calibration}\"\n[environment]\nlight_count = 8\n"
        ),
    );
    for line in [
        "light damaged.mcap --out light",
        "calibrate intrinsics --session damaged.mcap --board chess:9x6:0.02 --out lens.json",
        "run --config rig.toml --headless --listen 127.0.0.1:0 --frames 3",
    ] {
        let error = text(&desk.run(line).stderr);
        assert!(
            error.contains(" of /scene_camera/image from "),
            "{line}: {error}"
        );
    }
}

#[test]
fn wrong_station_is_said_once() {
    let desk = Desk::new();
    desk.put(
        "rig.toml",
        "[tracker]\ndevice = \"/dev/ttyUSB0\"\nstation = 2\n",
    );
    let output = desk.run(&format!(
        "replay DESK {QUIET} --config rig.toml --light-count 0 --frames 20"
    ));
    let error = text(&output.stderr);
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(
        error.contains("no reading of station 2") && error.contains("stations seen: 1;"),
        "{error}"
    );
}

#[test]
fn damaged_pictures_are_named_and_counted() {
    let desk = Desk::new();
    let session = Session::open(&desk_session()).unwrap();
    let mut writer = SessionWriter::create(&desk.path("dark.mcap")).unwrap();
    for attachment in session.attachments() {
        writer.attach(&attachment.name, &attachment.data).unwrap();
    }
    let mut base = 0;
    for event in session.events() {
        match event.unwrap() {
            SessionEvent::Scene(mut frame) => {
                if frame.sequence == 3 {
                    frame.data = frame.data.slice(..frame.data.len() / 2);
                }
                writer.frame(Camera::Scene, &frame).unwrap();
            }
            SessionEvent::Environment(mut frame) => {
                base += u32::from(frame.bracket_ev == 0.0);
                if base == 2 && frame.bracket_ev == 0.0 {
                    frame.data = frame.data.slice(..frame.data.len() / 2);
                }
                writer.frame(Camera::Environment, &frame).unwrap();
            }
            _ => (),
        }
    }
    writer.finish().unwrap();
    let output = desk.run(&format!(
        "replay dark.mcap {QUIET} --light-count 0 --frames 25 --report report.json"
    ));
    let error = text(&output.stderr);
    assert!(output.status.success(), "{error}");
    for part in [
        "warning: environment picture",
        "warning: scene picture: damaged",
    ] {
        assert!(error.contains(part), "{error}");
    }
    let problems = desk.json("report.json")["picture_problems"].clone();
    assert_eq!(problems.as_array().unwrap().len(), 2, "{problems}");
    assert_eq!(problems[0]["pictures"], 1, "{problems}");
    // The recording has no tracker.
    let printed = text(&output.stdout);
    assert!(
        printed.contains("25 without pose (the tracker sent no readings)"),
        "{printed}"
    );
}
