//! `penumbra run`.

use super::show::{ShowArgs, address, describe, show, status_server};
use anyhow::bail;
use clap::Args;
use penumbra_rig::calibration_runner::Calibrator;
use penumbra_rig::service::Service;
use penumbra_rig::{Live, Recorder, Runner, Source, live_settings};
use penumbra_status::SharedStatus;
use penumbra_status::recording::RecordingState;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    pub show: ShowArgs,
    /// Also record all devices into this new session
    #[arg(long, value_name = "OUT.mcap")]
    record: Option<PathBuf>,
}

/// Checks the configuration and files, then runs the live rig until it is stopped.
pub fn run(args: &RunArgs) -> anyhow::Result<ExitCode> {
    let config = args.show.config()?;
    let report_file = args.show.report_file()?;
    let status = SharedStatus::new(live_settings(&config));
    super::page_log::set_page(&status);
    let server = status_server(&config, &status)?;
    let shutdown = Arc::new(AtomicBool::new(false));
    let live = Live::new(&config, true)?;
    let recorder = Recorder::new(
        live.hub.clone(),
        live.contents.clone(),
        config.recording.clone(),
        status.clone(),
    );
    if let Some(sheet) = &config.status.guide {
        status.set_sheet(super::files::read_pdf(sheet)?);
    }
    status.set_recorder(recorder.clone());
    status.set_calibrator(Calibrator::new(&live, &config));
    let options = args.show.options();
    let source = Source::Live(live);
    let runner = Runner::new(source, config.clone(), options, status, shutdown.clone())?;
    let address = address(Some(&server), &config);
    let service = Service::start(Some(server), shutdown.clone())?;
    if let Some(path) = &args.record {
        recorder.start(path, None, config.recording.composite)?;
    }
    let report = show(runner, config, "live", (address, shutdown))?;
    drop(service);
    let recording = recorder.stop();
    if let Some(recording) = &recording {
        super::say(super::record::describe(recording));
    }
    if let Some(file) = report_file {
        file.write(&report)?;
    }
    super::say(describe(&report));
    let failed = recording.filter(|r| args.record.is_some() && r.state == RecordingState::Failed);
    if let Some(recording) = failed {
        bail!("{}", recording.description);
    }
    Ok(ExitCode::SUCCESS)
}
