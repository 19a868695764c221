//! A complete live rig with injected faults: unplugged and silent devices, truncated and damaged
//! deliveries, a panic in a driver. Pictures continue, the status reports the reason, and a
//! returning device is used again within two seconds.
#![expect(clippy::unwrap_used, clippy::panic)]

use penumbra_capture::source::{Recordings, open_camera, open_tracker};
use penumbra_compositor::Gpu;
use penumbra_config::Config;
use penumbra_config::{CameraSource, TrackerSource};
use penumbra_faulty::{Fault, FaultyCamera, FaultyTracker, Plan};
use penumbra_interface::DeviceFactory;
use penumbra_interface::DeviceKind;
use penumbra_interface::threads;
use penumbra_interface::{Camera, DeviceError, Tracker};
use penumbra_rig::{Live, Report, RigError, RunOptions, Runner, Source, live_settings};
use penumbra_session::Camera as Stream;
use penumbra_status::SharedStatus;
use penumbra_status::Snapshot;
use penumbra_status::snapshot::{Device, DeviceState};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The faults of a device: one plan for each time that it is opened.
#[derive(Clone)]
struct FaultyDevice {
    name: &'static str,
    plans: Arc<Mutex<VecDeque<Plan>>>,
    /// How many more times it can be opened; after that it is not found.
    plugged_in: Arc<AtomicU32>,
}

impl FaultyDevice {
    /// After the last plan the device works like the recorded one inside.
    fn new(name: &'static str, openings: u32, plans: Vec<Plan>) -> Self {
        Self {
            name,
            plans: Arc::new(Mutex::new(plans.into())),
            plugged_in: Arc::new(AtomicU32::new(openings)),
        }
    }

    /// The plan for this opening.
    fn plan(&self) -> Result<Plan, DeviceError> {
        let one_less = |left: u32| left.checked_sub(1);
        let (set, fetch) = (Ordering::Relaxed, Ordering::Relaxed);
        let there = self.plugged_in.fetch_update(set, fetch, one_less);
        there.map_err(|_| DeviceError::NotFound {
            device: self.name.to_owned(),
        })?;
        Ok(self.plans.lock().unwrap().pop_front().unwrap_or_default())
    }

    fn plug_in(&self) {
        self.plugged_in.store(1, Ordering::Relaxed);
    }
}

fn session() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/sessions/desk.mcap")
}

fn camera(stream: Stream, recordings: &Recordings, faults: &FaultyDevice) -> CameraSource {
    let (recordings, faults) = (recordings.clone(), faults.clone());
    CameraSource::Custom(DeviceFactory::new(faults.name, move |clock| {
        let plan = faults.plan()?;
        let inner = open_camera(&CameraSource::Replay(session()), stream, &recordings, clock)?;
        Ok(Box::new(FaultyCamera::new(inner, plan)) as Box<dyn Camera>)
    }))
}

fn tracker(recordings: &Recordings, faults: &FaultyDevice) -> TrackerSource {
    let (recordings, faults) = (recordings.clone(), faults.clone());
    TrackerSource::Custom(DeviceFactory::new(faults.name, move |clock| {
        let plan = faults.plan()?;
        let inner = open_tracker(&TrackerSource::Replay(session()), &recordings, clock)?;
        Ok(Box::new(FaultyTracker::new(inner, plan)) as Box<dyn Tracker>)
    }))
}

/// A running rig; dropping it ends it.
struct Rig {
    status: Arc<SharedStatus>,
    shutdown: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<Report, RigError>>>,
}

impl Rig {
    fn start(scene: &FaultyDevice, environment: &FaultyDevice, poses: &FaultyDevice) -> Self {
        let recordings = Recordings::default();
        let mut config = Config::default();
        config.scene_camera.source = camera(Stream::Scene, &recordings, scene);
        config.environment_camera = Some(camera(Stream::Environment, &recordings, environment));
        config.tracker = Some(tracker(&recordings, poses));
        config.calibration = Some(session());
        config.environment.light_count = 8;
        let status = SharedStatus::new(live_settings(&config));
        let shutdown = Arc::<AtomicBool>::default();
        let source = Source::Live(Live::new(&config, true).unwrap());
        let options = RunOptions::default();
        let runner =
            Runner::new(source, config, options, status.clone(), shutdown.clone()).unwrap();
        let adapter = std::env::var("PENUMBRA_TEST_ADAPTER");
        let gpu = Gpu::open(Some(adapter.as_deref().unwrap_or("llvmpipe")))
            .unwrap_or_else(|error| panic!("{error}\n`make test` installs the software driver"));
        let thread = threads::spawn("compositor", move || runner.run(gpu, None)).unwrap();
        Self {
            status,
            shutdown,
            thread: Some(thread),
        }
    }

    fn device(&self, kind: DeviceKind) -> Option<Device> {
        let devices = self.status.snapshot().devices;
        devices.into_iter().find(|device| device.kind == kind)
    }

    /// Waits until a condition on a device holds; returns the time.
    fn until(
        &self,
        kind: DeviceKind,
        what: &str,
        mut holds: impl FnMut(&Device) -> bool,
    ) -> Duration {
        self.wait(what, |rig| rig.device(kind).is_some_and(|d| holds(&d)))
    }

