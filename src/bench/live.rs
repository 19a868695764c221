//! How long a live rig takes from the arrival of the scene camera's picture to the composed
//! one: replayed devices, of which the rig cannot tell that they are none, through all of
//! its own threads.

use super::report::Percentiles;
use super::{BenchError, BenchOptions};
use penumbra_compositor::Gpu;
use penumbra_config::{Antialias, Config};
use penumbra_config::{CameraSource, TrackerSource};
use penumbra_interface::threads;
use penumbra_rig::{Live, RunOptions, Runner, Source, live_settings};
use penumbra_status::Histogram;
use penumbra_status::times::StageKind;
use penumbra_status::{SharedStatus, Snapshot};
use serde::Serialize;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The recording whose devices are played where no other is named.
pub(super) const SESSION: &str = "tests/fixtures/sessions/desk.mcap";
/// The quickest first; the last two differ from the defaults in the number of lights alone.
const SETTINGS: [Setting; 4] = [
    Setting::new(8, false, Antialias::Off),
    Setting::new(8, false, Antialias::Msaa4),
    Setting::new(8, true, Antialias::Msaa4),
    Setting::new(64, true, Antialias::Msaa4),
];
/// Pictures composed before anything is measured: drivers compile, caches fill, and the
/// light finds its first match between the cameras. Not more than are measured.
const WARM_UP: u64 = 60;
/// Pictures composed for a row without `--frames`: half a minute at a camera's usual pace.
const FRAMES: u32 = 900;
/// A row ends after this long for each of its pictures, whatever came.
const PATIENCE: Duration = Duration::from_millis(500);
/// Between two looks at the rig's status; the rig is not to be slowed by it.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// What a live rig spends its time on.
#[derive(Clone, Copy)]
struct Setting {
    lights: u32,
    /// A picture waits for the tracker's next reading.
    waits: bool,
    antialias: Antialias,
}

impl Setting {
    const fn new(lights: u32, waits: bool, antialias: Antialias) -> Self {
        Self {
            lights,
            waits,
            antialias,
        }
    }
}

/// A live rig by one setting.
#[derive(Clone, Debug, Serialize)]
pub struct LiveRow {
    /// Case name.
    pub case: String,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Dome lights at most.
    pub lights: u32,
    /// How long a picture waits for the tracker's next reading at most, milliseconds.
    pub max_wait_ms: f64,
    /// Samples a pixel of virtual objects' outlines.
    pub samples: u32,
    /// How long was measured.
    pub seconds: f64,
    /// Pictures composed.
    pub composed: u64,
    /// Pictures passed over for newer ones.
    pub passed_over: u64,
    /// Pictures composed a second.
    pub frames_per_second: f64,
    /// Milliseconds from the arrival of a picture to the composed one.
    pub arrival_to_picture_ms: Percentiles,
    /// Milliseconds of that from bytes to pixels.
    pub decode_ms: Percentiles,
    /// Milliseconds of that from pixels and light to the composed picture.
    pub total_ms: Percentiles,
    /// Milliseconds that the light took, beside that.
    pub light_ms: Percentiles,
    /// Age of the environment's picture in the last composed one, milliseconds.
    pub light_age_ms: Option<f64>,
}

pub(super) fn run(
    gpu: &Gpu,
    options: &BenchOptions,
    rows: &mut Vec<LiveRow>,
    progress: &mut dyn FnMut(&LiveRow),
) -> Result<(), BenchError> {
    let session = options.session();
    for setting in SETTINGS {
        let config = config(session, setting);
        let row = measure(gpu, &config, options.frames.unwrap_or(FRAMES))?;
        progress(&row);
        rows.push(row);
    }
    Ok(())
}

fn config(session: &Path, setting: Setting) -> Config {
    let camera = CameraSource::Replay(session.to_owned());
    let mut config = Config {
        environment_camera: Some(camera.clone()),
        tracker: Some(TrackerSource::Replay(session.to_owned())),
        calibration: Some(session.to_owned()),
        ..Config::default()
    };
    config.scene_camera.source = camera;
    config.environment.light_count = setting.lights;
    config.picture.antialias = setting.antialias;
    if !setting.waits {
        config.sync.max_wait_nanos = 0;
    }
    config
}

