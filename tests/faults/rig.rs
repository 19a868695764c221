//! A live rig whose devices, disk, viewers and settings can be disturbed, and what is seen of it.

use crate::steady::{Recording, SteadyCamera, SteadyTracker, Which};
use penumbra_compositor::Gpu;
use penumbra_config::{CameraSource, Config, LightPlaces, TrackerSource};
use penumbra_faulty::{FaultSwitch, FaultyDisk, SwitchedCamera, SwitchedTracker};
use penumbra_interface::{Camera, DeviceFactory, DeviceKind, Tracker, threads};
use penumbra_rig::service::Service;
use penumbra_rig::synced_file::SyncedFile;
use penumbra_rig::{Live, Recorder, Report, RigError, RunOptions, Runner, Source, live_settings};
use penumbra_status::snapshot::Device;
use penumbra_status::{SharedStatus, Snapshot, StatusServer};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval of looking at the status.
const LOOK: Duration = Duration::from_millis(10);

/// The switches of the three devices.
#[derive(Clone, Default)]
pub struct Switches {
    scene: FaultSwitch,
    environment: FaultSwitch,
    tracker: FaultSwitch,
}

impl Switches {
    pub const fn of(&self, kind: DeviceKind) -> &FaultSwitch {
        match kind {
            DeviceKind::SceneCamera => &self.scene,
            DeviceKind::EnvironmentCamera => &self.environment,
            DeviceKind::Tracker => &self.tracker,
        }
    }
}

/// A running rig; dropping it ends it.
pub struct Rig {
    pub switches: Switches,
    pub disk: FaultyDisk,
    pub recorder: Arc<Recorder>,
    pub status: Arc<SharedStatus>,
    pub address: SocketAddr,
    shutdown: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<Report, RigError>>>,
    _service: Service,
    composed: u64,
    composed_at: Instant,
    /// The longest time between two pictures since the last reset.
    pub largest_gap: Duration,
}

impl Rig {
    pub fn start(folder: &Path) -> Self {
        let switches = Switches::default();
        let config = config(&switches, folder);
        let status = SharedStatus::new(live_settings(&config));
        let shutdown = Arc::<AtomicBool>::default();
        let live = Live::new(&config, true).unwrap();
        let disk = FaultyDisk::default();
        let contents = live.contents.clone();
        let faulty = disk.clone();
        let recorder = Recorder::on_disk(
            live.hub.clone(),
            contents,
            config.recording.clone(),
            status.clone(),
            Box::new(move |file| Box::new(faulty.file(SyncedFile::new(file)))),
        );
        status.set_recorder(recorder.clone());
        let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
        let server = StatusServer::bind(any_port, None, status.clone()).unwrap();
        let address = server.local_addr();
        let service = Service::start(Some(server), shutdown.clone()).unwrap();
        let options = RunOptions::default();
        let (source, stop) = (Source::Live(live), shutdown.clone());
        let runner = Runner::new(source, config, options, status.clone(), stop).unwrap();
        let adapter = std::env::var("PENUMBRA_TEST_ADAPTER");
        let gpu = Gpu::open(Some(adapter.as_deref().unwrap_or("llvmpipe")))
            .unwrap_or_else(|error| panic!("{error}\n`make test` installs the software driver"));
        let thread = threads::spawn("compositor", move || runner.run(gpu, None)).unwrap();
        Self {
            switches,
            disk,
            recorder,
            status,
            address,
            shutdown,
            thread: Some(thread),
            _service: service,
            composed: 0,
            composed_at: Instant::now(),
            largest_gap: Duration::ZERO,
        }
    }

    /// Looks at the status, and measures the time between pictures.
    pub fn look(&mut self) -> Snapshot {
        std::thread::sleep(LOOK);
        let over = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
        assert!(!over, "the rig has ended");
        let s = self.status.snapshot();
        if s.frames.composed != self.composed {
            self.composed = s.frames.composed;
            self.composed_at = Instant::now();
        }
        self.largest_gap = self.largest_gap.max(self.composed_at.elapsed());
        s
    }

