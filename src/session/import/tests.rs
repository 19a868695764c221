//! Valid and faulty folders, and the recordings with ground truth if available.
use super::*;
use crate::{Session, SessionEvent, describe};
use penumbra_sync::{Pairing, PairingConfig, Provenance};
use penumbra_tracker_serial::fastrak::{Decoder, Format};
use std::path::Path;
use tempfile::TempDir;

/// A rig's folder of two scene frames, one bracketed environment frame and three tracker
/// records; `capture_ns` and `measured_ns` are ground truth and must not be used.
fn rig_folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    };
    put(
        "rig.json",
        br#"{"scene_camera":{"image_size":[4,2],"K":[[5,0,2],[0,5,1],[0,0,1]]}}"#,
    );
    put("scene/00000.jpg", b"scene 0");
    put("scene/00001.jpg", b"scene 1");
    put("env/00000.jpg", b"env 0");
    put("env/00000_ev-4.jpg", b"env 0 dark");
    put("env/00000_ev-8.jpg", b"env 0 darker");
    put(
        "scene_timestamps.csv",
        b"frame,file,timestamp_ns,capture_ns\n0,scene/00000.jpg,100,1\n1,scene/00001.jpg,200,2\n",
    );
    put(
        "env_timestamps.csv",
        b"file,capture_ns,timestamp_ns,frame\nenv/00000.jpg,3,150,0\n",
    );
    let record = b"01    1.00   2.00   3.00   0.00   0.00   0.00\r\n";
    put("tracker_fastrak.txt", &record.repeat(3));
    put(
        "tracker_fastrak_index.csv",
        b"record,byte_offset,arrival_ns,measured_ns\n0,0,90,7\n1,47,160,8\n2,94,170,9\n",
    );
    put("object/object.glb", b"glb");
    put("object/textures/wood.png", b"png");
    put("phantoms/box.ply", b"ply");
    put("calibration/scene_chart.png", b"chart");
    for judged in [
        "truth/with_00000.png",
        "masks/00000.png",
        "truth_rig.json",
        "camera_truth.csv",
    ] {
        put(judged, b"TRUTH");
    }
    folder
}

fn args(folder: &Path) -> ImportArgs {
    ImportArgs {
        folder: folder.to_owned(),
        output: folder.join("out.mcap"),
        force: false,
    }
}

fn faulty(change: impl FnOnce(&Path)) -> String {
    let folder = rig_folder();
    change(folder.path());
    let error = import(&args(folder.path()), &mut |_| {})
        .unwrap_err()
        .to_string();
    assert!(!error.contains('\n'), "{error}");
    let left: Vec<_> = fs::read_dir(folder.path())
        .unwrap()
        .filter(|entry| {
            entry
                .as_ref()
                .unwrap()
                .path()
                .extension()
                .is_some_and(|e| e == "mcap")
        })
        .collect();
    assert!(left.is_empty(), "{left:?}");
    let partial = |entry: &fs::DirEntry| entry.file_name().to_string_lossy().contains("partial");
    let mut entries = fs::read_dir(folder.path()).unwrap().map(Result::unwrap);
    assert!(!entries.any(|entry| partial(&entry)));
    error
}

#[test]
fn imports_rig_folder() {
    let folder = rig_folder();
    let summary = import(&args(folder.path()), &mut |_| {}).unwrap();
    assert_eq!((summary.scene_frames, summary.environment_frames), (2, 3));
    assert_eq!((summary.tracker_chunks, summary.attachments), (3, 5));
    let session = Session::open(&folder.path().join("out.mcap")).unwrap();
    assert!(!session.truncated());
    let names: Vec<_> = session
        .attachments()
        .iter()
        .map(|a| a.name.as_str())
        .collect();
    let expected = [
        "rig.json",
        "calibration/scene_chart.png",
        "object/object.glb",
        "object/textures/wood.png",
        "phantoms/box.ply",
    ];
    assert_eq!(names, expected);
    let described: Vec<_> = session
        .events()
        .map(|event| text_of(&event.unwrap()))
        .collect();
    let expected = [
        "90 tracker 47",
        "100 scene 0 scene 0",
        "150 environment 0 ev0 env 0",
        "150 environment 0 ev-4 env 0 dark",
        "150 environment 0 ev-8 env 0 darker",
        "160 tracker 47",
        "170 tracker 47",
        "200 scene 1 scene 1",
    ];
    assert_eq!(described, expected);
    assert_eq!(session.tracker_protocol(), Some("fastrak"));
    assert!(describe(&session).contains("/scene_camera/calibration"));
}

