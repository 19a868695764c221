use super::*;
use proptest::prelude::*;
use std::path::Path;

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../config")
        .join(name)
}

fn complaint(text: &str) -> String {
    let text = Config::from_text(text, "c.toml").unwrap_err().to_string();
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

#[test]
fn rig_toml_equals_the_defaults() {
    assert_eq!(
        Config::load(&shipped("rig.toml")).unwrap(),
        Config::default()
    );
    assert_eq!(Config::from_text("", "").unwrap(), Config::default());
}

#[test]
#[expect(clippy::too_many_lines, reason = "every setting once")]
fn rig_toml_names_every_key() {
    // With every commented-out key active, the file must still be read, and each key must change a
    // setting.
    let uncommented: String = convert::DEFAULTS
        .lines()
        .map(|line| match line.strip_prefix("# ") {
            Some(rest)
                if rest
                    .split_once(" = ")
                    .is_some_and(|(key, _)| !key.contains(' ')) =>
            {
                rest
            }
            _ => line,
        })
        .collect::<Vec<_>>()
        .join("\n");
    let config = Config::from_text(&uncommented, "all").unwrap();
    assert!(config.scene_camera.response.is_some() && config.environment.response.is_some());
    assert_eq!(config.environment.brackets_ev, Some(vec![-4.0, -8.0]));
    assert_eq!(config.sync.tracker_latency_nanos, Some(8_000_000));
    assert_eq!(config.sync.scene_camera_latency_nanos, Some(0));
    assert_eq!(config.sync.environment_camera_latency_nanos, Some(0));
    assert_eq!(config.output.monitor, Some(Monitor::Index(0)));
    assert!(config.output.freed.is_some());
    assert!(config.output.frames.is_some() && config.status.token.is_some());
    assert_eq!(config.calibration, Some(PathBuf::from("calibration")));
    assert!(config.recording.max_duration_nanos.is_some());
    assert_eq!(config.planes.cache, Some(PathBuf::from("bakes")));
    let CameraSource::System(scene) = &config.scene_camera.source else {
        panic!("{:?}", config.scene_camera);
    };
    assert_eq!((scene.width, scene.controls.len()), (1280, 5));
    let Some(CameraSource::System(environment)) = &config.environment_camera else {
        panic!("{:?}", config.environment_camera);
    };
    let bracket = environment.bracket.as_ref().unwrap();
    assert_eq!((bracket.hold, bracket.lag), (2, Some(2)));
    assert!(matches!(config.tracker, Some(TrackerSource::System(_))));
    // Every key of the type is in the file: the parser itself lists what it knows.
    for section in [
        "scene",
        "scene_camera",
        "environment",
        "registration",
        "white_balance",
        "shadows",
        "planes",
        "exposure",
        "picture",
        "sync",
        "input",
        "output",
        "status",
        "gpu",
        "replay",
        "environment_camera",
        "tracker",
        "calibration",
        "recording",
    ] {
        let error = complaint(&format!("[{section}]\nqqqqqqq = 1\n"));
        let known = error.split("known here: ").nth(1).unwrap_or_else(|| {
            // A section with a single key.
            error.split('`').nth(3).unwrap_or_else(|| panic!("{error}"))
        });
        for key in known.split(", ") {
            assert!(
                uncommented.contains(&format!("\n{key} = "))
                    // In place of another key, in the prose.
                    || uncommented.contains(&format!(": {key} = "))
                    || uncommented.contains(&format!("\n[{section}.{key}]")),
                "{section}.{key} is not in rig.toml"
            );
        }
    }
}

#[test]
fn lamps_with_a_place_are_read_and_checked() {
    let text =
        "[[room_light]]\nposition = [0.4, -0.1, 0.6]\n[[room_light]]\nposition = [0, 1, 2]\n";
    let config = Config::from_text(text, "").unwrap();
    let expected = [[0.4, -0.1, 0.6], [0.0, 1.0, 2.0]].map(|position| RoomLight::Lamp { position });
    assert_eq!(config.environment.room_lights, expected);
    let text = "[[room_light]]\ncorners = [[2, -1, 0], [2, 1, 0], [2, 1, 1.5], [2, -1, 1.5]]\n";
    let config = Config::from_text(text, "").unwrap();
    let lights = &config.environment.room_lights;
    assert!(matches!(lights[..], [RoomLight::Window { corners }] if corners[2] == [2.0, 1.0, 1.5]));
    for (wrong, part) in [
        (
            "[[room_light]]\nposition = [0.4, nan, 0.6]\n",
            "room_light[0].position",
        ),
        (
            "[[room_light]]\nposition = [0.4, 2e4, 0.6]\n",
            "metres from -1000 to 1000",
        ),
        ("[[room_light]]\nposition = [0.4]\n", "position"),
        ("[[room_light]]\n", "either `position`"),
        (
            "[[room_light]]\nposition = [0, 0, 1]\ncorners = [[2, -1, 0], [2, 1, 0], [2, 1, 1], [2, -1, 1]]\n",
            "either `position`",
        ),
        (
            "[[room_light]]\ncorners = [[2, -1, 0], [2, 1, 1.5], [2, 1, 0], [2, -1, 1.5]]\n",
            "along its edge",
        ),
        (
            "[[room_light]]\ncorners = [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]\n",
            "along its edge",
        ),
        (
            "[[room_light]]\ncorners = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0]]\n",
            "along its edge",
        ),
        (
            "[[room_light]]\ncorners = [[0, 0, 0], [1, 0, 0], [1, 0, inf], [0, 0, 1]]\n",
            "room_light[0].corners",
        ),
        ("[[room_light]]\ncorners = [[0, 0, 0]]\n", "corners"),
        ("[environment]\nlight_places = \"near\"\n", "light_places"),
    ] {
        let error = complaint(wrong);
        assert!(error.contains(part), "{error}");
    }
    let many = "[[room_light]]\nposition = [0, 0, 1]\n".repeat(17);
    assert!(complaint(&many).contains("at most 16 lights"));
}

#[test]
fn reads_the_bundled_configurations() {
    for name in [
        "replay.toml",
        "demo.toml",
        "demo-temple.toml",
        "demo-lamp.toml",
        "demo-desk.toml",
    ] {
        check_config(&shipped(name)).unwrap();
    }
    let replay = Config::load(&shipped("replay.toml")).unwrap();
    assert_eq!(replay.replay.speed, ReplaySpeed::Max);
    assert!(!replay.output.window);
    assert!(Config::load(&shipped("demo.toml")).unwrap().replay.repeat);
}

#[test]
fn checks_the_scene_of_a_configuration() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("b.glb"), "glTF nonsense").unwrap();
    std::fs::write(
        folder.path().join("scene.toml"),
        "[[object]]\nfile = \"b.glb\"\n",
    )
    .unwrap();
    let config = folder.path().join("rig.toml");
    std::fs::write(&config, "[scene]\nfile = \"scene.toml\"\n").unwrap();
    let text = check_config(&config).unwrap_err().to_string();
    assert!(text.contains("b.glb: not a usable glTF"), "{text}");
}

