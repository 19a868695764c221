//! `penumbra replay`.

use super::progress::Watch;
use super::show::{ShowArgs, address, describe, set, show, status_server, warn_of_pictures};
use clap::Args;
use penumbra_config::{Config, ReplayPairing, ReplaySpeed};
use penumbra_rig::service::Service;
use penumbra_rig::{Runner, Source, live_settings};
use penumbra_session::Session;
use penumbra_status::{SharedStatus, StatusError, StatusServer};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// The recording
    #[arg(value_name = "SESSION.mcap")]
    session: PathBuf,
    #[command(flatten)]
    show: ShowArgs,
    /// Factor of the recorded speed, or "max": as fast as possible without skipping frames
    #[arg(long, value_name = "FACTOR|max")]
    speed: Option<ReplaySpeed>,
    /// With --frames-out, write what a viewer sees: no frame that comes too late, each in the light
    /// that is known by then
    #[arg(long, requires = "frames_out")]
    as_shown: bool,
    /// Repeat the recording
    #[arg(long = "loop")]
    repeat: bool,
    /// How long pictures wait for matching readings
    #[arg(long, value_enum)]
    pairing: Option<ReplayPairing>,
}

impl ReplayArgs {
    /// Returns the configuration with the options of the command line applied.
    fn config(&self) -> anyhow::Result<Config> {
        let mut config = self.show.config()?;
        set(&mut config.replay.speed, self.speed);
        set(&mut config.replay.pairing, self.pairing);
        config.replay.repeat |= self.repeat;
        config.output.as_shown = self.as_shown;
        Ok(config)
    }

    /// Whether a port in use ends the program: if an address or a configuration was given, or if the
    /// recording does not play at full speed. Replays that write files at full speed may run side by
    /// side without a status page.
    fn requires_status_page(&self, config: &Config) -> bool {
        let is_configured = self.show.listen.is_some() || self.show.config.is_some();
        is_configured || config.replay.speed != ReplaySpeed::Max
    }
}

/// Checks all inputs, plays the recording and prints a summary.
pub fn run(args: ReplayArgs) -> anyhow::Result<ExitCode> {
    let config = args.config()?;
    let report_file = args.show.report_file()?;
    let session = open(&args)?;
    let status = SharedStatus::new(live_settings(&config));
    super::page_log::set_page(&status);
    let server = server(&args, &config, &status)?;
    let shutdown = Arc::new(AtomicBool::new(false));
    let source = Source::Recorded(session);
    let name = source.name();
    let options = args.show.options();
    let watch = watch(&args, &config, &status)?;
    let runner = Runner::new(source, config.clone(), options, status, shutdown.clone())?;
    let address = address(server.as_ref(), &config);
    let service = Service::start(server, shutdown.clone())?;
    let report = show(runner, config, &name, (address, shutdown))?;
    drop((service, watch));
    if let Some(file) = report_file {
        file.write(&report)?;
    }
    warn_of_pictures(&report);
    super::say(describe(&report));
    Ok(ExitCode::SUCCESS)
}

/// Shows the progress of a replay that nobody watches: once, without a window.
fn watch(
    args: &ReplayArgs,
    config: &Config,
    status: &Arc<SharedStatus>,
) -> anyhow::Result<Option<Watch>> {
    if config.replay.repeat || config.output.window {
        return Ok(None);
    }
    let (status, limit) = (Arc::clone(status), args.show.frame_limit());
    let watch = Watch::start("replay", move || {
        let snapshot = status.snapshot();
        let composed = snapshot.frames.composed as f64;
        let by_limit = limit.map(|limit| composed / limit as f64);
        let by_time = snapshot.session.progress;
        by_limit.into_iter().chain(by_time).reduce(f64::max)
    });
    Ok(Some(watch?))
}

/// Opens the session and warns about missing or damaged parts.
fn open(args: &ReplayArgs) -> anyhow::Result<Session> {
    let session = Session::open(&args.session)?;
    if session.truncated() {
        super::warn(format_args!(
            "{}: the recording was cut off; complete chunks are replayed",
            args.session.display()
        ));
    }
    for damage in session.damage() {
        super::warn(damage);
    }
    Ok(session)
}

fn server(
    args: &ReplayArgs,
    config: &Config,
    status: &Arc<SharedStatus>,
) -> Result<Option<StatusServer>, StatusError> {
    match status_server(config, status) {
        Ok(server) => Ok(Some(server)),
        Err(error @ StatusError::PortInUse { .. }) if !args.requires_status_page(config) => {
            super::warn(format_args!("no status page: {error}"));
            Ok(None)
        }
        Err(error) => Err(error),
    }
}