fn text_of(event: &SessionEvent) -> String {
    let nanos = event.arrived_at().as_nanos();
    let text = |frame: &Frame| String::from_utf8(frame.data.to_vec()).unwrap();
    match event {
        SessionEvent::Scene(frame) => {
            assert_eq!(frame.captured_at, frame.arrived_at);
            format!("{nanos} scene {} {}", frame.sequence, text(frame))
        }
        SessionEvent::Environment(frame) => {
            let (sequence, ev) = (frame.sequence, frame.bracket_ev);
            format!("{nanos} environment {sequence} ev{ev} {}", text(frame))
        }
        SessionEvent::TrackerBytes { bytes, .. } => format!("{nanos} tracker {}", bytes.len()),
        SessionEvent::Pose(sample) => {
            let t = sample.transmitter_from_sensor.translation;
            format!("{nanos} pose {} {} {}", t.x, t.y, t.z)
        }
        SessionEvent::Tick(_) | SessionEvent::Prepared { .. } => {
            panic!("{event:?} in an import")
        }
    }
}

#[test]
fn does_not_import_ground_truth() {
    let folder = rig_folder();
    import(&args(folder.path()), &mut |_| {}).unwrap();
    let bytes = fs::read(folder.path().join("out.mcap")).unwrap();
    assert!(!bytes.windows(5).any(|window| window == b"TRUTH"));
}

#[test]
fn import_is_deterministic() {
    let folder = rig_folder();
    let mut args = args(folder.path());
    import(&args, &mut |_| {}).unwrap();
    let first = fs::read(&args.output).unwrap();
    args.force = true;
    import(&args, &mut |_| {}).unwrap();
    assert_eq!(first, fs::read(&args.output).unwrap());
}

#[test]
fn overwrites_only_with_force() {
    let folder = rig_folder();
    let mut args = args(folder.path());
    fs::write(&args.output, b"mine").unwrap();
    let error = import(&args, &mut |_| {}).unwrap_err();
    assert!(matches!(error, ImportError::Exists { .. }));
    assert_eq!(fs::read(&args.output).unwrap(), b"mine");
    args.force = true;
    import(&args, &mut |_| {}).unwrap();
    assert!(Session::open(&args.output).is_ok());
    args.output = folder.path().join("object");
    assert!(matches!(
        import(&args, &mut |_| {}).unwrap_err(),
        ImportError::IsFolder { .. }
    ));
}

#[test]
fn rejects_faulty_folders_with_one_line_and_no_output() {
    let replace = |name: &'static str, text: &'static [u8]| {
        faulty(move |folder| fs::write(folder.join(name), text).unwrap())
    };
    let heading = b"frame,file,timestamp_ns\n";
    assert!(replace("scene_timestamps.csv", b"").contains("no column"));
    assert!(
        replace("scene_timestamps.csv", b"frame,file\n0,x.jpg\n")
            .contains("no column timestamp_ns")
    );
    let row = |row: &str| {
        let text = [heading, row.as_bytes()].concat();
        faulty(move |folder| fs::write(folder.join("scene_timestamps.csv"), text).unwrap())
    };
    assert!(
        row("0,scene/00000.jpg,12.5\n").contains("scene_timestamps.csv:2: \"12.5\" is no time")
    );
    assert!(row("").contains("lists no pictures"));
    assert!(row("0,scene/00000.jpg\n").contains("too few columns"));
    assert!(row("0,scene/9.jpg,5\n").contains("scene/9.jpg does not exist"));
    assert!(row("0,../secret.jpg,5\n").contains("leads out of the folder"));
    assert!(row("0,rig.json,5\n").contains("must end in .jpg or .png"));
    assert!(replace("rig.json", b"{").contains("rig.json: "));
    let index = b"record,byte_offset,arrival_ns\n0,0,90\n1,999,160\n";
    assert!(replace("tracker_fastrak_index.csv", index).contains("csv:3: byte offset 999"));
    let unindexed =
        |folder: &Path| fs::remove_file(folder.join("tracker_fastrak_index.csv")).unwrap();
    assert!(faulty(unindexed).contains("tracker_fastrak_index.csv: "));
    let unknown = |folder: &Path| fs::remove_file(folder.join("scene_timestamps.csv")).unwrap();
    assert!(faulty(unknown).contains("neither scene_timestamps.csv"));
    let missing = args(Path::new("/nowhere/at/all"));
    assert!(
        import(&missing, &mut |_| {})
            .unwrap_err()
            .to_string()
            .contains("no such folder")
    );
}