#[test]
fn summary_lists_changed_settings() {
    assert!(
        check_config(&shipped("rig.toml"))
            .unwrap()
            .changed
            .is_empty()
    );
    let summary = check_config(&shipped("replay.toml")).unwrap();
    assert!(
        summary
            .changed
            .contains(&"replay.speed = \"max\"".to_owned()),
        "{summary}"
    );
    assert!(!summary.to_string().contains("loop"), "{summary}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lamp.toml");
    std::fs::write(&path, "[[room_light]]\nposition = [0.5, 1.0, 2.0]\n").unwrap();
    let changed = check_config(&path).unwrap().changed;
    assert_eq!(changed, ["[[room_light]] position = [0.5, 1.0, 2.0]"]);
}

#[test]
fn reads_settings() {
    let config = Config::from_text(
        "[environment]\nsource = \"sphere-in-scene\"\nlight_placement = \"grid\"\nlight_count = 96\n\
         response = 2.2\nstale_after_ms = 250\n[shadows]\nmode = \"subtract\"\n\
         refresh_per_frame = 1\nstrength = 0.5\n[white_balance]\nmethod = \"fixed\"\n\
         gains = [1, 2, 3]\n[sync]\ntracker_latency_ms = -1.5\n[output]\nmonitor = \"HDMI\"\n\
         [gpu]\nadapter = \"llvmpipe\"\n[picture]\nantialias = \"off\"\n[scene]\nfile = \"none\"\n",
        "c.toml",
    )
    .unwrap();
    assert_eq!(config.environment.source, EnvironmentSource::SphereInScene);
    assert_eq!(config.environment.light_placement, LightPlacement::Grid);
    assert_eq!(config.environment.light_count, 96);
    assert_eq!(config.environment.response, Some(ToneCurve::Gamma(2.2)));
    assert_eq!(config.environment.stale_after_nanos, 250_000_000);
    assert_eq!(config.shadows.mode, ShadowMode::Subtract);
    assert_eq!(config.shadows.refresh_per_frame, Refresh::Count(1));
    assert_eq!(config.shadows.strength, 0.5);
    assert_eq!(config.white_balance.gains, [1.0, 2.0, 3.0]);
    assert_eq!(config.sync.tracker_latency_nanos, Some(-1_500_000));
    assert_eq!(config.output.monitor, Some(Monitor::Name("HDMI".into())));
    assert_eq!(config.gpu.adapter.as_deref(), Some("llvmpipe"));
    assert_eq!(config.picture.antialias, Antialias::Off);
    assert_eq!(config.scene, SceneChoice::None);
}

