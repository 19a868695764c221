//! The other commands: `info`, `check-config`, `doctor`, `bench`, `light`.

use crate::program::{Desk, desk_session, text};

#[test]
fn info_lists_streams_rates_and_attachments() {
    let printed = Desk::new().works("info DESK");
    let scene = printed
        .lines()
        .find(|l| l.starts_with("/scene_camera/image"))
        .unwrap();
    assert!(scene.contains("60") && scene.contains("29.8"), "{scene}");
    for part in [
        "/environment_camera/image_ev-8",
        "/tracker/bytes",
        "fastrak",
        "rig.json",
    ] {
        assert!(printed.contains(part), "{part}: {printed}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_behind_standard_output_is_an_error() {
    let desk = Desk::new();
    let session = desk_session().display().to_string();
    for line in [&["info", &session][..], &["--help"], &["--version"]] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full");
        let output = desk.command(line).stdout(full.unwrap()).output().unwrap();
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{line:?}: {error}");
        assert!(
            error.starts_with("penumbra: standard output cannot be written"),
            "{error}"
        );
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

#[test]
fn check_config_lists_changed_settings() {
    let desk = Desk::new();
    desk.put(
        "rig.toml",
        "[shadows]\nmode = \"subtract\"\nstrength = 1.0\n",
    );
    let printed = desk.works("check-config rig.toml");
    assert!(printed.contains("shadows.mode = \"subtract\""), "{printed}");
    assert!(!printed.contains("strength"), "{printed}");
}

#[test]
fn tools_print_json_for_scripts() {
    let desk = Desk::new();
    let json = |line: &str| -> serde_json::Value {
        let printed = desk.works(line);
        serde_json::from_str(&printed).unwrap_or_else(|e| panic!("{line}: {e}: {printed}"))
    };
    let info = json("info DESK --json");
    assert_eq!(info["tracker_protocol"], "fastrak");
    let streams = info["streams"].as_array().unwrap();
    let environment = streams
        .iter()
        .find(|s| s["topic"] == "/environment_camera/image");
    // Its brackets are no lost pictures.
    assert_eq!(environment.unwrap()["lost"], 0);
    let doctor = json("doctor --listen 127.0.0.1:0 --json");
    assert_eq!(doctor["checks"][0]["state"], "ok");
    desk.put("rig.toml", "[shadows]\nmode = \"subtract\"\n");
    let config = json("check-config rig.toml --json");
    assert_eq!(config["effective"]["shadows"]["mode"], "subtract");
    assert_eq!(config["effective"]["scene"]["file"], "session");
    let all = desk.works("check-config rig.toml --all");
    desk.put("all.toml", all);
    desk.works("check-config all.toml");
}

#[test]
fn completions_and_man_pages_are_generated() {
    let desk = Desk::new();
    let script = desk.works("completions bash");
    assert!(script.contains("--frames-out"), "{script}");
    desk.works("man pages");
    assert!(
        desk.names("pages")
            .contains(&"penumbra-replay.1".to_owned())
    );
    let output = desk.run("man pages");
    assert!(!output.status.success() && text(&output.stderr).contains("--force"));
}

#[test]
fn doctor_fails_if_the_program_cannot_work() {
    let desk = Desk::new();
    let output = desk.run("doctor --adapter nonesuch --listen 127.0.0.1:0");
    let printed = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{printed}");
    assert!(
        printed.contains("FAIL") && printed.contains("fix:"),
        "{printed}"
    );
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
    let printed = desk.works("doctor --listen 127.0.0.1:0");
    assert!(
        printed.contains("shaders") && !printed.contains("FAIL"),
        "{printed}"
    );
}

#[test]
fn bench_writes_a_row_for_each_setting_of_the_paper() {
    let desk = Desk::new();
    let printed = desk.works("bench --case supan --frames 1 --size 64x48 --json bench.json");
    assert!(printed.contains("wall p50"), "{printed}");
    let report = desk.json("bench.json");
    assert_eq!(report["version"], 1);
    let rows = report["rows"].as_array().unwrap();
    let setting = |row: &serde_json::Value| {
        [&row["lights"], &row["refreshed_per_frame"]].map(|n| n.as_u64().unwrap())
    };
    let settings: Vec<_> = rows.iter().map(setting).collect();
    assert_eq!(settings, [[0, 0], [8, 1], [48, 1], [64, 1], [64, 64]]);
    for row in rows {
        assert_eq!(
            (&row["case"], &row["triangles"]),
            (&"supan".into(), &58_500.into())
        );
        assert_eq!((&row["width"], &row["height"]), (&64.into(), &48.into()));
        assert!(row["fps"].as_f64().unwrap() > 0.0);
        assert!(row["wall_ms"]["p99"].as_f64() >= row["wall_ms"]["p50"].as_f64());
        assert!(row["gpu_ms"]["p50"].is_number());
        assert!(row["passes"].is_array());
    }
}

#[test]
fn bench_measures_the_steps_of_light_probe_and_lamps() {
    let desk = Desk::new();
    let printed = desk.works("bench --case lightprobe --frames 2 --size 160x120 --json bench.json");
    assert!(
        printed.contains("mirrored sphere in the picture"),
        "{printed}"
    );
    let report = desk.json("bench.json");
    let rows = report["rows"].as_array().unwrap();
    let lamps: Vec<_> = rows.iter().map(|r| r["lamps"].as_u64().unwrap()).collect();
    assert!(lamps.starts_with(&[1, 2, 4, 8]), "{lamps:?}");
    for row in rows {
        assert!(row["processor_ms"].as_f64() > Some(0.0), "{row}");
        let names = |key: &str| -> Vec<String> {
            let each = row[key].as_array().unwrap().iter();
            each.map(|p| p["name"].as_str().unwrap().to_owned())
                .collect()
        };
        let (stages, passes) = (names("stages"), names("passes"));
        let in_parallel = row["environment"]
            .as_str()
            .unwrap()
            .ends_with("in parallel");
        for name in ["gather", "prefilter", "light", "compose"] {
            assert!(
                in_parallel || stages.iter().any(|n| n == name),
                "{name}: {stages:?}"
            );
        }
        for name in ["exposure", "exposure_table", "lamp_map", "composite"] {
            assert!(passes.iter().any(|n| n == name), "{name}: {passes:?}");
        }
    }
}

#[test]
fn bench_measures_capture_per_thread_without_a_gpu() {
    let desk = Desk::new();
    let line = "bench --case capture --adapter none-is-opened --frames 30 --size 320x240";
    let printed = desk.works(&format!("{line} --json bench.json"));
    assert!(printed.contains("two cameras, 320x240 JPEG"), "{printed}");
    assert!(!printed.contains("adapter"), "{printed}");
    let report = desk.json("bench.json");
    assert!(report["adapter"].is_null() && report["rows"] == serde_json::json!([]));
    let row = &report["capture"][0];
    assert_eq!((&row["width"], &row["height"]), (&320.into(), &240.into()));
    for device in row["devices"].as_array().unwrap() {
        // One second of 30 pictures, or of 120 readings; a busy machine may miss some.
        let min = if device["device"] == "tracker" {
            40
        } else {
            20
        };
        assert!(device["delivered"].as_u64() >= Some(min), "{device}");
    }
    assert!(row["prepared_with_pose"].as_u64() > Some(5), "{row}");
    assert!(row["decode_ms"]["p50"].as_f64() > Some(0.0), "{row}");
    let cost = |name: &str| {
        let threads = row["threads"].as_array().unwrap();
        let thread = threads.iter().find(|t| t["name"] == name);
        thread.unwrap_or_else(|| panic!("{name}: {row}"))["percent_of_core"]
            .as_f64()
            .unwrap()
    };
    for name in ["scene-camera", "env-camera", "tracker", "prepare"] {
        assert!(cost(name) > 0.0 && cost(name) < 150.0, "{name}: {row}");
    }
    assert!(cost("scene-camera") < cost("prepare"), "{row}");
    assert!(cost("scene-camera") < 20.0, "{row}");
}

#[test]
fn bench_measures_the_latency_of_live_pictures() {
    let desk = Desk::new();
    let printed =
        desk.works("bench --case live --session DESK --size 320x180 --frames 5 --json live.json");
    assert!(printed.contains("arrival to picture"), "{printed}");
    let report = desk.json("live.json");
    let rows = report["live"].as_array().unwrap();
    let lights: Vec<_> = rows.iter().map(|row| row["lights"].as_u64()).collect();
    assert_eq!(lights, [8, 8, 8, 64].map(Some));
    for row in rows {
        let ms = |part: &str| row[part]["p50"].as_f64().unwrap();
        assert_eq!((&row["width"], &row["height"]), (&320.into(), &180.into()));
        assert!(row["composed"].as_u64() >= Some(5), "{row}");
        assert!(row["frames_per_second"].as_f64() > Some(0.0), "{row}");
        let (arrival, total) = (ms("arrival_to_picture_ms"), ms("total_ms"));
        assert!(total > 0.0 && arrival >= total, "{row}");
    }
    assert!(report["recovery_seconds"].as_f64() > Some(0.0), "{report}");
    let refused = desk.refuses("bench --case live --session nowhere.mcap");
    assert!(refused.contains("nowhere.mcap"), "{refused}");
}

#[test]
fn writes_maps_and_lights_of_a_session() {
    let desk = Desk::new();
    let printed = desk.works("light DESK --out light");
    assert!(printed.contains("elevation"), "{printed}");
    let files = [
        "environment.exr",
        "environment.png",
        "light.json",
        "lights.png",
    ];
    assert_eq!(desk.names("light"), files);
    let light = desk.json("light/light.json");
    let d: Vec<f64> = light["dominant_direction"]["vector"]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    // The light comes from above.
    assert!(
        d[2] > 0.0 && (d.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-4,
        "{d:?}"
    );
    assert!(!light["dome_lights"].as_array().unwrap().is_empty());
    // A line for each lamp, those with a place with its uncertainty.
    let lamps = light["lamps"].as_array().unwrap();
    assert_eq!(printed.matches("lamp at").count(), lamps.len(), "{printed}");
    let places = lamps.iter().filter(|l| l["distance_sigma_m"].is_f64());
    assert_eq!(printed.matches(" ± ").count(), places.count(), "{printed}");
    assert!(printed.contains(" ± "), "{printed}");
    let line = desk.refuses("light DESK --kind sphere --out other");
    assert!(line.contains("--kind"), "{line}");
}

#[test]
fn light_survives_a_wrong_tone_curve_of_the_environment_camera() {
    let desk = Desk::new();
    desk.put("wrong.toml", "[environment]\nresponse = \"linear\"\n");
    desk.works("light DESK --out right");
    let output = desk.run("light DESK --config wrong.toml --out wrong");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && said.contains("contradict its tone curve"),
        "{said}"
    );
    let irradiance = |folder: &str| -> Vec<f64> {
        let light = desk.json(&format!("{folder}/light.json"));
        let up = light["irradiance"]["plus_z"].as_array().unwrap();
        up.iter().map(|x| x.as_f64().unwrap()).collect()
    };
    for (right, wrong) in irradiance("right").iter().zip(irradiance("wrong")) {
        assert!((wrong / right - 1.0).abs() < 0.05, "{right} {wrong}");
    }
}

/// A picture of 240×200 pixels: a brighter ball with a soft border before a grey wall. Its codes by the
/// place in its disc, the border at 1.
fn before_wall(ball: impl Fn(f64, f64) -> f64) -> Vec<u8> {
    let picture = image::RgbImage::from_fn(240, 200, |x, y| {
        let (x, y) = ((f64::from(x) - 125.0) / 80.0, (f64::from(y) - 96.0) / 80.0);
        let inside = (1.0 - x.hypot(y)) * 20.0 + 0.5;
        let level = 90.0 + (ball(x, y) - 90.0) * inside.clamp(0.0, 1.0);
        image::Rgb([level as u8; 3])
    });
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    png.into_inner()
}

#[test]
fn light_names_and_draws_the_sphere_that_it_found() {
    let desk = Desk::new();
    // A bright sky over darker ground, photographed horizontally.
    let mirror = |x: f64, y: f64| {
        let up = -2.0 * y * (1.0 - x * x - y * y).max(0.0).sqrt();
        if up > 0.0 { 250.0 } else { 150.0 }
    };
    desk.put("ball.png", before_wall(mirror));
    let printed = desk.works("light ball.png --out light");
    assert!(
        printed.starts_with("mirrored sphere: centre (125, "),
        "{printed}"
    );
    let found = desk.json("light/light.json")["photograph"].clone();
    assert_eq!(found["kind"], "sphere");
    let near =
        |value: &serde_json::Value, expected: f64| (value.as_f64().unwrap() - expected).abs() < 1.0;
    assert!(near(&found["centre"][0], 125.0), "{found}");
    assert!(near(&found["centre"][1], 96.0), "{found}");
    assert!(near(&found["radius"], 80.0), "{found}");
    assert!(found["visible_share"].as_f64().unwrap() > 0.9, "{found}");
    let drawn = image::load_from_memory(&desk.read("light/found.png"))
        .unwrap()
        .into_rgb8();
    let [red, green, blue] = drawn.get_pixel(125, 16).0;
    assert!(green > 200 && red < 100 && blue < 120);

    desk.put("wall.png", before_wall(|_, _| 90.0));
    let refused = desk.refuses("light wall.png --out nothing");
    assert!(refused.contains("--calibration FILE"), "{refused}");
    desk.put("apple.png", before_wall(|_, y| 200.0 - 30.0 * y));
    let refused = desk.refuses("light apple.png --out nothing");
    assert!(refused.contains("like something matt"), "{refused}");
    assert!(!desk.path("nothing").exists());
}

#[test]
fn light_refuses_files_that_are_not_pictures() {
    let desk = Desk::new();
    desk.put("notes.png", "no picture");
    desk.put("calibration.toml", "radios = 3\n");
    assert!(
        desk.refuses("light notes.png --out light")
            .contains("notes.png")
    );
    assert!(
        desk.refuses("light gone.png --out light")
            .contains("gone.png")
    );
    let line = desk.refuses("light notes.png --calibration calibration.toml --out light");
    assert!(line.contains("calibration.toml"), "{line}");
    assert!(!desk.path("light").exists());
}

/// They never end.
#[cfg(target_os = "linux")]
#[test]
fn endless_devices_are_refused() {
    let desk = Desk::new();
    for line in [
        "light /dev/zero --out light",
        "simulate tracker --pty --trajectory /dev/zero",
    ] {
        let error = desk.refuses(line);
        assert!(error.contains("larger than the limit"), "{line}: {error}");
    }
}

#[test]
fn help_names_the_commands() {
    let printed = Desk::new().works("--help");
    for command in [
        "replay",
        "import",
        "info",
        "light",
        "check-config",
        "doctor",
        "bench",
    ] {
        assert!(printed.contains(command), "{command}: {printed}");
    }
}
