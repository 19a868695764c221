use super::*;
use crate::composites::Composites;
use crate::source::RigFiles;
use crate::wall_date::civil;
use bytes::Bytes;
use penumbra_camera::PinholeCamera;
use penumbra_faulty::FaultyDisk;
use penumbra_interface::{Frame, PixelFormat};
use penumbra_rig_model::lens_files::SCENE_LENS;
use penumbra_rig_model::lens_record::LensRecord;
use penumbra_session::Session;
use penumbra_status::Settings;
use std::time::Instant;

fn frame(sequence: u64) -> SessionEvent {
    let at = SystemClock.now();
    SessionEvent::Scene(Frame {
        data: Bytes::from(vec![7; 1000]),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence,
        captured_at: at,
        arrived_at: at,
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    })
}

fn recorder(folder: &Path, reserve_bytes: u64) -> (Arc<Hub>, Arc<SharedStatus>, Arc<Recorder>) {
    let hub = Hub::new(Arc::new(SystemClock), false);
    let status = SharedStatus::new(Settings::default());
    let config = RecordingConfig {
        folder: folder.join("recordings"),
        max_duration_nanos: None,
        reserve_bytes,
        composite: false,
    };
    let recorder = Recorder::new(
        hub.clone(),
        RecordingContents::default(),
        config,
        status.clone(),
    );
    (hub, status, recorder)
}

/// As [`recorder`], with what the frame loop hands pictures to.
fn recorder_of_composites(
    folder: &Path,
) -> (Arc<Hub>, Arc<Composites>, Arc<SharedStatus>, Arc<Recorder>) {
    let hub = Hub::new(Arc::new(SystemClock), false);
    let status = SharedStatus::new(Settings::default());
    let composites = Arc::<Composites>::default();
    let contents = RecordingContents {
        composites: composites.clone(),
        ..RecordingContents::default()
    };
    let config = RecordingConfig {
        folder: folder.join("recordings"),
        reserve_bytes: 0,
        ..RecordingConfig::default()
    };
    let recorder = Recorder::new(hub.clone(), contents, config, status.clone());
    (hub, composites, status, recorder)
}

#[test]
fn composited_pictures_are_recorded_on_request_and_not_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, composites, status, recorder) = recorder_of_composites(folder.path());
    assert!(!status.snapshot().recording.composite && !composites.wanted());
    let picture = Arc::new(penumbra_picture::Picture {
        width: 64,
        height: 48,
        rgba: vec![100; 64 * 48 * 4],
    });
    composites.offer(&picture, SystemClock.now());
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None, true).unwrap();
    assert!(status.snapshot().recording.composite && composites.wanted());
    for n in 1..4 {
        hub.deliver(frame(n));
        composites.offer(&picture, SystemClock.now());
        // Encoder and writer are given time, so that nothing is dropped.
        std::thread::sleep(Duration::from_millis(200));
    }
    let recording = recorder.stop().unwrap();
    assert_eq!((recording.composites, recording.composites_dropped), (3, 0));
    assert_eq!((recording.events, recording.dropped), (3, 0));
    assert!(!composites.wanted());
    let session = Session::open(&path).unwrap();
    assert!(!session.truncated());
    assert_eq!(session.events().filter(Result::is_ok).count(), 3);
}

#[test]
fn composited_pictures_beyond_the_queue_are_dropped_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let (_hub, composites, _status, recorder) = recorder_of_composites(folder.path());
    let large = Arc::new(penumbra_picture::Picture {
        width: 2000,
        height: 1000,
        rgba: vec![100; 2000 * 1000 * 4],
    });
    recorder
        .start(&folder.path().join("a.mcap"), None, true)
        .unwrap();
    let begun = Instant::now();
    (0..100).for_each(|_| composites.offer(&large, SystemClock.now()));
    assert!(
        begun.elapsed() < Duration::from_millis(500),
        "it does not wait"
    );
    let recording = recorder.stop().unwrap();
    assert!(recording.composites > 0 && recording.composites_dropped > 0);
    assert_eq!(recording.composites + recording.composites_dropped, 100);
}

