//! The recorder with its thread and its file: what is offered is written or counted, in order; the
//! end writes all that was accepted; a disk that hangs delays no device; recordings follow each
//! other.

use crate::{assert_ascending, check, device, environment, numbers_of, reading, scene, small};
use penumbra_capture::Hub;
use penumbra_capture::sync::{Condvar, Mutex, threads};
use penumbra_config::RecordingConfig;
use penumbra_interface::SystemClock;
use penumbra_rig::recorder::{RecordingFile, WrapFile};
use penumbra_rig::source::RigFiles;
use penumbra_rig::{Composites, Recorder, RecordingContents, RigError};
use penumbra_session::{Session, SessionError, SessionEvent};
use penumbra_status::recording::{Recording, RecordingControl, RecordingRequest, RecordingState};
use penumbra_status::{Settings, SharedStatus};
use shuttle::thread::yield_now;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tempfile::TempDir;

/// A recorder and what it is connected with.
pub struct Bench {
    folder: TempDir,
    pub hub: Arc<Hub>,
    pub composites: Arc<Composites>,
    pub recorder: Arc<Recorder>,
    status: Arc<SharedStatus>,
}

impl Bench {
    pub fn new() -> Self {
        Self::on_disk(Arc::default(), Box::new(|file| Box::new(file)))
    }

    fn on_disk(files: Arc<RigFiles>, wrap: WrapFile) -> Self {
        // In memory, because every schedule writes files.
        let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir());
        let folder = folder.unwrap();
        let hub = Hub::new(Arc::new(SystemClock), false);
        let status = SharedStatus::new(Settings::default());
        let composites = Arc::<Composites>::default();
        let config = RecordingConfig {
            folder: folder.path().to_owned(),
            reserve_bytes: 0,
            ..RecordingConfig::default()
        };
        let contents = RecordingContents {
            files,
            composites: Arc::clone(&composites),
            ..RecordingContents::default()
        };
        let recorder = Recorder::on_disk(hub.clone(), contents, config, status.clone(), wrap);
        Self {
            folder,
            hub,
            composites,
            recorder,
            status,
        }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn recorded(&self, name: &str) -> Vec<SessionEvent> {
        let session = match Session::open(&self.path(name)) {
            // Without a picture of the scene camera it is no session of a rig.
            Err(SessionError::Foreign { .. }) => return Vec::new(),
            session => session.unwrap(),
        };
        assert!(!session.truncated());
        session.events().map(Result::unwrap).collect()
    }
}

/// Checks a finished recording and returns the number of events offered to it.
fn offered(bench: &Bench, name: &str, recording: &Recording) -> usize {
    assert_eq!(
        recording.state,
        RecordingState::Finished,
        "{}",
        recording.description
    );
    let recorded = bench.recorded(name);
    assert_eq!(recorded.len() as u64, recording.events);
    for event in [scene as fn(i64) -> _, environment, reading] {
        assert_ascending(&numbers_of(&recorded, event));
    }
    recorded.len() + recording.dropped as usize
}

#[test]
fn every_event_is_written_or_counted() {
    check(|| {
        let bench = Bench::new();
        bench
            .recorder
            .start(&bench.path("a.mcap"), None, false)
            .unwrap();
        // It is accepted, so that the file can be read as a session.
        bench.hub.deliver(small(0));
        let devices = [
            device(&bench.hub, 1..=4, environment),
            device(&bench.hub, 1..=4, reading),
        ];
        devices.into_iter().for_each(|d| d.join().unwrap());
        let recording = bench.recorder.stop().unwrap();
        assert_eq!(offered(&bench, "a.mcap", &recording), 9);
        assert_eq!(bench.status.snapshot().recording, recording);
    });
}

#[test]
fn stopping_writes_what_was_accepted_before() {
    check(|| {
        let bench = Bench::new();
        bench
            .recorder
            .start(&bench.path("a.mcap"), None, false)
            .unwrap();
        let delivered = Arc::<AtomicUsize>::default();
        let device = {
            let (hub, delivered) = (Arc::clone(&bench.hub), Arc::clone(&delivered));
            let deliver = move || {
                for n in 1..=3 {
                    hub.deliver(small(n));
                    delivered.fetch_add(1, Ordering::Relaxed);
                }
            };
            threads::spawn("device", deliver).unwrap()
        };
        let before = delivered.load(Ordering::Relaxed);
        let recording = bench.recorder.stop().unwrap();
        device.join().unwrap();
        let offered = offered(&bench, "a.mcap", &recording);
        assert!((before..=3).contains(&offered), "{before}: {offered}");
        assert_eq!(recording.dropped, 0, "the queue holds four");
    });
}

