//! Options that `penumbra replay` and `penumbra run` share: compositing and output.

use super::files::JsonFile;
use clap::Args;
use penumbra_compositor::Gpu;
use penumbra_config::{
    Config, ExposureChoice, LIGHT_COUNTS, LampResponse, LightPlacement, Monitor, PoseSource,
    Quality, ShadowMode, Technique,
};
use penumbra_lighting::Filtering;
use penumbra_output::window;
use penumbra_output::window::WindowOptions;
use penumbra_rig::{Report, RigError, RunOptions, Runner};
use penumbra_rig_model::EnvironmentSource;
use penumbra_scene::Highlights;
use penumbra_scene::SceneChoice;
use penumbra_status::{SharedStatus, StatusError, StatusServer, StreamLimits};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Configuration file; options on the command line override it
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Virtual objects: a scene file, "session" (those of the recording) or "none"
    #[arg(long, value_name = "FILE|none")]
    scene: Option<String>,
    /// Stop after N frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Write every frame as a PNG, named by its number
    #[arg(long, value_name = "DIR")]
    frames_out: Option<PathBuf>,
    /// Write the camera's pose for each picture, its source and its standard deviation
    #[arg(long, value_name = "FILE.csv")]
    poses_out: Option<PathBuf>,
    /// Write a report at the end: counts, times, white balance
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
    /// Show no window
    #[arg(long)]
    headless: bool,
    /// Show the window on this monitor: its number from 0, or part of its name
    #[arg(long, value_name = "MONITOR", conflicts_with = "headless")]
    monitor: Option<Monitor>,
    /// Fill the monitor (F in the window)
    #[arg(long, conflicts_with = "headless")]
    fullscreen: bool,
    /// Address of the status page; port 0 takes any free port
    #[arg(long, value_name = "ADDR:PORT")]
    pub listen: Option<SocketAddr>,
    /// Token that the status page requires; needed for addresses other than loopback
    #[arg(long, value_name = "TOKEN")]
    token: Option<String>,
    /// Part of the graphics adapter's name, or its number
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// "live": the picture that a running rig shows on this adapter; "best": every picture takes the
    /// time that it needs
    #[arg(long, value_enum)]
    quality: Option<Quality>,
    /// Source of the environment light
    #[arg(long, value_enum)]
    environment_source: Option<EnvironmentSource>,
    /// How the dome lights are placed
    #[arg(long, value_enum)]
    light_placement: Option<LightPlacement>,
    /// Maximum number of dome lights: 0, 8, 24, 48, 64, 96 or 384
    #[arg(long, value_name = "N", value_parser = light_count)]
    light_count: Option<u32>,
    /// How shadows change the camera's picture
    #[arg(long, value_enum)]
    shadow_mode: Option<ShadowMode>,
    /// How the environment is filtered for reflections on virtual objects
    #[arg(long, value_enum)]
    reflections: Option<Filtering>,
    /// How real surfaces respond to virtual lamps
    #[arg(long, value_enum)]
    lamp_response: Option<LampResponse>,
    /// How virtual objects are lit and shadowed
    #[arg(long, value_enum)]
    technique: Option<Technique>,
    /// Exposure of the output: "off" (the camera's), "auto", or stops relative to the camera's,
    /// from -8 to 3
    #[arg(long, value_name = "off|auto|STOPS", allow_hyphen_values = true)]
    exposure: Option<ExposureChoice>,
    /// How clipped areas appear in a shorter exposure
    #[arg(long, value_enum)]
    highlights: Option<Highlights>,
}

fn light_count(text: &str) -> Result<u32, String> {
    let count = text.parse().ok().filter(|n| LIGHT_COUNTS.contains(n));
    count.ok_or_else(|| format!("expected one of {LIGHT_COUNTS:?}"))
}

impl ShowArgs {
    /// Returns the configuration with the options of the command line applied.
    pub fn config(&self) -> anyhow::Result<Config> {
        let mut config = match &self.config {
            Some(path) => Config::load(path)?,
            None => Config::default(),
        };
        self.override_picture(&mut config);
        self.override_outputs(&mut config);
        Ok(config)
    }