fn wait_until(what: &str, is_true: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_true() {
        assert!(start.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn records_all_events_of_the_hub_and_never_overwrites_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), 0);
    let path = folder.path().join("a.mcap");
    hub.deliver(frame(1));
    recorder.start(&path, None, false).unwrap();
    assert!(matches!(
        recorder.start(&path, None, false),
        Err(RigError::Recording { .. })
    ));
    (2..52).for_each(|n| hub.deliver(frame(n)));
    let recording = recorder.stop().unwrap();
    assert_eq!(recording.state, RecordingState::Finished);
    assert_eq!((recording.events, recording.dropped), (50, 0));
    assert_eq!(recording.bytes, std::fs::metadata(&path).unwrap().len());
    assert_eq!(status.snapshot().recording, recording);
    hub.deliver(frame(99));
    let session = Session::open(&path).unwrap();
    assert!(!session.truncated());
    let numbers = session.events().map(|e| match e.unwrap() {
        SessionEvent::Scene(frame) => frame.sequence,
        other => panic!("{other:?}"),
    });
    assert!(numbers.eq(2..52));
    let before = std::fs::read(&path).unwrap();
    let refused = recorder.start(&path, None, false).unwrap_err().to_string();
    assert!(refused.contains("a.mcap"), "{refused}");
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

#[test]
fn status_shows_a_recording_as_soon_as_it_has_started() {
    let folder = tempfile::tempdir().unwrap();
    let (_hub, status, recorder) = recorder(folder.path(), 0);
    for name in ["a.mcap", "b.mcap", "c.mcap"] {
        let path = folder.path().join(name);
        recorder.start(&path, None, false).unwrap();
        let recording = status.snapshot().recording;
        assert_eq!(recording.state, RecordingState::Recording);
        assert_eq!(recording.file, Some(path.display().to_string()));
        let ended = recorder.stop().unwrap();
        assert_eq!(ended.state, RecordingState::Finished);
    }
}

#[test]
fn running_recording_is_readable_on_disk() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), 0);
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None, false).unwrap();
    hub.deliver(frame(1));
    // The unfinished file can be read, as it could after the recorder was killed.
    wait_until("the first frame is on the disk", || {
        Session::open(&path).is_ok_and(|s| s.events().count() == 1)
    });
    wait_until("status shows the size", || {
        status.snapshot().recording.bytes > 1000
    });
    let recording = status.snapshot().recording;
    assert_eq!(recording.state, RecordingState::Recording);
    assert!(recording.free_bytes.is_some());
}

#[test]
fn low_disk_space_ends_a_recording_with_a_complete_file() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), u64::MAX);
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None, false).unwrap();
    hub.deliver(frame(1));
    wait_until("the recording ends", || !recorder.is_recording());
    let recording = status.snapshot().recording;
    assert_eq!(recording.state, RecordingState::Failed);
    assert!(
        recording.description.contains("reserve_mb"),
        "{}",
        recording.description
    );
    let session = Session::open(&path).unwrap();
    assert!(!session.truncated() && session.events().count() == 1);
    hub.deliver(frame(2));
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_ends_the_recording_as_failed() {
    let (hub, status, recorder) = recorder(Path::new("/nowhere"), 0);
    let full = File::options().write(true).open("/dev/full").unwrap();
    let writer = SessionWriter::new(
        BufWriter::new(Box::new(full) as Box<dyn RecordingFile>),
        Path::new("/dev/full"),
    );
    // The first flush of the buffer fails.
    let (events, queue) = bounded(10);
    let job = Job {
        writer: writer.unwrap(),
        queue,
        composites: None,
        queued_bytes: Arc::default(),
        dropped: Arc::default(),
        hub: hub.clone(),
        views: RigViews::new(penumbra_session::ViewedRig::default()),
        lens: None,
        contents: RecordingContents::default(),
        status: status.clone(),
        stop: Arc::default(),
        path: PathBuf::from("/dev/full"),
        reserve_bytes: 0,
        max_duration: None,
        started: SystemClock.now(),
        flushed: SystemClock.now(),
        slowest: Duration::ZERO,
        last_flush: Duration::ZERO,
        unflushed: 0,
        slowest_flush: Duration::ZERO,
        recording: Recording::default(),
    };
    hub.set_recorder(Some(RecorderQueue::new(
        events,
        job.queued_bytes.clone(),
        Arc::default(),
    )));
    hub.deliver(frame(1));
    let recording = job.run();
    assert_eq!(recording.state, RecordingState::Failed);
    let description = recording.description;
    assert!(
        description.contains("No space left") && description.contains("free space"),
        "{description}"
    );
    // The hub no longer sends to the recorder.
    hub.deliver(frame(2));
    drop(recorder);
}

