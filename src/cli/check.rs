//! The commands that only read: `info`, `check-config`, `doctor`.

use crate::doctor::{DoctorOptions, State, examine};
use clap::Args;
use penumbra_config::check_config as read_and_check;
use penumbra_rig::check::check_files;
use penumbra_session::{Session, describe};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The recording
    #[arg(value_name = "SESSION.mcap")]
    session: PathBuf,
}

#[derive(Debug, Args)]
pub struct CheckConfigArgs {
    /// The configuration
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Address of the status page to check
    #[arg(long, value_name = "ADDR:PORT")]
    listen: Option<SocketAddr>,
    /// Part of the graphics adapter's name, or its number
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

/// `penumbra info`.
pub fn info(args: &InfoArgs) -> anyhow::Result<ExitCode> {
    let session = Session::open(&args.session)?;
    super::say(describe(&session).trim_end());
    Ok(ExitCode::SUCCESS)
}

/// `penumbra check-config`.
pub fn check_config(args: &CheckConfigArgs) -> anyhow::Result<ExitCode> {
    let summary = read_and_check(&args.file)?;
    check_files(&summary.config)
        .map_err(|error| anyhow::anyhow!("{}: {error}", args.file.display()))?;
    super::say(format_args!("{}: valid", args.file.display()));
    super::say(summary);
    Ok(ExitCode::SUCCESS)
}

/// `penumbra doctor`. Fails if the program cannot work on this machine.
pub fn doctor(args: DoctorArgs) -> anyhow::Result<ExitCode> {
    let defaults = DoctorOptions::default();
    let report = examine(&DoctorOptions {
        listen: args.listen.unwrap_or(defaults.listen),
        adapter: args.adapter,
        ..defaults
    });
    super::say(&report);
    Ok(match report.state() {
        State::Fail => ExitCode::FAILURE,
        State::Ok | State::Warn => ExitCode::SUCCESS,
    })
}
