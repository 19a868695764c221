//! `penumbra replay`.

use super::show::{ShowArgs, address, in_words, set, show, status_server};
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
    /// Repeat the recording
    #[arg(long = "loop")]
    repeat: bool,
    /// How long pictures wait for matching readings
    #[arg(long, value_enum)]
    pairing: Option<ReplayPairing>,
}

impl ReplayArgs {
    /// The configuration with what was typed.
    fn config(&self) -> anyhow::Result<Config> {
        let mut config = self.show.config()?;
        set(&mut config.replay.speed, self.speed);
        set(&mut config.replay.pairing, self.pairing);
        config.replay.repeat |= self.repeat;
        Ok(config)
    }

    /// Whether a taken port ends the program. It does where somebody will look at the
    /// page: an address was asked for, or the recording plays at a pace for people. Several
    /// replays that write files at full speed may run side by side.
    fn needs_status(&self, config: &Config) -> bool {
        let asked = self.show.listen.is_some() || self.show.config.is_some();
        asked || config.replay.speed != ReplaySpeed::Max
    }
}

/// Checks everything before the first frame, plays, reports.
pub fn run(args: ReplayArgs) -> anyhow::Result<ExitCode> {
    let config = args.config()?;
    let report_file = args.show.report_file()?;
    let session = open(&args)?;
    let status = SharedStatus::new(live_settings(&config));
    let server = server(&args, &config, &status)?;
    let shutdown = Arc::new(AtomicBool::new(false));
    let source = Source::Recorded(session);
    let name = source.name();
    let options = args.show.options();
    let runner = Runner::new(source, config.clone(), options, status, shutdown.clone())?;
    let address = address(server.as_ref(), &config);
    let service = Service::start(server, shutdown.clone())?;
    let report = show(runner, config, &name, (address, shutdown))?;
    drop(service);
    if let Some(file) = report_file {
        file.write(&report)?;
    }
    super::say(in_words(&report));
    Ok(ExitCode::SUCCESS)
}

/// Opens the session and says what is missing from it.
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
        Err(error @ StatusError::PortInUse { .. }) if !args.needs_status(config) => {
            super::warn(format_args!("no status page: {error}"));
            Ok(None)
        }
        Err(error) => Err(error),
    }
}