/// Events wait in the queue; the description of the recording says why.
#[test]
fn slow_disk_is_named_and_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let disk = FaultyDisk::default();
    let (hub, status, recorder) = recorder_on(&disk, folder.path());
    recorder
        .start(&folder.path().join("a.mcap"), None, false)
        .unwrap();
    disk.set_delay(Duration::from_millis(300));
    (0..20).for_each(|n| hub.deliver(frame(n)));
    wait_until("the disk is named", || {
        let recording = status.snapshot().recording;
        recording.description.contains("the disk is slow")
    });
    disk.set_delay(Duration::ZERO);
    let recording = recorder.stop().unwrap();
    assert_eq!((recording.events, recording.dropped), (20, 0));
}

/// Otherwise the queue grows, and a power cut loses all that waits in it.
#[test]
fn a_disk_with_long_flushes_is_not_flushed_after_each_event() {
    let folder = tempfile::tempdir().unwrap();
    let disk = FaultyDisk::default();
    let (hub, status, recorder) = recorder_on(&disk, folder.path());
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None, false).unwrap();
    // Longer than the time between flushes.
    disk.set_flush_delay(Duration::from_millis(300));
    let wait_for = |events| {
        wait_until("all events are written", || {
            status.snapshot().recording.events == events
        });
    };
    hub.deliver(frame(0));
    wait_for(1);
    (1..200).for_each(|n| hub.deliver(frame(n)));
    wait_for(200);
}

/// A power cut loses the time of two flushes; not also the time between them.
#[test]
fn a_disk_with_long_flushes_is_flushed_again_without_a_pause() {
    let folder = tempfile::tempdir().unwrap();
    let disk = FaultyDisk::default();
    let (hub, _, recorder) = recorder_on(&disk, folder.path());
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None, false).unwrap();
    disk.set_flush_delay(Duration::from_millis(450));
    let (mut known, mut ends) = (0, Vec::new());
    for n in 0..400 {
        hub.deliver(frame(n));
        std::thread::sleep(Duration::from_millis(10));
        let flushed = disk.flushed_bytes();
        if flushed != known {
            known = flushed;
            ends.push(SystemClock.now());
        }
    }
    let gaps = ends.windows(2).map(|pair| pair[1].seconds_since(pair[0]));
    // The shortest one: the processors may be busy with other tests.
    let shortest = gaps.fold(f64::INFINITY, f64::min);
    assert!((0.4..0.6).contains(&shortest), "{shortest}");
}

/// Records onto a disk whose faults can be switched.
fn recorder_on(disk: &FaultyDisk, folder: &Path) -> (Arc<Hub>, Arc<SharedStatus>, Arc<Recorder>) {
    let hub = Hub::new(Arc::new(SystemClock), false);
    let status = SharedStatus::new(Settings::default());
    let config = RecordingConfig {
        folder: folder.to_owned(),
        reserve_bytes: 0,
        ..RecordingConfig::default()
    };
    let faulty = disk.clone();
    let wrap: WrapFile = Box::new(move |file| Box::new(faulty.file(SyncedFile::new(file))));
    let contents = RecordingContents::default();
    let recorder = Recorder::on_disk(hub.clone(), contents, config, status.clone(), wrap);
    (hub, status, recorder)
}

