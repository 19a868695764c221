//! Cost of capture: two cameras of 1280×720 at 30 Hz and a tracker, through the threads of the live
//! rig up to the picture that is ready for the compositor.
//!
//! The cameras replay a recording: instead of waiting for the kernel and copying, their threads
//! sleep and read a file from memory. The tracker is simulated behind a pseudo-terminal, which its
//! driver uses like a serial port.

use super::camera_session::{CameraSession, RATE};
use super::percentiles::Percentiles;
use super::report::{CaptureRow, DeviceTally, ThreadCost};
use super::simulated_tracker::PlayedTracker;
use super::thread_time::{self, ThreadTimes};
use super::{BenchError, BenchOptions};
use penumbra_capture::LiveDevice;
use penumbra_config::{CameraSource, TrackerSource};
use penumbra_config::{Config, TrackerConfig};
use penumbra_rig::frame::PreparedFrame;
use penumbra_rig::prepare::{Preparation, PreparationEvent};
use penumbra_rig::{Live, RigSetup, Source, live_settings};
use penumbra_status::SharedStatus;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Warm-up: devices open, caches fill and the first lighting is estimated.
const WARM_UP: Duration = Duration::from_secs(1);
/// Pictures of each camera without `--frames`: ten seconds.
const FRAMES: u32 = 10 * RATE;

pub(super) fn run(options: &BenchOptions) -> Result<CaptureRow, BenchError> {
    let size = options.size.unwrap_or((1280, 720));
    let session = CameraSession::write(size)?;
    let tracker = PlayedTracker::start()?;
    let config = config(session.path(), tracker.device());
    let seconds = f64::from(options.frames.unwrap_or(FRAMES)) / f64::from(RATE);
    let measured = Rig::start(&config)?.measure(Duration::from_secs_f64(seconds));
    Ok(CaptureRow {
        case: "capture".to_owned(),
        width: size.0,
        height: size.1,
        frames_per_second: f64::from(RATE),
        picture_kilobytes: session.picture_bytes / 1e3,
        ..measured
    })
}

fn config(session: &Path, tracker: Option<&str>) -> Config {
    let camera = CameraSource::Replay(session.to_owned());
    let mut config = Config {
        environment_camera: Some(camera.clone()),
        calibration: Some(session.to_owned()),
        tracker: tracker.map(|device| {
            TrackerSource::System(Box::new(TrackerConfig {
                device: device.to_owned(),
                ..TrackerConfig::default()
            }))
        }),
        ..Config::default()
    };
    config.scene_camera.source = camera;
    config
}

/// The live rig without the compositor.
struct Rig {
    preparation: Preparation,
    live: Live,
    stop: Arc<AtomicBool>,
}

impl Rig {
    fn start(config: &Config) -> Result<Self, BenchError> {
        let live = Live::new(config, true)?;
        let source = Source::Live(live.clone());
        let setup = RigSetup::read(&source, config)?;
        let status = SharedStatus::new(live_settings(config));
        let stop = Arc::<AtomicBool>::default();
        let requested = status.settings_receiver();
        let preparation = Preparation::start(&setup, config, &source, requested, stop.clone())?;
        live.open()?;
        Ok(Self {
            preparation,
            live,
            stop,
        })
    }

    fn measure(self, time: Duration) -> CaptureRow {
        self.take(WARM_UP, |_| ());
        let (before, earlier) = (thread_time::current(), self.tallies());
        let mut tally = Tally::default();
        let begun = Instant::now();
        self.take(time, |prepared| tally.add(prepared));
        let seconds = begun.elapsed().as_secs_f64();
        let spent = thread_time::between(&before, &thread_time::current());
        let cameras = since(&earlier, self.tallies());
        self.stop.store(true, Ordering::Relaxed);
        tally.row(seconds, cameras, &spent)
    }

    /// Takes prepared frames for `time`, like a compositor that needs no time.
    fn take(&self, time: Duration, mut each: impl FnMut(&PreparedFrame)) {
        let begun = Instant::now();
        while begun.elapsed() < time {
            match self.preparation.next() {
                Some(PreparationEvent::Frame(prepared)) => {
                    each(&prepared);
                    self.preparation.give_back(prepared.picture);
                }
                Some(_) => (),
                None => return,
            }
        }
    }

    fn tallies(&self) -> Vec<DeviceTally> {
        let hub = self.live.hub.counts();
        let tally = |device: &LiveDevice, lost: u64| DeviceTally {
            device: device.kind.label().to_owned(),
            delivered: device.status().received,
            lost,
        };
        let lost = [hub.scene_superseded, hub.environment_lost, hub.tracker_lost];
        let devices = self.live.supervised().iter().zip(lost);
        devices.map(|(device, lost)| tally(device, lost)).collect()
    }
}

fn since(earlier: &[DeviceTally], mut now: Vec<DeviceTally>) -> Vec<DeviceTally> {
    for (tally, earlier) in now.iter_mut().zip(earlier) {
        tally.delivered -= earlier.delivered;
        tally.lost -= earlier.lost;
    }
    now
}

/// The prepared frames.
#[derive(Default)]
struct Tally {
    decoding: Vec<f64>,
    lighting: Vec<f64>,
    skipped: u64,
    posed: u64,
}

impl Tally {
    fn add(&mut self, prepared: &PreparedFrame) {
        self.decoding.push(prepared.decoding.as_secs_f64() * 1e3);
        self.lighting.push(prepared.lighting.as_secs_f64() * 1e3);
        self.skipped += prepared.skipped;
        self.posed += u64::from(prepared.world_from_camera.is_some());
    }

    fn row(self, seconds: f64, devices: Vec<DeviceTally>, spent: &ThreadTimes) -> CaptureRow {
        let pictures = devices.first().map_or(0, |scene| scene.delivered).max(1);
        let cost = |(name, nanos): (&String, &u64)| ThreadCost {
            name: name.clone(),
            percent_of_core: *nanos as f64 * 1e-7 / seconds,
            ms_per_picture: *nanos as f64 * 1e-6 / pictures as f64,
        };
        let mut threads: Vec<_> = spent.iter().map(cost).collect();
        threads.sort_by(|a, b| b.percent_of_core.total_cmp(&a.percent_of_core));
        CaptureRow {
            seconds,
            devices,
            prepared: self.decoding.len() as u64,
            prepared_with_pose: self.posed,
            skipped: self.skipped,
            decode_ms: Percentiles::from_values(&self.decoding),
            light_ms: Percentiles::from_values(&self.lighting),
            threads,
            ..CaptureRow::default()
        }
    }
}
