#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
use super::*;
use crate::wall_date::civil;
use bytes::Bytes;
use penumbra_interface::{Frame, PixelFormat};
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
    };
    let recorder = Recorder::new(hub.clone(), Arc::default(), config, status.clone());
    (hub, status, recorder)
}

fn until(what: &str, holds: impl Fn() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn what_goes_through_the_hub_is_in_the_file_and_the_file_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), 0);
    let path = folder.path().join("a.mcap");
    hub.deliver(frame(1));
    recorder.start(&path, None).unwrap();
    assert!(matches!(
        recorder.start(&path, None),
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
    let refused = recorder.start(&path, None).unwrap_err().to_string();
    assert!(refused.contains("a.mcap"), "{refused}");
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

#[test]
fn status_tells_of_a_recording_as_soon_as_it_has_begun() {
    let folder = tempfile::tempdir().unwrap();
    let (_hub, status, recorder) = recorder(folder.path(), 0);
    for name in ["a.mcap", "b.mcap", "c.mcap"] {
        let path = folder.path().join(name);
        recorder.start(&path, None).unwrap();
        let recording = status.snapshot().recording;
        assert_eq!(recording.state, RecordingState::Recording);
        assert_eq!(recording.file, Some(path.display().to_string()));
        let ended = recorder.stop().unwrap();
        assert_eq!(ended.state, RecordingState::Finished);
    }
}

#[test]
fn a_recording_grows_on_the_disk_while_it_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), 0);
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None).unwrap();
    hub.deliver(frame(1));
    // Nothing is finished, and still it can be read: so it would be after a kill.
    until("the first frame is on the disk", || {
        Session::open(&path).is_ok_and(|s| s.events().count() == 1)
    });
    until("status tells the size", || {
        status.snapshot().recording.bytes > 1000
    });
    let recording = status.snapshot().recording;
    assert_eq!(recording.state, RecordingState::Recording);
    assert!(recording.free_bytes.is_some());
}

#[test]
fn the_reserve_ends_a_recording_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), u64::MAX);
    let path = folder.path().join("a.mcap");
    recorder.start(&path, None).unwrap();
    hub.deliver(frame(1));
    until("it ends", || !recorder.is_recording());
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
fn a_full_disk_ends_the_recording_with_a_clear_state() {
    let (hub, status, recorder) = recorder(Path::new("/nowhere"), 0);
    let writer = SessionWriter::new(
        BufWriter::new(File::options().write(true).open("/dev/full").unwrap()),
        Path::new("/dev/full"),
    );
    // The very first bytes do not fit into the buffer's place on the disk at a flush.
    let (events, waiting) = bounded(10);
    let job = Job {
        writer: writer.unwrap(),
        waiting,
        waiting_bytes: Arc::default(),
        dropped: Arc::default(),
        hub: hub.clone(),
        files: Arc::default(),
        status: status.clone(),
        stop: Arc::default(),
        path: PathBuf::from("/dev/full"),
        reserve_bytes: 0,
        longest: None,
        began: SystemClock.now(),
        flushed: SystemClock.now(),
        recording: Recording::default(),
    };
    hub.set_recorder(Some(RecorderQueue::new(
        events,
        job.waiting_bytes.clone(),
        Arc::default(),
    )));
    hub.deliver(frame(1));
    let recording = job.run();
    assert_eq!(recording.state, RecordingState::Failed);
    let sentence = recording.description;
    assert!(
        sentence.contains("No space left") && sentence.contains("free space"),
        "{sentence}"
    );
    // The hub has let go of it.
    hub.deliver(frame(2));
    drop(recorder);
}

#[test]
fn a_length_ends_it_and_the_dashboard_chooses_names_within_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (hub, status, recorder) = recorder(folder.path(), 0);
    let wish = |json: &str| RecordingRequest::from_json(json.as_bytes()).unwrap();
    let begun = recorder
        .carry_out(&wish(r#"{"record": true, "seconds": 1}"#))
        .unwrap();
    let file = PathBuf::from(begun.file.unwrap());
    assert_eq!(file.parent().unwrap(), folder.path().join("recordings"));
    hub.deliver(frame(1));
    let busy = recorder
        .carry_out(&wish(r#"{"record": true}"#))
        .unwrap_err();
    assert!(matches!(busy, RecordingRefusal::Busy { .. }), "{busy}");
    until("it ends by itself", || !recorder.is_recording());
    assert_eq!(status.snapshot().recording.state, RecordingState::Finished);
    let named = wish(r#"{"record": true, "file": "b.mcap"}"#);
    recorder.carry_out(&named).unwrap();
    let ended = recorder.carry_out(&wish(r#"{"record": false}"#)).unwrap();
    assert_eq!(ended.state, RecordingState::Finished);
    let again = recorder.carry_out(&named).unwrap_err();
    assert!(again.to_string().contains("b.mcap"), "{again}");
}

#[test]
fn dates_are_those_of_the_calendar() {
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
fn time_left_is_by_the_disk_or_by_the_length() {
    let recording = Recording {
        bytes: 1000,
        seconds: 10.0,
        free_bytes: Some(5000),
        ..Recording::default()
    };
    assert_eq!(seconds_left(&recording, 1000, None), Some(40.0));
    let longest = Some(Duration::from_secs(15));
    assert_eq!(seconds_left(&recording, 1000, longest), Some(5.0));
    assert_eq!(seconds_left(&recording, 9000, None), Some(0.0));
}