    /// Measures gaps anew; the time without a picture so far does not count.
    pub fn reset_gap(&mut self) {
        self.composed_at = Instant::now();
        self.largest_gap = Duration::ZERO;
    }

    /// Looks for a time.
    pub fn look_for(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.look();
        }
    }

    /// Looks until a condition holds; returns the time, or `None` after `limit`.
    pub fn until(
        &mut self,
        limit: Duration,
        mut holds: impl FnMut(&Snapshot) -> bool,
    ) -> Option<Duration> {
        let begun = Instant::now();
        while begun.elapsed() < limit {
            if holds(&self.look()) {
                return Some(begun.elapsed());
            }
        }
        None
    }

    /// Ends the rig.
    pub fn end(mut self) -> Report {
        self.shutdown.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap().unwrap()
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.shutdown.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn session() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/sessions/desk.mcap")
}

/// The bundled session's rig with switched devices.
fn config(switches: &Switches, folder: &Path) -> Config {
    let recording = Arc::new(Recording::read(&session()));
    let mut config = Config::default();
    let scene = camera("scene", Which::Scene, &recording, &switches.scene);
    config.scene_camera.source = scene;
    let switch = &switches.environment;
    let environment = camera("environment", Which::Environment, &recording, switch);
    config.environment_camera = Some(environment);
    config.tracker = Some(tracker(&recording, &switches.tracker));
    config.calibration = Some(session());
    config.environment.light_count = 8;
    // Estimates of lamps' places would keep the light's thread busy while pictures are damaged.
    config.environment.light_places = LightPlaces::Far;
    config.recording.folder = folder.to_owned();
    config.recording.reserve_bytes = 0;
    config
}

fn camera(
    name: &'static str,
    which: Which,
    recording: &Arc<Recording>,
    switch: &FaultSwitch,
) -> CameraSource {
    let (recording, switch) = (Arc::clone(recording), switch.clone());
    CameraSource::Custom(DeviceFactory::new(name, move |_| {
        switch.plugged_in(name)?;
        let inner = Box::new(SteadyCamera::new(Arc::clone(&recording), which));
        let camera = SwitchedCamera::new(name, inner, switch.clone());
        Ok(Box::new(camera) as Box<dyn Camera>)
    }))
}

fn tracker(recording: &Arc<Recording>, switch: &FaultSwitch) -> TrackerSource {
    let (recording, switch) = (Arc::clone(recording), switch.clone());
    TrackerSource::Custom(DeviceFactory::new("tracker", move |_| {
        switch.plugged_in("tracker")?;
        let inner = Box::new(SteadyTracker::new(Arc::clone(&recording)));
        let tracker = SwitchedTracker::new("tracker", inner, switch.clone());
        Ok(Box::new(tracker) as Box<dyn Tracker>)
    }))
}

/// Everything in the status that names a problem now or has counted one since `before`.
pub fn named(before: &Snapshot, s: &Snapshot) -> String {
    let mut named = format!("viewers: {}\n", s.stream.viewers);
    let mut add = |text: &str| {
        named.push_str(text);
        named.push('\n');
    };
    if s.settings_requested != before.settings_requested {
        add("settings requested");
    }
    add(&s.recording.description);
    for warning in &s.warnings {
        let known = before.warnings.iter().find(|w| w.text == warning.text);
        if known.is_none_or(|w| w.count < warning.count) {
            add(&warning.text);
        }
    }
    for device in &s.devices {
        let known = before.devices.iter().find(|d| d.kind == device.kind);
        device.reason.iter().for_each(|reason| add(reason));
        device.controls.iter().for_each(|c| add(&c.status));
        for problem in &device.problems {
            let is_same = |d: &Device| d.problems.contains(problem);
            if !known.is_some_and(is_same) {
                add(problem.text);
            }
        }
    }
    named
}
