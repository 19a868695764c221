//! The commands that only read: `info`, `check-config`, `doctor`.

use super::files::read_pdf;
use crate::doctor::{DoctorOptions, State, examine};
use clap::Args;
use penumbra_config::check_config as read_and_check;
use penumbra_rig::check::check_files;
use penumbra_session::{Session, describe};
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The recording
    #[arg(value_name = "SESSION.mcap")]
    session: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
pub struct CheckConfigArgs {
    /// The configuration
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Print every setting with the value in effect, as a configuration
    #[arg(long)]
    all: bool,
    /// Print the settings that it changes and those in effect as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Address of the status page to check
    #[arg(long, value_name = "ADDR:PORT")]
    listen: Option<SocketAddr>,
    /// Part of the graphics adapter's name, or its number
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// `penumbra info`.
pub fn info(args: &InfoArgs) -> anyhow::Result<ExitCode> {
    let session = Session::open(&args.session)?;
    if args.json {
        super::say(serde_json::to_string_pretty(&contents(&session)?)?);
    } else {
        super::say(describe(&session).trim_end());
    }
    Ok(ExitCode::SUCCESS)
}

/// Returns the contents of a session for scripts.
fn contents(session: &Session) -> anyhow::Result<Value> {
    let streams = session.streams()?;
    let start = streams.iter().map(|s| s.first).min().unwrap_or_default();
    let streams = streams.iter().map(|s| {
        json!({
            "topic": s.topic,
            "messages": s.messages,
            "bytes": s.bytes,
            "from_seconds": s.first.seconds_since(start),
            "to_seconds": s.last.seconds_since(start),
            "rate_hz": s.rate_hz,
            "gaps": s.gaps,
            "longest_interval_seconds": 1e-9 * s.longest_interval_nanos as f64,
            "lost": s.lost,
        })
    });
    let attachments = session.attachments().iter();
    let attachments = attachments.map(|a| json!({ "name": a.name, "bytes": a.data.len() }));
    Ok(json!({
        "file": session.path(),
        "bytes": session.file_len(),
        "streams": streams.collect::<Vec<_>>(),
        "tracker_protocol": session.tracker_protocol(),
        "attachments": attachments.collect::<Vec<_>>(),
        "truncated": session.truncated(),
        "damage": session.damage().iter().map(ToString::to_string).collect::<Vec<_>>(),
    }))
}

/// `penumbra check-config`.
pub fn check_config(args: &CheckConfigArgs) -> anyhow::Result<ExitCode> {
    let summary = read_and_check(&args.file)?;
    check_files(&summary.config)
        .map_err(|error| anyhow::anyhow!("{}: {error}", args.file.display()))?;
    if let Some(sheet) = &summary.config.status.guide {
        read_pdf(sheet).map_err(|error| anyhow::anyhow!("{}: {error}", args.file.display()))?;
    }
    if args.json {
        let all = json!({ "changed": summary.changed, "effective": summary.effective });
        super::say(serde_json::to_string_pretty(&all)?);
    } else if args.all {
        super::say(summary.effective.to_string().trim_end());
    } else {
        super::say(format_args!("{}: valid", args.file.display()));
        super::say(summary);
    }
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
    if args.json {
        super::say(serde_json::to_string_pretty(&report)?);
    } else {
        super::say(&report);
    }
    Ok(match report.state() {
        State::Fail => ExitCode::FAILURE,
        State::Ok | State::Warn => ExitCode::SUCCESS,
    })
}