#[test]
fn reads_settings_of_planes() {
    let text = "[shadows]\ntechnique = \"shadowing-planes\"\n[planes]\ncount = 8\nclusters = 1\n\
        resolution = 64\nfrequency = 4\nsamples = 4\noffset_m = 0.1\nreceiver = \"plane\"\n\
        sources = false\nskip_below = 0\nrecompute_above = 0.5\nshading = \"six\"\ncache = \"kept\"\n";
    let config = convert::config(&TomlText::new("c.toml", text), Path::new("/rig")).unwrap();
    assert_eq!(config.shadows.technique, Technique::ShadowingPlanes);
    let expected = PlanesConfig {
        count: 8,
        clusters: 1,
        resolution: 64,
        frequency: 4,
        samples: 4,
        offset: 0.1,
        receiver: PlaneReceiver::Plane,
        sources: false,
        skip_below: 0.0,
        recompute_above: 0.5,
        shading: PlaneShading::Six,
        cache: Some(PathBuf::from("/rig/kept")),
    };
    assert_eq!(config.planes, expected);
    let bake = config.planes.bake_settings();
    assert_eq!((bake.resolution, bake.frequency, bake.samples), (64, 4, 4));
}

#[test]
fn reads_settings_of_the_exposure() {
    let text = "[exposure]\nmode = \"auto\"\nev = -1.5\nmin_ev = -2\nmax_ev = 0\n\
        key = 0.2\nadaptation_s = 0\nhighlights = \"paper\"\n";
    let expected = ExposureConfig {
        highlights: Highlights::Paper,
        mode: ExposureMode::Auto,
        ev: -1.5,
        min_ev: -2.0,
        max_ev: 0.0,
        key: 0.2,
        adaptation_seconds: 0.0,
    };
    assert_eq!(
        Config::from_text(text, "c.toml").unwrap().exposure,
        expected
    );
}

#[test]
fn reads_settings_of_the_shading() {
    let text =
        "[shading]\nreflections = \"box\"\nindirect_light = false\nlamp_response = \"paper\"\n";
    let expected = ShadingConfig {
        reflections: Filtering::Box,
        indirect_light: false,
        lamp_response: LampResponse::Paper,
    };
    assert_eq!(Config::from_text(text, "c.toml").unwrap().shading, expected);
}