    fn wait(&self, what: &str, mut holds: impl FnMut(&Self) -> bool) -> Duration {
        let begun = Instant::now();
        while !holds(self) {
            let s = self.status.snapshot();
            assert!(
                begun.elapsed() < Duration::from_secs(60),
                "{what}: {:#?} {:#?}",
                s.devices,
                s.frames
            );
            assert!(!self.thread.as_ref().unwrap().is_finished(), "{what}: over");
            std::thread::sleep(Duration::from_millis(10));
        }
        begun.elapsed()
    }

    /// Waits until the counter `more` increases.
    fn wait_for_more(&self, what: &str, more: impl Fn(&Snapshot) -> u64) {
        let before = more(&self.status.snapshot());
        self.wait(what, |rig| more(&rig.status.snapshot()) > before + 5);
    }

    fn end(mut self) -> Report {
        self.shutdown.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap().unwrap()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.shutdown.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn pictures(s: &Snapshot) -> u64 {
    s.frames.composed
}

fn with_pose(s: &Snapshot) -> u64 {
    s.frames.composed - s.frames.without_pose
}

const RETURN: Duration = Duration::from_secs(2);

fn not_found(name: &str) -> Fault {
    let device = name.to_owned();
    Fault::Error(DeviceError::Unplugged { device })
}

fn faultless(name: &'static str) -> FaultyDevice {
    FaultyDevice::new(name, u32::MAX, Vec::new())
}

#[test]
fn pictures_continue_without_tracker_and_with_a_faulty_driver() {
    let environment = FaultyDevice::new("environment", 2, vec![Plan::new([(30, Fault::Panic)])]);
    let poses = FaultyDevice::new(
        "tracker",
        1,
        vec![Plan::new([
            (60, Fault::Flipped { every: 3 }),
            (0, Fault::CutShort { share: 0.5 }),
            (60, not_found("tracker")),
        ])],
    );
    let rig = Rig::start(&faultless("scene"), &environment, &poses);
    rig.until(DeviceKind::Tracker, "its loss is reported", |d| {
        d.state == DeviceState::Retrying
            && d.reason.as_deref()
                == Some("tracker: not connected; plug it in or configure another one")
    });
    let reported = rig.device(DeviceKind::Tracker).unwrap();
    assert_eq!(reported.losses, 1, "{reported:?}");
    rig.wait_for_more("pictures without poses", |s| s.frames.without_pose);
    poses.plug_in();
    let waited = rig.until(DeviceKind::Tracker, "it streams again", |d| {
        d.state == DeviceState::Streaming
    });
    assert!(waited < RETURN, "{waited:?}");
    rig.wait_for_more("poses pair again", with_pose);

    // A panic in a driver affects only its device, until that is opened again.
    rig.until(DeviceKind::EnvironmentCamera, "its bug is reported", |d| {
        let faults = d.last_error.as_deref();
        faults.is_some_and(|t| t.contains("its driver has a bug"))
    });
    rig.until(
        DeviceKind::EnvironmentCamera,
        "it streams again after the bug",
        |d| d.state == DeviceState::Streaming && d.losses == 1,
    );
    rig.wait_for_more("poses continue", with_pose);
    rig.end();
}

#[test]
fn faulty_scene_camera_is_reported_and_reopened() {
    let scene = FaultyDevice::new(
        "scene",
        1,
        vec![
            Plan::new([(40, not_found("scene"))]),
            // Twelve cut pictures in a row, because a slow rig skips most.
            Plan::new(
                std::iter::once((20, Fault::CutShort { share: 0.0 }))
                    .chain((0..12).map(|_| (0, Fault::CutShort { share: 0.4 })))
                    .chain([
                        (3, Fault::Flipped { every: 5 }),
                        (3, Fault::Lost),
                        // About two seconds of the recording.
                        (3, Fault::Silence { readings: 60 }),
                    ]),
            ),
        ],
    );
    let rig = Rig::start(&scene, &faultless("environment"), &faultless("tracker"));
    rig.until(DeviceKind::SceneCamera, "its loss is reported", |d| {
        let reason = d.reason.as_deref();
        d.state == DeviceState::Retrying && reason.is_some_and(|r| r.contains("not connected"))
    });
    let reported = rig.status.snapshot().session.description;
    assert!(
        reported.contains("no picture arrives: scene: not connected"),
        "{reported}"
    );
    scene.plug_in();
    let waited = rig.until(DeviceKind::SceneCamera, "it streams again", |d| {
        d.state == DeviceState::Streaming
    });
    assert!(waited < RETURN, "{waited:?}");
    rig.wait_for_more("pictures continue after the loss", pictures);

    // A device that is open but silent for a while is reported, and not opened again.
    rig.until(DeviceKind::SceneCamera, "its silence is reported", |d| {
        let reason = d.reason.as_deref();
        d.state == DeviceState::Silent && reason.is_some_and(|r| r.contains("silent for"))
    });
    rig.until(DeviceKind::SceneCamera, "it delivers again", |d| {
        d.state == DeviceState::Streaming
    });
    let reported = rig.device(DeviceKind::SceneCamera).unwrap();
    assert_eq!(
        (reported.losses, reported.reason.as_deref()),
        (1, None),
        "{reported:?}"
    );
    rig.wait_for_more("pictures continue after the silence", with_pose);
    let report = rig.end();
    assert!(report.frames.damaged >= 1, "{:?}", report.frames);
}