#[test]
#[cfg(unix)]
fn rejects_links_outside_the_folder() {
    let outside = tempfile::tempdir().unwrap();
    fs::write(outside.path().join("secret"), b"s").unwrap();
    let error = faulty(|folder| {
        std::os::unix::fs::symlink(outside.path().join("secret"), folder.join("object/link"))
            .unwrap();
    });
    assert!(error.contains("leads out of the folder"), "{error}");
}

#[test]
fn imports_tum_folder() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("rgb")).unwrap();
    fs::write(folder.path().join("rgb/1.5.png"), b"first").unwrap();
    fs::write(folder.path().join("rgb/2.png"), b"second").unwrap();
    let rgb = "# color images\n# file\n1.5 rgb/1.5.png\n2.000000001 rgb/2.png\n";
    fs::write(folder.path().join("rgb.txt"), rgb).unwrap();
    let poses = "# timestamp tx ty tz qx qy qz qw\n1.4 1 2 3 0 0 0 1\n1.9 4 5 6 0.6 0 0 0.8\n";
    fs::write(folder.path().join("groundtruth.txt"), poses).unwrap();
    fs::write(folder.path().join("depth.txt"), "1.5 depth/none.png\n").unwrap();
    let args = args(folder.path());
    let summary = import(&args, &mut |_| {}).unwrap();
    assert_eq!((summary.scene_frames, summary.poses), (2, 2));
    let session = Session::open(&args.output).unwrap();
    let described: Vec<_> = session
        .events()
        .map(|event| text_of(&event.unwrap()))
        .collect();
    let expected = [
        "1400000000 pose 1 2 3",
        "1500000000 scene 0 first",
        "1900000000 pose 4 5 6",
        "2000000001 scene 1 second",
    ];
    assert_eq!(described, expected);
    fs::write(folder.path().join("groundtruth.txt"), "1.4 1 2 3 0 0 0 7\n").unwrap();
    let forced = ImportArgs {
        force: true,
        ..args
    };
    assert!(
        import(&forced, &mut |_| {})
            .unwrap_err()
            .to_string()
            .contains("groundtruth.txt:1: ")
    );
}

#[test]
fn tum_folder_gets_the_lens_of_its_recordings_and_a_camera_that_is_its_own_tracker() {
    let folder = tempfile::tempdir().unwrap();
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    png.extend([640_u32, 480].iter().flat_map(|side| side.to_be_bytes()));
    let put = |name: &str, data: &[u8]| fs::write(folder.path().join(name), data).unwrap();
    put("1.png", &png);
    put("groundtruth.txt", b"1.4 1 2 3 0 0 0 1\n");
    let imported = || {
        let args = ImportArgs {
            force: true,
            ..args(folder.path())
        };
        let summary = import(&args, &mut |_| {}).unwrap();
        let session = Session::open(&args.output).unwrap();
        let rig = session.attachment("rig.json");
        let rig: Option<serde_json::Value> = rig.map(|r| serde_json::from_slice(r).unwrap());
        (summary.lens.unwrap(), rig)
    };
    let head = "# color images\n# file: 'rgbd_dataset_freiburg2_desk.bag'\n";
    put("rgb.txt", format!("{head}1.5 1.png\n").as_bytes());
    let (lens, rig) = imported();
    let sequence = "freiburg2";
    assert_eq!(lens, Lens::Published { sequence });
    let rig = rig.unwrap();
    assert_eq!(rig["scene_camera"]["K"][0][0], 520.908_62);
    assert_eq!(rig["tracker"]["T_sensor_cam"]["matrix_row_major"][2][2], 1);
    put("rgb.txt", b"1.5 1.png\n");
    let sequence = "default";
    assert_eq!(imported().0, Lens::Published { sequence });
    // A stated lens stays, and gets the tracker that it lacks.
    put(
        "rig.json",
        br#"{"scene_camera":{"image_size":[640,480],"K":[[7,0,1],[0,7,1],[0,0,1]]}}"#,
    );
    let (lens, rig) = imported();
    assert_eq!(lens, Lens::Stated);
    let rig = rig.unwrap();
    assert_eq!(rig["scene_camera"]["K"][0][0], 7);
    assert!(rig["tracker"].is_object());
    fs::remove_file(folder.path().join("rig.json")).unwrap();
    put("1.png", b"no picture");
    assert_eq!(imported(), (Lens::Unknown, None));
}