fn measure(gpu: &Gpu, config: &Config, frames: u32) -> Result<LiveRow, BenchError> {
    let status = SharedStatus::new(live_settings(config));
    let shutdown = Arc::<AtomicBool>::default();
    let runner = Runner::new(
        Source::Live(Live::new(config, true)?),
        config.clone(),
        RunOptions::default(),
        status.clone(),
        shutdown.clone(),
    )?;
    let job = move || watch(&status, &shutdown, u64::from(frames));
    let watcher = threads::spawn("bench", job).map_err(|source| BenchError::Thread { source })?;
    let ran = runner.run(gpu.clone(), None);
    // It ends by itself if the rig has not.
    let Ok((before, after, seconds)) = watcher.join() else {
        return Err(BenchError::Silent);
    };
    ran?;
    row(config, &before, &after, seconds).ok_or(BenchError::Silent)
}

/// What the rig knew after the warm-up and after so many pictures more, and how long that
/// took; then the rig is told to end.
fn watch(status: &SharedStatus, shutdown: &AtomicBool, frames: u64) -> (Snapshot, Snapshot, f64) {
    let warm_up = WARM_UP.min(frames);
    let before = composed(status, warm_up, warm_up);
    let begun = Instant::now();
    let after = composed(status, before.frames.composed + frames, frames);
    let seconds = begun.elapsed().as_secs_f64();
    shutdown.store(true, Ordering::Relaxed);
    (before, after, seconds)
}

/// The status after so many pictures in all, or after time for `pictures` is over.
fn composed(status: &SharedStatus, in_all: u64, pictures: u64) -> Snapshot {
    let begun = Instant::now();
    let longest = PATIENCE.saturating_mul(u32::try_from(pictures).unwrap_or(u32::MAX));
    loop {
        let snapshot = status.snapshot();
        if snapshot.frames.composed >= in_all || begun.elapsed() > longest {
            return snapshot;
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// None without a picture.
fn row(config: &Config, before: &Snapshot, after: &Snapshot, seconds: f64) -> Option<LiveRow> {
    let between = |stage: &str| {
        let of = |s: &Snapshot| s.stages.get(stage, StageKind::Cpu).cloned();
        let later = of(after).unwrap_or_default();
        percentiles(&later.since(&of(before).unwrap_or_default()))
    };
    let composed = after.frames.composed - before.frames.composed;
    (composed > 0).then(|| LiveRow {
        case: "live".to_owned(),
        width: after.resolution.width,
        height: after.resolution.height,
        lights: config.environment.light_count,
        max_wait_ms: config.sync.max_wait_nanos as f64 * 1e-6,
        samples: match config.picture.antialias {
            Antialias::Msaa4 => 4,
            Antialias::Off => 1,
        },
        seconds,
        composed,
        passed_over: after.frames.skipped - before.frames.skipped,
        frames_per_second: composed as f64 / seconds,
        arrival_to_picture_ms: between("arrival_to_picture"),
        decode_ms: between("decode"),
        total_ms: between("total"),
        light_ms: between("environment"),
        light_age_ms: after.lighting.age_ms,
    })
}

fn percentiles(times: &Histogram) -> Percentiles {
    let at = |quantile| times.quantile(quantile).as_secs_f64() * 1e3;
    Percentiles {
        p50: at(0.5),
        p99: at(0.99),
    }
}

impl fmt::Display for LiveRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {}x{}, {} lights, {} samples, waits {:.0} ms for poses: {:.1} frames/s, {} composed and {} \
             passed over in {:.1} s",
            self.case,
            self.width,
            self.height,
            self.lights,
            self.samples,
            self.max_wait_ms,
            self.frames_per_second,
            self.composed,
            self.passed_over,
            self.seconds
        )?;
        let parts = [
            ("arrival to picture", self.arrival_to_picture_ms),
            ("decode", self.decode_ms),
            ("compose", self.total_ms),
            ("light, beside it", self.light_ms),
        ];
        for (name, ms) in parts {
            write!(
                f,
                "\n  {name:18} p50 {:7.2} ms, p99 {:7.2} ms",
                ms.p50, ms.p99
            )?;
        }
        Ok(())
    }
}