/// A disk that hangs until it is released.
#[derive(Clone, Default)]
struct HangingDisk(Arc<(Mutex<bool>, Condvar)>);

impl HangingDisk {
    fn release(&self) {
        *self.0.0.lock().unwrap() = true;
        self.0.1.notify_all();
    }
}

struct HangingFile(File, HangingDisk);

impl Write for HangingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let (is_released, released) = &*self.1.0;
        let mut is_released = is_released.lock().unwrap();
        while !*is_released {
            is_released = released
                .wait_timeout(is_released, crate::FOREVER)
                .unwrap()
                .0;
        }
        drop(is_released);
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl Seek for HangingFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.seek(to)
    }
}

/// Only when all deliveries have returned does the disk go on.
#[test]
fn full_queue_delays_no_device() {
    // A file of the rig that does not fit into the writer's buffer: the disk is needed at once.
    let rig_json = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(rig_json.path(), [b' '; 100_000]).unwrap();
    let files = Arc::new(RigFiles::from_rig_json(rig_json.path()).unwrap());
    check(move || {
        let disk = HangingDisk::default();
        let hanging = disk.clone();
        let wrap =
            move |file| Box::new(HangingFile(file, hanging.clone())) as Box<dyn RecordingFile>;
        let bench = Bench::on_disk(Arc::clone(&files), Box::new(wrap));
        bench
            .recorder
            .start(&bench.path("a.mcap"), None, false)
            .unwrap();
        bench.hub.deliver(small(0));
        let devices = [
            device(&bench.hub, 1..=3, environment),
            device(&bench.hub, 1..=5, reading),
        ];
        devices.into_iter().for_each(|d| d.join().unwrap());
        disk.release();
        let recording = bench.recorder.stop().unwrap();
        assert_eq!(offered(&bench, "a.mcap", &recording), 9);
        // The queue holds four events.
        assert_eq!((recording.events, recording.dropped), (4, 5));
    });
}

/// The first recording ends by itself; the second one starts as soon as it may.
#[test]
fn end_of_a_recording_takes_nothing_from_the_next_one() {
    check(|| {
        let bench = Bench::new();
        let first = device(&bench.hub, 1..=2, small);
        let path = bench.path("a.mcap");
        bench
            .recorder
            .start(&path, Some(Duration::ZERO), false)
            .unwrap();
        while let Err(error) = bench.recorder.start(&bench.path("b.mcap"), None, false) {
            assert!(matches!(error, RigError::Recording { .. }), "{error}");
            yield_now();
        }
        first.join().unwrap();
        let second = device(&bench.hub, 3..=5, small);
        second.join().unwrap();
        let recording = bench.recorder.stop().unwrap();
        offered(&bench, "b.mcap", &recording);
        let recorded = numbers_of(&bench.recorded("b.mcap"), small);
        assert!(
            recorded.ends_with(&[3, 4, 5]) || recording.dropped > 0,
            "{recorded:?}"
        );
    });
}

/// Two users of the page, and the rig that ends meanwhile.
#[test]
fn requests_at_the_same_time_neither_hang_nor_mix_recordings() {
    check(|| {
        let bench = Bench::new();
        let device = device(&bench.hub, 1..=2, small);
        let users = ["a.mcap", "b.mcap"].map(|name| {
            let recorder = Arc::clone(&bench.recorder);
            let request = |json: String| RecordingRequest::from_json(json.as_bytes()).unwrap();
            let start = request(format!(r#"{{"record": true, "file": "{name}"}}"#));
            let stop = request(r#"{"record": false}"#.to_owned());
            let ask = move || {
                // Busy is an answer, too.
                let is_started = recorder.carry_out(&start).is_ok();
                recorder.carry_out(&stop).unwrap();
                is_started
            };
            (name, threads::spawn("user", ask).unwrap())
        });
        device.join().unwrap();
        let mut started = 0;
        for (name, user) in users {
            if user.join().unwrap() {
                assert_ascending(&numbers_of(&bench.recorded(name), small));
                started += 1;
            }
        }
        assert!(started > 0);
        assert!(!bench.recorder.is_recording());
    });
}