/// All frames are imported, every FASTRAK record is decoded from the stored bytes, and every frame is
/// paired with a pose and a complete view of the environment.
#[test]
fn imports_recordings_with_ground_truth() {
    let Some(truth) = penumbra_test_data::shared("truth") else {
        return;
    };
    let outputs = tempfile::tempdir().unwrap();
    let recordings = [
        ("desk", 2),
        ("desk-sphere", 1),
        ("courtyard", 3),
        ("desk-marker", 1),
        ("desk-lamp", 2),
    ];
    for (name, brackets) in recordings {
        let folder = truth.join(name);
        let args = ImportArgs {
            folder: folder.clone(),
            output: outputs.path().join(format!("{name}.mcap")),
            force: false,
        };
        let summary = import(&args, &mut |_| {}).unwrap();
        let rows = |table: &str| {
            fs::read_to_string(folder.join(table))
                .unwrap()
                .lines()
                .count()
                - 1
        };
        assert_eq!(summary.scene_frames, rows("scene_timestamps.csv"), "{name}");
        let views = rows("env_timestamps.csv");
        assert_eq!(summary.environment_frames, views * (1 + brackets), "{name}");
        let session = Session::open(&args.output).unwrap();
        let records = rows("tracker_fastrak_index.csv");
        check_pairs(&session, brackets, records);
        println!("{}", describe(&session));
    }
}

fn check_pairs(session: &Session, brackets: usize, records: usize) {
    let config = PairingConfig {
        brackets,
        tracker_latency_nanos: 8_000_000,
        ..PairingConfig::default()
    };
    let mut pairing = Pairing::new(config.with_full_windows());
    let mut decoder =
        Decoder::new(Format::for_protocol(session.tracker_protocol().unwrap()).unwrap());
    let mut frames = 0;
    for event in session.events() {
        match event.unwrap() {
            SessionEvent::Scene(frame) => pairing.push_scene(frame),
            SessionEvent::Environment(frame) => pairing.push_environment(frame),
            SessionEvent::TrackerBytes {
                bytes, arrived_at, ..
            } => {
                decoder.push(&bytes, arrived_at, |sample| pairing.push_pose(&sample));
            }
            SessionEvent::Pose(sample) => pairing.push_pose(&sample),
            other => panic!("{other:?} in an import"),
        }
        for frame in std::iter::from_fn(|| pairing.pop()) {
            assert_eq!(frame.index, frame.scene.sequence);
            assert_eq!(frame.pose.unwrap().provenance, Provenance::Interpolated);
            let environment = frame.environment.unwrap();
            assert_eq!(environment.set.frames.len(), 1 + brackets);
            // 15 views per second, and the first one up to a frame late.
            assert!((-33_000_000..100_000_000).contains(&environment.skew_nanos));
            frames += 1;
        }
    }
    let counts = pairing.counts();
    assert_eq!(frames, counts.scene_frames, "none had to wait for the end");
    assert_eq!((counts.incomplete_sets, counts.orphan_brackets), (0, 0));
    assert_eq!((counts.rejected_poses, counts.poses), (0, records as u64));
    assert_eq!(decoder.counters().skipped_bytes, 0);
}
