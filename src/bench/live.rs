//! Latency of a live rig from the arrival of the scene camera's picture to the composited one, with
//! replayed devices, through all threads of the rig.

use super::percentiles::Percentiles;
use super::resized::resized;
use super::{BenchError, BenchOptions};
use penumbra_compositor::{Compositor, Gpu};
use penumbra_config::{Antialias, Config};
use penumbra_config::{CameraSource, TrackerSource};
use penumbra_interface::threads;
use penumbra_output::Screen;
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

/// The default recording.
pub(super) const SESSION: &str = "tests/fixtures/sessions/desk.mcap";
/// Settings, fastest first; the last two differ from the defaults only in the number of lights.
const SETTINGS: [Setting; 4] = [
    Setting::new(8, false, Antialias::Off),
    Setting::new(8, false, Antialias::Msaa4),
    Setting::new(8, true, Antialias::Msaa4),
    Setting::new(64, true, Antialias::Msaa4),
];
/// Number of warm-up pictures, or that of the measured ones if it is smaller: drivers compile
/// shaders, caches fill, and the white balance between the cameras is estimated.
const WARM_UP: u64 = 60;
/// Pictures composed for a row without `--frames`: half a minute at a typical frame rate.
const FRAMES: u32 = 900;
/// Further time that is allowed per picture.
const TIMEOUT_PER_PICTURE: Duration = Duration::from_millis(500);
/// Timeout until the first picture, in which drivers compile shaders and the first light is found; the
/// same time is allowed for pauses later, because the machine may be busy with something else.
const TIMEOUT_TO_START: Duration = Duration::from_secs(30);
/// Interval at which the rig's status is read; long enough not to slow the rig.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Settings that determine a live rig's frame time.
#[derive(Clone, Copy)]
struct Setting {
    lights: u32,
    /// Whether a picture waits for the tracker's next reading.
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

/// Result for a live rig with one setting.
#[derive(Clone, Debug, Serialize)]
pub struct LiveRow {
    /// Case name.
    pub case: String,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Maximum number of dome lights.
    pub lights: u32,
    /// Maximum time that a picture waits for the tracker's next reading, milliseconds.
    pub max_wait_ms: f64,
    /// Samples per pixel at the outlines of virtual objects.
    pub samples: u32,
    /// Duration of the measurement.
    pub seconds: f64,
    /// Pictures composed.
    pub composed: u64,
    /// Pictures skipped for newer ones.
    pub skipped: u64,
    /// Pictures composed per second.
    pub frames_per_second: f64,
    /// Milliseconds from the arrival of a picture to the composed one.
    pub arrival_to_picture_ms: Percentiles,
    /// Of these, milliseconds of decoding.
    pub decode_ms: Percentiles,
    /// Of these, milliseconds of compositing.
    pub total_ms: Percentiles,
    /// Milliseconds of the lighting, which runs in parallel.
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
    let resized = options.size.map(|size| resized(options.session(), size));
    let resized = resized.transpose()?;
    let session = resized
        .as_ref()
        .map_or(options.session(), |file| file.path());
    for setting in SETTINGS {
        let config = config(session, setting);
        let row = measure(gpu, &config, options.frames.unwrap_or(FRAMES))?;
        progress(&row);
        rows.push(row);
    }
    Ok(())
}

/// Destroys the device of the compositor once, when it has shown some pictures.
struct Destroyer(u64);

impl Screen for Destroyer {
    fn show(&mut self, compositor: &Compositor) -> bool {
        self.0 += 1;
        if self.0 == WARM_UP {
            compositor.gpu().device.destroy();
        }
        true
    }
}

/// Returns the time without a picture after the graphics device of a live rig was lost, seconds.
pub(super) fn recovery(gpu: &Gpu, options: &BenchOptions) -> Result<f64, BenchError> {
    let [.., setting] = SETTINGS;
    let config = config(options.session(), setting);
    let watched = |status: &SharedStatus| {
        let recovered = |s: &Snapshot| s.adapter.recovery_seconds.is_some();
        wait_until(status, recovered, 2 * TIMEOUT_TO_START)
    };
    let screen = Some(Box::new(Destroyer(0)) as Box<dyn Screen>);
    let seconds = run_rig(gpu, &config, screen, watched)?
        .adapter
        .recovery_seconds;
    seconds.ok_or(BenchError::Silent)
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
    let watched = move |status: &SharedStatus| watch(status, u64::from(frames));
    let (before, after, seconds) = run_rig(gpu, config, None, watched)?;
    row(config, &before, &after, seconds).ok_or(BenchError::Silent)
}

/// Runs a live rig until `watch` returns, on a thread of its own; returns its result.
fn run_rig<T: Send + 'static>(
    gpu: &Gpu,
    config: &Config,
    screen: Option<Box<dyn Screen>>,
    watch: impl FnOnce(&SharedStatus) -> T + Send + 'static,
) -> Result<T, BenchError> {
    let status = SharedStatus::new(live_settings(config));
    let shutdown = Arc::<AtomicBool>::default();
    let runner = Runner::new(
        Source::Live(Live::new(config, true)?),
        config.clone(),
        RunOptions::default(),
        status.clone(),
        shutdown.clone(),
    )?;
    let job = move || {
        let result = watch(&status);
        shutdown.store(true, Ordering::Relaxed);
        result
    };
    let watcher = threads::spawn("bench", job).map_err(|source| BenchError::Thread { source })?;
    let ran = runner.run(gpu.clone(), screen);
    // The watcher ends by its timeout even if the rig still runs.
    let Ok(result) = watcher.join() else {
        return Err(BenchError::Silent);
    };
    ran?;
    Ok(result)
}