#[test]
#[expect(clippy::too_many_lines, reason = "one case per line")]
fn explains_wrong_settings() {
    let cases = [
        (
            "[shadows]\nstrenght = 1\n",
            "c.toml:2: unknown key `shadows.strenght`; did you mean `strength`?",
        ),
        (
            "[shadow]\nstrength = 1\n",
            "c.toml:1: unknown key `shadow`; did you mean `shadows`?",
        ),
        (
            "[sync]\ntracker_latency = 8\n",
            "c.toml:2: unknown key `sync.tracker_latency`; did you mean `tracker_latency_ms` (in milliseconds)?",
        ),
        (
            "[sync]\n\ntracker_latency_ms = \"8 ms\"\n",
            "c.toml:3: `sync.tracker_latency_ms`: expected a number, found string \"8 ms\" (the unit is milliseconds)",
        ),
        (
            "[sync]\ntracker_latency_ms = 8e6\n",
            "c.toml:2: `sync.tracker_latency_ms`: expected a number from -1000 to 1000, found 8000000",
        ),
        (
            "[shadows]\nstrength = nan\n",
            "c.toml:2: `shadows.strength`: expected a number from 0 to 1, found NaN",
        ),
        (
            "[environment]\nlight_count = 65\n",
            "c.toml:2: `environment.light_count`: expected one of [0, 8, 24, 48, 64, 96, 384], found 65",
        ),
        (
            "[environment]\ncube_size = 100\n",
            "c.toml:2: `environment.cube_size`: expected a power of two from 16 to 512, found 100",
        ),
        (
            "[shadows]\nmode = \"ration\"\n",
            "c.toml:2: `shadows.mode`: expected `ratio` or `subtract`, found unknown variant `ration`",
        ),
        (
            "[shadows]\nrefresh_per_frame = 0\n",
            "c.toml:2: `shadows.refresh_per_frame`: expected a whole number from 1 to 384, or \"all\", found 0",
        ),
        (
            "[shadows]\nrefresh_per_frame = true\n",
            "c.toml:2: `shadows.refresh_per_frame`: expected a whole number from 1 to 384, or \"all\", found boolean `true`",
        ),
        (
            "[environment]\nsource = \"moon\"\n",
            "c.toml:2: `environment.source`: expected one of `auto`, `camera`, `sphere-in-scene`, `map`, found unknown variant `moon`",
        ),
        (
            "[status]\nlisten = \"8780\"\n",
            "c.toml:2: `status.listen`: expected an address and a port such as \"127.0.0.1:8780\", found \"8780\"",
        ),
        (
            "[status]\nlisten = \"0.0.0.0:8780\"\n",
            "c.toml:2: `status.listen`: 0.0.0.0:8780 can be reached from other machines; set `token`, or listen on 127.0.0.1",
        ),
        (
            "[status]\ntoken = \"short\"\n",
            "c.toml:2: `status.token`: expected 12 to 256 letters, digits or -._~",
        ),
        (
            "[white_balance]\nmethod = \"fixed\"\n",
            "c.toml:2: `white_balance.method`: \"fixed\" needs `gains`; add three linear gains: red, green, blue",
        ),
        (
            "[scene]\nfile = \"gone.toml\"\n",
            "c.toml:2: `scene.file`: there is no file gone.toml; expected a scene file, \"session\" or \"none\"",
        ),
        (
            "[scene_camera]\nwidth = 0\n",
            "c.toml:2: `scene_camera.width`: expected a whole number from 1 to 16384, found 0",
        ),
        (
            "[environment_camera]\nwidth = 640\n",
            "c.toml:1: `environment_camera`: the camera is not named; add `device`",
        ),
        (
            "[scene_camera]\nformats = [\"mpeg\"]\n",
            "c.toml:2: `scene_camera.formats[0]`: expected one of `mjpeg`, `yuyv`, `nv12`, `rgb24`, `grey`, `bayer-rggb`, \
             `bayer-bggr`, `bayer-grbg`, `bayer-gbrg`, found unknown variant `mpeg`",
        ),
        (
            "[scene_camera.controls]\ngain = \"high\"\n",
            "c.toml:2: `scene_camera.controls.gain`: expected a whole number, true or false, found string \"high\"",
        ),
        (
            "[scene_camera]\nexposure = 1\n",
            "c.toml:2: unknown key `scene_camera.exposure`; known here: response, device, width, height, frames_per_second, formats, buffers, gain_per_unit, on_control_change, silent_after_ms, controls",
        ),
        (
            "[environment_camera]\ndevice = \"x\"\nbrackets_ev = [-4, -8]\n",
            "c.toml:3: `environment_camera.brackets_ev`: expected at most 16 stops between -30 and 30, one of them 0 (the base exposure)",
        ),
        (
            "[environment_camera]\ndevice = \"x\"\nbracket_hold = 2\n",
            "c.toml:1: `environment_camera`: the exposures are missing; add `brackets_ev`",
        ),
        (
            "[tracker]\nbaud = 9600\n",
            "c.toml:1: `tracker`: the tracker's connection is missing; add `device`",
        ),
        (
            "[tracker]\ndevice = \"x\"\nhemisphere = \"front\"\n",
            "c.toml:3: `tracker.hemisphere`: expected one of `forward`, `back`, `right`, `left`, `lower`, `upper`, found unknown variant `front`",
        ),
        (
            "[tracker]\ndevice = \"x\"\nstation = 0\n",
            "c.toml:3: `tracker.station`: expected a whole number from 1 to 16, found 0",
        ),
        (
            "[recording]\nreserve_mb = -1\n",
            "c.toml:2: `recording.reserve_mb`: expected a number from 0 to 1000000000, found -1",
        ),
        (
            "[shadows]\ntechnique = \"plane\"\n",
            "c.toml:2: `shadows.technique`: expected one of `image-based-shadowing`, `shadowing-planes`, \
             `image-based-lighting`, found unknown variant `plane`",
        ),
        (
            "[exposure]\nev = nan\n",
            "c.toml:2: `exposure.ev`: expected a number from -8 to 3, found NaN",
        ),
        (
            "[exposure]\nmode = \"dark\"\n",
            "c.toml:2: `exposure.mode`: expected one of `off`, `manual`, `auto`, found unknown variant `dark`",
        ),
        (
            "[exposure]\nmin_ev = 1\n",
            "c.toml:2: `exposure.min_ev`: expected a number from -8 to 0, found 1",
        ),
        (
            "[planes]\nfrequency = 5\n",
            "c.toml:2: `planes.frequency`: expected one of [2, 4, 6, 8], found 5",
        ),
        (
            "[planes]\nresolution = 130\n",
            "c.toml:2: `planes.resolution`: expected a multiple of 4 from 16 to 512, found 130",
        ),
        (
            "[planes]\ncount = 0\n",
            "c.toml:2: `planes.count`: expected a whole number from 2 to 256, found 0",
        ),
        (
            "[planes]\noffset = 0.1\n",
            "c.toml:2: unknown key `planes.offset`; did you mean `offset_m` (in metres)?",
        ),
        (
            "[planes]\nskip_below = nan\n",
            "c.toml:2: `planes.skip_below`: expected a number from 0 to 1, found NaN",
        ),
        (
            "[planes]\nshading = \"all\"\n",
            "c.toml:2: `planes.shading`: expected one of `irradiance`, `lights`, `six`, found unknown variant `all`",
        ),
        (
            "[replay]\npairing = \"late\"\n",
            "c.toml:2: `replay.pairing`: expected one of `auto`, `live`, `complete`, found unknown variant `late`",
        ),
        (
            "[white_balance]\ngains = [1, 2]\n",
            "c.toml:2: `white_balance.gains`: expected an array of length 3, found length 2",
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(complaint(text), expected);
    }
}

#[test]
fn reads_device_names_and_resolves_files_against_the_configurations_folder() {
    let text = "[scene_camera]\ndevice = \"replay:a.mcap\"\n[environment_camera]\n\
                device = \"usb:046d:0825\"\non_control_change = \"restore\"\n\
                [environment_camera.controls]\nauto_exposure = 1\nfocus_automatic_continuous = false\n\
                [tracker]\ndevice = \"udp:0.0.0.0:40000\"\nprotocol = \"freed\"\n\
                [scene]\nfolder = \"s\"\nmax_upload_mb = 2\n\
                [calibration]\nfrom = \"c\"\n[recording]\nfolder = \"r\"\nmax_duration_s = 60\n";
    let text = TomlText::new("c.toml", text);
    let config = convert::config(&text, Path::new("/rig")).unwrap();
    assert_eq!(config.scene_folder(), PathBuf::from("/rig/s"));
    assert_eq!(config.scene_files.max_upload_bytes, 2_000_000);
    let replayed = CameraSource::Replay(PathBuf::from("/rig/a.mcap"));
    assert_eq!(config.scene_camera.source, replayed);
    let Some(CameraSource::System(camera)) = config.environment_camera else {
        panic!("a real camera");
    };
    assert_eq!(camera.device, "usb:046d:0825");
    assert_eq!(camera.on_change, penumbra_interface::OnChange::Restore);
    let locked = |name: &str, value| (name.to_owned(), value);
    assert_eq!(
        camera.controls,
        [
            locked("auto_exposure", 1),
            locked("focus_automatic_continuous", 0)
        ]
    );
    let Some(TrackerSource::System(tracker)) = config.tracker else {
        panic!("a real tracker");
    };
    assert_eq!((tracker.protocol.as_str(), tracker.station), ("freed", 1));
    assert_eq!(config.calibration, Some(PathBuf::from("/rig/c")));
    assert_eq!(config.recording.folder, PathBuf::from("/rig/r"));
    let mut other = Config::default();
    assert_eq!(other.scene_folder(), PathBuf::from("scenes"));
    other.scene = SceneChoice::File("a/b.toml".into());
    assert_eq!(other.scene_folder(), PathBuf::from("a"));
    other.scene = SceneChoice::File("b.toml".into());
    assert_eq!(other.scene_folder(), PathBuf::from("."));
    assert_eq!(config.recording.max_duration_nanos, Some(60_000_000_000));
    assert_eq!(
        TrackerUnits::from_metres(0.0254),
        Some(TrackerUnits::Inches)
    );
    assert_eq!(TrackerUnits::from_metres(0.001), None);
}

#[test]
fn token_allows_other_addresses_and_is_not_printed() {
    let config = Config::from_text(
        "[status]\nlisten = \"0.0.0.0:80\"\ntoken = \"open-sesame-now\"\n",
        "c.toml",
    )
    .unwrap();
    assert_eq!(config.status.token.as_deref(), Some("open-sesame-now"));
    assert!(!format!("{config:?}").contains("open-sesame-now"));
}

#[test]
fn command_line_accepts_the_words_of_the_configuration() {
    assert_eq!("max".parse(), Ok(ReplaySpeed::Max));
    assert_eq!("0.5".parse(), Ok(ReplaySpeed::Factor(0.5)));
    assert!("fast".parse::<ReplaySpeed>().unwrap_err().contains("max"));
    assert_eq!("all".parse(), Ok(Refresh::All));
    assert_eq!("8".parse(), Ok(Refresh::Count(8)));
    assert!("0".parse::<Refresh>().is_err() && "1.5".parse::<Refresh>().is_err());
    assert_eq!("1".parse(), Ok(Monitor::Index(1)));
    assert_eq!("HDMI-1".parse(), Ok(Monitor::Name("HDMI-1".into())));
    assert_eq!(SceneChoice::from_text("none"), SceneChoice::None);
    assert_eq!(Refresh::Count(8).count(4), 4);
    assert_eq!(Refresh::All.count(64), 64);
}

#[test]
fn reads_the_example_scene() {
    let scene = SceneAddition::load(&shipped("scene.toml")).unwrap();
    assert!(scene.objects.len() > 1 && scene.session_phantoms);
}

proptest! {
    #[test]
    fn any_text_is_read_or_refused_in_one_line(
        at in 0usize..6000, byte: u8, cut in prop::option::of(0usize..6000),
    ) {
        let mut bytes = convert::DEFAULTS.as_bytes().to_vec();
        if let Some(b) = bytes.get_mut(at) {
            *b = byte;
        }
        bytes.truncate(cut.unwrap_or(usize::MAX));
        if let Err(e) = Config::from_text(&String::from_utf8_lossy(&bytes), "c.toml") {
            let text = e.to_string();
            prop_assert!(text.lines().count() == 1 && text.contains("c.toml:"), "{}", text);
        }
    }
}

#[test]
fn refuses_former_names_with_the_new_ones() {
    for (text, expected) in [
        (
            "[environment]\n\nlights = \"grid\"\n",
            "c.toml:3: `environment.lights`: is now called `light_placement`",
        ),
        (
            "[shadows]\nenabled = false\n",
            "c.toml:2: `shadows.enabled`: is gone; `technique = \"image-based-lighting\"` casts no shadows",
        ),
        (
            "[shadows]\ntechnique = \"dome\"\n",
            "c.toml:2: `shadows.technique`: \"dome\" is now called \"image-based-shadowing\"",
        ),
        (
            "[sync]\nfollow_latency = \"tell\"\n",
            "c.toml:2: `sync.follow_latency`: \"tell\" is now called \"report\"",
        ),
    ] {
        let error = Config::from_text(text, "c.toml").unwrap_err();
        assert_eq!(error.to_string(), expected);
    }
}

/// A key of `rig.toml`, as the reference shows it.
fn key_of(line: &str) -> Option<(&str, String)> {
    let (line, active) = match line.strip_prefix("# ") {
        Some(rest) => (rest, false),
        None => (line, true),
    };
    let (key, value) = line
        .split_once(" = ")
        .filter(|(key, _)| !key.contains(' '))?;
    let default = if active {
        format!("`{value}`")
    } else {
        format!("none; e.g. `{value}`")
    };
    Some((key, default))
}

/// Longest comment that is repeated for a key that follows without a comment, characters.
const MAX_REPEATED: usize = 40;

/// Renders `rig.toml` as a page: a table for each section.
fn reference(toml: &str) -> String {
    let mut page = String::from("# Configuration\n\nGenerated from `config/rig.toml`.");
    let mut comment = Vec::new();
    let (mut key_before, mut meaning_before) = ("", String::new());
    let mut intro = true;
    for line in toml.lines() {
        if let Some((key, default)) = key_of(line) {
            let meaning = match (comment.is_empty(), meaning_before.len()) {
                (true, 0..=MAX_REPEATED) => meaning_before.clone(),
                (true, _) => format!("See `{key_before}`."),
                (false, _) => {
                    key_before = key;
                    meaning_before = comment.join(" ").replace('|', "\\|");
                    meaning_before.clone()
                }
            };
            page += &format!("| `{key}` | {default} | {meaning} |\n");
            comment.clear();
        } else if let Some(text) = line.strip_prefix("# ") {
            comment.push(text);
        } else if line.starts_with('[') {
            page += &format!("\n## `{line}`\n\n");
            if !comment.is_empty() {
                page += &format!("{}\n\n", comment.join("\n"));
            }
            page += "| Key | Default | Meaning |\n|---|---|---|\n";
            comment.clear();
            meaning_before.clear();
        } else if intro {
            page += &format!(" {}\n", comment.join("\n"));
            comment.clear();
            intro = false;
        }
    }
    page
}

/// `UPDATE_DOCS=1 cargo test -p penumbra-config reference_page` rewrites the page.
#[test]
fn reference_page_matches_rig_toml() {
    penumbra_test_data::check_page("docs/src/configuration.md", &reference(convert::DEFAULTS));
}

#[test]
fn former_words_of_the_command_line_have_a_message() {
    let word = |option, value| renamed_word(option, value).unwrap_or_default();
    assert_eq!(
        word("--lights", ""),
        "`--lights` is now called `--light-placement`"
    );
    assert_eq!(
        word("", "photometric"),
        "`photometric` is now called `radiometric`"
    );
    assert_eq!(renamed_word("--technique", "light"), None);
    assert_eq!(renamed_word("", "intrinsics"), None);
}

#[test]
fn effective_settings_are_the_defaults_and_the_changes() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rig.toml");
    let text = "[status]\ntoken = \"0123456789abcdef\"\n\n[scene_camera]\nbuffers = 7\n";
    std::fs::write(&file, text).unwrap();
    let all = check_config(&file).unwrap().effective;
    assert_eq!(all["scene_camera"]["buffers"].as_integer(), Some(7));
    assert_eq!(all["scene_camera"]["device"].as_str(), Some("auto"));
    assert_eq!(all["status"]["token"].as_str(), Some("(set)"));
    // It is a configuration again.
    let token = all.to_string().replace("(set)", "0123456789abcdef");
    std::fs::write(&file, token).unwrap();
    assert_eq!(check_config(&file).unwrap().effective, all);
}