/// What a power cut would leave: the file up to its last flush. The complete test is
/// `make power-cut`.
#[test]
fn recording_is_on_the_disk_but_for_its_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let disk = FaultyDisk::default();
    let (hub, _, recorder) = recorder_on(&disk, folder.path());
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None, false).unwrap();
    let begun = SystemClock.now();
    let mut losses = Vec::new();
    for n in 0..300 {
        hub.deliver(frame(n));
        std::thread::sleep(Duration::from_millis(10));
        if n % 19 == 0 && n > 120 {
            let left = folder.path().join("left.mcap");
            let flushed = disk.flushed_bytes() as usize;
            let bytes = std::fs::read(&path).unwrap();
            std::fs::write(&left, &bytes[..flushed]).unwrap();
            let now = SystemClock.now();
            let session = Session::open(&left).unwrap();
            let last = session.events().filter_map(Result::ok).last();
            let last = last.map_or(begun, |event| event.arrived_at());
            losses.push(now.seconds_since(last));
        }
    }
    losses.sort_by(f64::total_cmp);
    // The processors may be busy with other tests for a moment.
    assert!(losses[losses.len() / 2] < 1.0, "{losses:?}");
    assert!(losses[losses.len() - 1] < 3.0, "{losses:?}");
}

#[test]
fn requests_set_duration_and_file_name_of_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), 0);
    let request = |json: &str| RecordingRequest::from_json(json.as_bytes()).unwrap();
    let started = recorder
        .carry_out(&request(r#"{"record": true, "seconds": 1}"#))
        .unwrap();
    let file = PathBuf::from(started.file.unwrap());
    assert_eq!(file.parent().unwrap(), folder.path().join("recordings"));
    hub.deliver(frame(1));
    let busy = recorder
        .carry_out(&request(r#"{"record": true}"#))
        .unwrap_err();
    assert!(matches!(busy, RecordingRefusal::Busy { .. }), "{busy}");
    wait_until("the recording ends at its duration", || {
        !recorder.is_recording()
    });
    assert_eq!(status.snapshot().recording.state, RecordingState::Finished);
    let named = request(r#"{"record": true, "file": "b.mcap"}"#);
    recorder.carry_out(&named).unwrap();
    let ended = recorder
        .carry_out(&request(r#"{"record": false}"#))
        .unwrap();
    assert_eq!(ended.state, RecordingState::Finished);
    let again = recorder.carry_out(&named).unwrap_err();
    assert!(again.to_string().contains("b.mcap"), "{again}");
}

#[test]
fn converts_day_numbers_to_calendar_dates() {
    for (day, date) in [
        (0, (1970, 1, 1)),
        (59, (1970, 3, 1)),
        (11_016, (2000, 2, 29)),
        (11_017, (2000, 3, 1)),
        (20_778, (2026, 11, 21)),
        (47_541, (2100, 3, 1)),
    ] {
        assert_eq!(civil(day), date);
    }
    assert!(name_by_date().starts_with("penumbra-20"));
}

#[test]
fn seconds_left_is_limited_by_free_space_and_duration() {
    let recording = Recording {
        bytes: 1000,
        seconds: 10.0,
        free_bytes: Some(5000),
        ..Recording::default()
    };
    assert_eq!(seconds_left(&recording, 1000, None), Some(40.0));
    let max_duration = Some(Duration::from_secs(15));
    assert_eq!(seconds_left(&recording, 1000, max_duration), Some(5.0));
    assert_eq!(seconds_left(&recording, 9000, None), Some(0.0));
    // Without a camera hardly anything arrives: no 126 years.
    let empty = Recording {
        bytes: 400,
        seconds: 20.0,
        free_bytes: Some(80_000_000_000),
        ..Recording::default()
    };
    assert_eq!(seconds_left(&empty, 1000, None), None);
    assert_eq!(seconds_left(&empty, 1000, max_duration), Some(0.0));
}

/// Messages of a file: topic and time, in its order.
fn messages(path: &Path) -> Vec<(String, u64)> {
    let bytes = std::fs::read(path).unwrap();
    let stream = mcap::MessageStream::new(&bytes).unwrap();
    let messages = stream.map(|message| {
        let message = message.unwrap();
        (message.channel.topic.clone(), message.log_time)
    });
    messages.collect()
}

fn lens(focal: f64) -> PinholeCamera {
    PinholeCamera {
        width: 64,
        height: 48,
        focal: glam::DVec2::splat(focal),
        centre: glam::DVec2::new(31.5, 23.5),
        distortion: [0.1, 0.0, 0.0, 0.0, 0.0],
    }
}

/// A lens that was refined, and its file.
fn found(camera: PinholeCamera) -> FoundLens {
    let lens = penumbra_camera::Lens::from(&camera);
    let record = LensRecord::from_lens(&lens, "scene", String::new());
    let file = serde_json::to_string(&record).unwrap();
    FoundLens { camera, file }
}

/// A rig whose lens was assumed at its start.
fn viewed() -> Arc<penumbra_session::ViewedRig> {
    Arc::new(penumbra_session::ViewedRig {
        lenses: vec![pinhole(Camera::Scene, &lens(50.0))],
        ..Default::default()
    })
}

fn recorder_of(contents: RecordingContents) -> (Arc<Hub>, Arc<SharedStatus>, Arc<Recorder>) {
    let hub = Hub::new(Arc::new(SystemClock), false);
    let status = SharedStatus::new(Settings::default());
    let config = RecordingConfig {
        reserve_bytes: 0,
        ..RecordingConfig::default()
    };
    let recorder = Recorder::new(hub.clone(), contents, config, status.clone());
    (hub, status, recorder)
}

/// Its replay would otherwise use the lens of the rig's start.
#[test]
fn recording_holds_the_calibration_of_a_lens_that_was_refined_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let old = folder.path().join("rig");
    std::fs::create_dir_all(old.join("calibration")).unwrap();
    std::fs::write(old.join("rig.json"), "{}").unwrap();
    std::fs::write(old.join(SCENE_LENS), found(lens(50.0)).file).unwrap();
    let contents = RecordingContents {
        files: Arc::new(RigFiles::at(&old).unwrap()),
        viewed: viewed(),
        ..RecordingContents::default()
    };
    let refined = Arc::clone(&contents.refined_lens);
    let (hub, _, recorder) = recorder_of(contents);
    let record = |name: &str| {
        let path = folder.path().join(name);
        recorder.start(&path, None, false).unwrap();
        hub.deliver(frame(1));
        recorder.stop().unwrap();
        path
    };
    let focal = |path: &Path| {
        let session = Session::open(path).unwrap();
        let files = session.attachments().iter();
        let lenses: Vec<_> = files.filter(|file| file.name == SCENE_LENS).collect();
        assert_eq!(lenses.len(), 1);
        assert!(session.attachment("rig.json").is_some());
        LensRecord::parse(SCENE_LENS, &lenses[0].data)
            .unwrap()
            .focal
    };
    assert_eq!(focal(&record("a.mcap")), [50.0; 2]);
    refined.set(found(lens(55.0)));
    let after = record("b.mcap");
    assert_eq!(focal(&after), [55.0; 2]);
    let messages = messages(&after);
    let told = messages
        .iter()
        .filter(|(topic, _)| topic == "/scene_camera/calibration");
    assert_eq!(told.count(), 1, "viewers are told the newest lens alone");
}

#[test]
fn viewers_get_poses_and_a_lens_that_changes_while_it_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let contents = RecordingContents {
        viewed: viewed(),
        ..RecordingContents::default()
    };
    let refined = Arc::clone(&contents.refined_lens);
    let (hub, status, recorder) = recorder_of(contents);
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None, false).unwrap();
    hub.deliver(frame(1));
    wait_until("the first lens is written", || {
        status.snapshot().recording.events == 1
    });
    refined.set(found(lens(55.0)));
    hub.deliver(frame(2));
    let record = b"01   10.00  20.00  30.00   0.00   0.00   0.00\r\n";
    hub.deliver(SessionEvent::TrackerBytes {
        protocol: "fastrak".into(),
        bytes: [&record[..], record].concat().into(),
        arrived_at: SystemClock.now(),
    });
    let recording = recorder.stop().unwrap();
    assert_eq!((recording.events, recording.dropped), (3, 0));
    let messages = messages(&path);
    let of = |topic: &str| {
        let times = messages.iter().filter(|(name, _)| name == topic);
        times.map(|(_, time)| *time).collect::<Vec<_>>()
    };
    let (pictures, lenses) = (of("/scene_camera/image"), of("/scene_camera/calibration"));
    assert_eq!(
        lenses, pictures,
        "each lens stands at the first picture after it"
    );
    assert_eq!(pictures.len(), 2);
    assert!(!of("/tf").is_empty());
}
