//! A whole live rig whose devices misbehave on purpose: unplugged, silent, cut short, damaged,
//! with a bug in a driver. The picture goes on, the status says why, and who comes back is
//! taken back within two seconds.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

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

/// What a device does, opening by opening.
#[derive(Clone)]
struct Trouble {
    name: &'static str,
    plans: Arc<Mutex<VecDeque<Plan>>>,
    /// Times that it may still be opened; then it is not there.
    plugged_in: Arc<AtomicU32>,
}

impl Trouble {
    /// After the last plan the device is as good as the recorded one inside.
    fn new(name: &'static str, openings: u32, plans: Vec<Plan>) -> Self {
        Self {
            name,
            plans: Arc::new(Mutex::new(plans.into())),
            plugged_in: Arc::new(AtomicU32::new(openings)),
        }
    }

    /// What becomes of this opening.
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

fn camera(stream: Stream, recordings: &Recordings, trouble: &Trouble) -> CameraSource {
    let (recordings, trouble) = (recordings.clone(), trouble.clone());
    CameraSource::Custom(DeviceFactory::new(trouble.name, move |clock| {
        let plan = trouble.plan()?;
        let inner = open_camera(&CameraSource::Replay(session()), stream, &recordings, clock)?;
        Ok(Box::new(FaultyCamera::new(inner, plan)) as Box<dyn Camera>)
    }))
}

fn tracker(recordings: &Recordings, trouble: &Trouble) -> TrackerSource {
    let (recordings, trouble) = (recordings.clone(), trouble.clone());
    TrackerSource::Custom(DeviceFactory::new(trouble.name, move |clock| {
        let plan = trouble.plan()?;
        let inner = open_tracker(&TrackerSource::Replay(session()), &recordings, clock)?;
        Ok(Box::new(FaultyTracker::new(inner, plan)) as Box<dyn Tracker>)
    }))
}

/// The rig at work; ended in order when it is dropped.
struct Rig {
    status: Arc<SharedStatus>,
    shutdown: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<Report, RigError>>>,
}

impl Rig {
    fn start(scene: &Trouble, environment: &Trouble, poses: &Trouble) -> Self {
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

    /// Waits until something is true of a device; how long that took.
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

    /// Waits for more pictures of which `more` counts.
    fn goes_on(&self, what: &str, more: impl Fn(&Snapshot) -> u64) {
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

fn gone(name: &str) -> Fault {
    let device = name.to_owned();
    Fault::Error(DeviceError::Unplugged { device })
}

fn well(name: &'static str) -> Trouble {
    Trouble::new(name, u32::MAX, Vec::new())
}

#[test]
fn pictures_continue_without_tracker_and_with_a_faulty_driver() {
    let environment = Trouble::new("environment", 2, vec![Plan::new([(30, Fault::Panic)])]);
    let poses = Trouble::new(
        "tracker",
        1,
        vec![Plan::new([
            (60, Fault::Flipped { every: 3 }),
            (0, Fault::CutShort { share: 0.5 }),
            (60, gone("tracker")),
        ])],
    );
    let rig = Rig::start(&well("scene"), &environment, &poses);
    rig.until(DeviceKind::Tracker, "its loss is told", |d| {
        d.state == DeviceState::Retrying
            && d.reason.as_deref() == Some("tracker: not there; plug it in or name another one")
    });
    let told = rig.device(DeviceKind::Tracker).unwrap();
    assert_eq!(told.losses, 1, "{told:?}");
    rig.goes_on("the picture, without poses", |s| s.frames.without_pose);
    poses.plug_in();
    let waited = rig.until(DeviceKind::Tracker, "it streams again", |d| {
        d.state == DeviceState::Streaming
    });
    assert!(waited < RETURN, "{waited:?}");
    rig.goes_on("poses pair again", with_pose);

    // A driver's bug costs its device, and only until the next try.
    rig.until(DeviceKind::EnvironmentCamera, "its bug is told", |d| {
        let trouble = d.last_error.as_deref();
        trouble.is_some_and(|t| t.contains("its driver has a bug"))
    });
    rig.until(DeviceKind::EnvironmentCamera, "it is back", |d| {
        d.state == DeviceState::Streaming && d.losses == 1
    });
    rig.goes_on("all is well", with_pose);
    rig.end();
}

#[test]
fn faulty_scene_camera_is_reported_and_reopened() {
    let scene = Trouble::new(
        "scene",
        1,
        vec![
            Plan::new([(40, gone("scene"))]),
            Plan::new([
                (20, Fault::CutShort { share: 0.4 }),
                (0, Fault::CutShort { share: 0.0 }),
                (3, Fault::Flipped { every: 5 }),
                (3, Fault::Lost),
                // About two seconds of the recording.
                (3, Fault::Silence { readings: 60 }),
            ]),
        ],
    );
    let rig = Rig::start(&scene, &well("environment"), &well("tracker"));
    rig.until(DeviceKind::SceneCamera, "its loss is told", |d| {
        let reason = d.reason.as_deref();
        d.state == DeviceState::Retrying && reason.is_some_and(|r| r.contains("not there"))
    });
    let told = rig.status.snapshot().session.description;
    assert!(
        told.contains("no picture arrives: scene: not there"),
        "{told}"
    );
    scene.plug_in();
    let waited = rig.until(DeviceKind::SceneCamera, "it streams again", |d| {
        d.state == DeviceState::Streaming
    });
    assert!(waited < RETURN, "{waited:?}");
    rig.goes_on("the picture is back", pictures);

    // Open, and says nothing for a while: told, and waited out without opening it anew.
    rig.until(DeviceKind::SceneCamera, "its silence is told", |d| {
        let reason = d.reason.as_deref();
        d.state == DeviceState::Silent && reason.is_some_and(|r| r.contains("silent for"))
    });
    rig.until(DeviceKind::SceneCamera, "it speaks again", |d| {
        d.state == DeviceState::Streaming
    });
    let told = rig.device(DeviceKind::SceneCamera).unwrap();
    assert_eq!((told.losses, told.reason.as_deref()), (1, None), "{told:?}");
    rig.goes_on("the picture goes on", with_pose);
    let report = rig.end();
    assert!(report.frames.damaged >= 1, "{:?}", report.frames);
}
