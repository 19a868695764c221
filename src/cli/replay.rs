//! `penumbra replay`.

use super::files::JsonFile;
use clap::Args;
use penumbra::calibration::EnvironmentSource;
use penumbra::compositor::Gpu;
use penumbra::config::{
    Config, LIGHT_COUNTS, LightPlacement, Monitor, ReplaySpeed, SceneChoice, ShadowMode,
};
use penumbra::output::window::{self, WindowOptions};
use penumbra::rig::replay::{Replay, live_settings};
use penumbra::rig::service::Service;
use penumbra::rig::{ReplayOptions, Report, RigError, replay};
use penumbra::session::Session;
use penumbra::status::{SharedStatus, StatusError, StatusServer, Technique};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// The recording
    #[arg(value_name = "SESSION.mcap")]
    session: PathBuf,
    /// Settings; what is typed here comes before what stands there
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Objects to composite: a scene file, "session" (those it brings) or "none"
    #[arg(long, value_name = "FILE|none")]
    scene: Option<String>,
    /// A factor of the recorded pace, or "max": as fast as frames are made, none left out
    #[arg(long, value_name = "FACTOR|max")]
    speed: Option<ReplaySpeed>,
    /// Begin again at the end
    #[arg(long = "loop")]
    repeat: bool,
    /// Stop after so many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Write every frame as a PNG named by its number in the recording
    #[arg(long, value_name = "DIR")]
    frames_out: Option<PathBuf>,
    /// Write at the end what happened: counts, times, white balance
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Write over files that are there
    #[arg(long)]
    force: bool,
    /// Show no window
    #[arg(long)]
    headless: bool,
    /// Show the window on this monitor: its number from 0, or part of its name
    #[arg(long, value_name = "MONITOR", conflicts_with = "headless")]
    monitor: Option<Monitor>,
    /// Let the picture fill the monitor (F in the window)
    #[arg(long, conflicts_with = "headless")]
    fullscreen: bool,
    /// Where the status page is; port 0 takes any free one
    #[arg(long, value_name = "ADDR:PORT")]
    listen: Option<SocketAddr>,
    /// What the status page asks its visitors for; needed where other machines reach it
    #[arg(long, value_name = "TOKEN")]
    token: Option<String>,
    /// Part of the graphics adapter's name, or its number
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// How the light is seen
    #[arg(long, value_enum)]
    environment_source: Option<EnvironmentSource>,
    /// How the dome lights are placed
    #[arg(long, value_enum)]
    lights: Option<LightPlacement>,
    /// How many dome lights there are at most: 0, 8, 24, 48, 64, 96 or 384
    #[arg(long, value_name = "N", value_parser = light_count)]
    light_count: Option<u32>,
    /// How shadows are put into the camera's picture
    #[arg(long, value_enum)]
    shadow_mode: Option<ShadowMode>,
    /// How virtual objects are lit and shadowed
    #[arg(long, value_enum)]
    technique: Option<Technique>,
}

fn light_count(text: &str) -> Result<u32, String> {
    let count = text.parse().ok().filter(|n| LIGHT_COUNTS.contains(n));
    count.ok_or_else(|| format!("expected one of {LIGHT_COUNTS:?}"))
}

impl ReplayArgs {
    /// The configuration with what was typed.
    fn config(&self) -> anyhow::Result<Config> {
        let mut config = match &self.config {
            Some(path) => Config::load(path)?,
            None => Config::default(),
        };
        self.override_picture(&mut config);
        self.override_outputs(&mut config);
        set(&mut config.replay.speed, self.speed);
        config.replay.repeat |= self.repeat;
        Ok(config)
    }

    fn override_picture(&self, config: &mut Config) {
        set(
            &mut config.scene,
            self.scene.as_deref().map(SceneChoice::from_text),
        );
        set(&mut config.environment.source, self.environment_source);
        set(&mut config.environment.lights, self.lights);
        set(&mut config.environment.light_count, self.light_count);
        set(&mut config.shadows.mode, self.shadow_mode);
        let shadows = self.technique.map(|t| t == Technique::ImageBasedShadowing);
        set(&mut config.shadows.enabled, shadows);
    }