    fn override_picture(&self, config: &mut Config) {
        set(
            &mut config.scene,
            self.scene.as_deref().map(SceneChoice::from_text),
        );
        set(&mut config.picture.quality, self.quality);
        set(&mut config.environment.source, self.environment_source);
        set(
            &mut config.environment.light_placement,
            self.light_placement,
        );
        set(&mut config.environment.light_count, self.light_count);
        set(&mut config.shadows.mode, self.shadow_mode);
        if let Some(choice) = self.exposure {
            config.exposure.choose(choice);
        }
        set(&mut config.exposure.highlights, self.highlights);
        set(&mut config.shading.reflections, self.reflections);
        set(&mut config.shading.lamp_response, self.lamp_response);
        set(&mut config.shadows.technique, self.technique);
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

    /// Returns the number of frames after which to stop.
    pub const fn frame_limit(&self) -> Option<u64> {
        self.frames
    }

    /// Returns the options that are not part of the configuration.
    pub fn options(&self) -> RunOptions {
        RunOptions {
            frame_limit: self.frames,
            force: self.force,
            poses: self.poses_out.clone(),
        }
    }

    /// Claims the file of the report, if one was requested.
    pub fn report_file(&self) -> anyhow::Result<Option<JsonFile>> {
        let claim = |path: &PathBuf| JsonFile::claim(path, self.force);
        self.report.as_ref().map(claim).transpose()
    }
}

/// Replaces `target` if there is a `value`.
pub fn set<T>(target: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *target = value;
    }
}

/// Runs the rig with or without a window. The address is printed once the GPU is open.
pub fn show(
    runner: Runner,
    config: Config,
    name: &str,
    (address, shutdown): (Option<String>, Arc<AtomicBool>),
) -> Result<Report, RigError> {
    let announce = move || address.into_iter().for_each(super::say);
    if !config.output.window {
        let gpu = Gpu::open(config.gpu.adapter.as_deref())?;
        announce();
        return runner.run(gpu, None);
    }
    let options = WindowOptions {
        title: format!("{name} – Penumbra"),
        monitor: config.output.monitor,
        fullscreen: config.output.fullscreen,
        picture: runner.picture_size(),
        adapter: config.gpu.adapter,
        shutdown,
    };
    window::run(options, move |gpu, screen| {
        announce();
        runner.run(gpu, Some(screen))
    })?
}

/// Binds the port of the status page.
pub fn status_server(
    config: &Config,
    status: &Arc<SharedStatus>,
) -> Result<StatusServer, StatusError> {
    let settings = &config.status;
    let limits = StreamLimits::from(settings);
    StatusServer::bind_with(
        settings.listen,
        settings.token.clone(),
        status.clone(),
        limits,
    )
}

/// Returns the line that names the address of the status page.
pub fn address(server: Option<&StatusServer>, config: &Config) -> Option<String> {
    let token = config.status.token.as_ref().map_or("", |_| "?token=…");
    Some(format!(
        "status page: http://{}/{token}",
        server?.local_addr()
    ))
}

/// Warns of pictures with problems.
pub fn warn_of_pictures(report: &Report) {
    for problem in &report.picture_problems {
        super::warn(format_args!(
            "{} ({} pictures, from {:.3} s to {:.3} s)",
            problem.description, problem.pictures, problem.first_seconds, problem.last_seconds
        ));
    }
}

/// Describes the result of a run in one line.
pub fn describe(report: &Report) -> String {
    let frames = &report.frames;
    let lost = match frames.lost {
        0 => String::new(),
        lost => format!("{lost} lost in damaged parts of the file, "),
    };
    let reason = match frames.without_pose {
        0 => "",
        _ => why_without_pose(report.pose, report.inputs.poses),
    };
    format!(
        "{} frames composed, {} skipped, {} damaged, {lost}{} without pose{reason}; {:.1} s on {}",
        frames.composed,
        frames.skipped,
        frames.damaged,
        frames.without_pose,
        report.wall_seconds,
        report.adapter
    )
}

/// Returns why pictures have no pose; `readings` of the tracker arrived.
const fn why_without_pose(source: PoseSource, readings: u64) -> &'static str {
    match (source, readings) {
        (PoseSource::Markers, _) => " (no marker was recognised in them)",
        (PoseSource::Hybrid, 0) => {
            " (no marker was recognised in them, and the tracker sent no readings)"
        }
        (_, 0) => " (the tracker sent no readings)",
        _ => " (no reading of the tracker at their time)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_poses_are_put_down_to_what_gives_the_pose() {
        assert!(!why_without_pose(PoseSource::Markers, 0).contains("tracker"));
        assert!(why_without_pose(PoseSource::Hybrid, 0).contains("no marker"));
        assert!(why_without_pose(PoseSource::Tracker, 0).contains("sent no readings"));
        assert!(why_without_pose(PoseSource::Hybrid, 9).contains("at their time"));
    }
}