/// Returns the status after the warm-up and after the measured pictures, and the time between them,
/// both at the start if there is no picture.
fn watch(status: &SharedStatus, frames: u64) -> (Snapshot, Snapshot, f64) {
    let warm_up = WARM_UP.min(frames);
    let timeout = |pictures: u64| {
        let each = TIMEOUT_PER_PICTURE.saturating_mul(u32::try_from(pictures).unwrap_or(u32::MAX));
        TIMEOUT_TO_START.saturating_add(each)
    };
    let mut before = wait_for_pictures(status, 1, TIMEOUT_TO_START);
    let mut after = before.clone();
    let mut begun = Instant::now();
    if before.frames.composed > 0 {
        before = wait_for_pictures(status, warm_up, timeout(warm_up));
        begun = Instant::now();
        after = wait_for_pictures(status, before.frames.composed + frames, timeout(frames));
    }
    (before, after, begun.elapsed().as_secs_f64())
}

/// Waits for a total number of pictures, or for the timeout, and returns the status.
fn wait_for_pictures(status: &SharedStatus, total: u64, timeout: Duration) -> Snapshot {
    wait_until(status, |s| s.frames.composed >= total, timeout)
}

/// Waits until the status is `as_wanted`, or for the timeout, and returns it.
fn wait_until(
    status: &SharedStatus,
    as_wanted: impl Fn(&Snapshot) -> bool,
    timeout: Duration,
) -> Snapshot {
    let begun = Instant::now();
    loop {
        let snapshot = status.snapshot();
        if as_wanted(&snapshot) || begun.elapsed() > timeout {
            return snapshot;
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Returns the row; `None` if no picture was composed.
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
        skipped: after.frames.skipped - before.frames.skipped,
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
             skipped in {:.1} s",
            self.case,
            self.width,
            self.height,
            self.lights,
            self.samples,
            self.max_wait_ms,
            self.frames_per_second,
            self.composed,
            self.skipped,
            self.seconds
        )?;
        let parts = [
            ("arrival to picture", self.arrival_to_picture_ms),
            ("decode", self.decode_ms),
            ("compose", self.total_ms),
            ("light, in parallel", self.light_ms),
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