    fn override_outputs(&self, config: &mut Config) {
        let asks_for_window = self.fullscreen || self.monitor.is_some();
        config.output.window = (config.output.window || asks_for_window) && !self.headless;
        config.output.fullscreen |= self.fullscreen;
        config.output.monitor = self.monitor.clone().or(config.output.monitor.take());
        config.output.frames = self.frames_out.clone().or(config.output.frames.take());
        set(&mut config.status.listen, self.listen);
        config.status.token = self.token.clone().or(config.status.token.take());
        config.gpu.adapter = self.adapter.clone().or(config.gpu.adapter.take());
    }

    /// Whether a taken port ends the program. It does where somebody will look at the
    /// page: an address was asked for, or the recording plays at a pace for people. Several
    /// replays that write files at full speed may run side by side.
    fn needs_status(&self, config: &Config) -> bool {
        self.listen.is_some() || self.config.is_some() || config.replay.speed != ReplaySpeed::Max
    }
}

fn set<T>(place: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *place = value;
    }
}

/// Checks everything before the first frame, plays, reports.
pub fn run(args: ReplayArgs) -> anyhow::Result<ExitCode> {
    let config = args.config()?;
    let report_file = args
        .report
        .as_deref()
        .map(|path| JsonFile::claim(path, args.force))
        .transpose()?;
    let session = open(&args)?;
    let status = SharedStatus::new(live_settings(&config));
    let server = status_server(&args, &config, &status)?;
    let shutdown = Arc::new(AtomicBool::new(false));
    let options = ReplayOptions {
        frame_limit: args.frames,
        force: args.force,
    };
    let replay = replay(session, config.clone(), options, status, shutdown.clone())?;
    let address = address(server.as_ref(), &config);
    let service = Service::start(server, shutdown.clone())?;
    let report = play(replay, config, &args, (address, shutdown))?;
    drop(service);
    if let Some(file) = report_file {
        file.write(&report)?;
    }
    super::say(in_words(&report));
    Ok(ExitCode::SUCCESS)
}

/// With a window or without. The address is told when nothing can keep the picture from
/// coming any more.
fn play(
    replay: Replay,
    config: Config,
    args: &ReplayArgs,
    (address, shutdown): (Option<String>, Arc<AtomicBool>),
) -> Result<Report, RigError> {
    let announce = move || address.into_iter().for_each(super::say);
    if !config.output.window {
        let gpu = Gpu::open(config.gpu.adapter.as_deref())?;
        announce();
        return replay.run(gpu, None);
    }
    let name = args
        .session
        .file_name()
        .unwrap_or_default()
        .to_string_lossy();
    let options = WindowOptions {
        title: format!("{name} – Penumbra"),
        monitor: config.output.monitor,
        fullscreen: config.output.fullscreen,
        picture: replay.picture_size(),
        adapter: config.gpu.adapter,
        shutdown,
    };
    window::run(options, move |gpu, screen| {
        announce();
        replay.run(gpu, Some(screen))
    })?
}

/// Opens the session and says what is missing from it.
fn open(args: &ReplayArgs) -> anyhow::Result<Session> {
    let session = Session::open(&args.session)?;
    if session.truncated() {
        super::warn(format_args!(
            "{}: the recording was cut off; what is whole is replayed",
            args.session.display()
        ));
    }
    for damage in session.damage() {
        super::warn(damage);
    }
    Ok(session)
}

fn status_server(
    args: &ReplayArgs,
    config: &Config,
    status: &Arc<SharedStatus>,
) -> Result<Option<StatusServer>, StatusError> {
    let wanted = &config.status;
    match StatusServer::bind(wanted.listen, wanted.token.clone(), status.clone()) {
        Ok(server) => Ok(Some(server)),
        Err(error @ StatusError::PortInUse { .. }) if !args.needs_status(config) => {
            super::warn(format_args!("no status page: {error}"));
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// The one address to open.
fn address(server: Option<&StatusServer>, config: &Config) -> Option<String> {
    let token = config.status.token.as_ref().map_or("", |_| "?token=…");
    Some(format!(
        "status page: http://{}/{token}",
        server?.local_addr()
    ))
}

fn in_words(report: &Report) -> String {
    let frames = &report.frames;
    format!(
        "{} frames composed, {} skipped, {} damaged, {} without pose; {:.1} s on {}",
        frames.composed,
        frames.skipped,
        frames.damaged,
        frames.without_pose,
        report.wall_seconds,
        report.adapter
    )
}
