//! Runs a calibration step on the live rig: opens the configured devices, shows a progress bar and
//! the picture in a browser, and ends at Enter or Ctrl-C.

use crate::cli::progress::Progress as Line;
use crate::cli::show::{address, status_server};
use anyhow::bail;
use clap::Args;
use penumbra_calibration::step::{CalibrationProvenance, Finished, Step};
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_rig::calibration_runner::live::{EndReason, LiveFeed, StepRequest, StepUpdate};
use penumbra_rig::calibration_runner::steps::step_title;
use penumbra_rig::calibration_runner::{CalibrationMonitor, devices};
use penumbra_rig::service::Service;
use penumbra_rig::{Live, live_settings};
use penumbra_status::snapshot::SessionState;
use penumbra_status::{SharedStatus, StatusServer};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Interval at which signals and keys are checked.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);
/// Exit status by convention after Ctrl-C.
const INTERRUPTED: i32 = 130;

#[derive(Clone, Debug, Default, Args)]
pub struct LiveArgs {
    /// Live: stop after SECONDS; without it when the data suffice, at Enter or at Ctrl-C
    #[arg(long, value_name = "SECONDS", value_parser = seconds, conflicts_with = "session")]
    seconds: Option<f64>,
    /// Live: address of the status page with the picture; port 0 takes any free port
    #[arg(long, value_name = "ADDR:PORT", conflicts_with = "session")]
    listen: Option<SocketAddr>,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|s| (1.0..=7200.0).contains(s));
    seconds.ok_or_else(|| "expected a number of seconds from 1 to 7200".to_owned())
}

/// Events that end a step.
#[derive(Clone, Default)]
struct EndSignals {
    /// SIGINT or SIGTERM has come.
    signal: Arc<AtomicBool>,
    /// Enter was pressed.
    entered: Arc<AtomicBool>,
}

impl EndSignals {
    /// Returns whether an end was requested since the last call.
    fn take(&self) -> bool {
        let take_flag = |flag: &AtomicBool| flag.swap(false, Ordering::Relaxed);
        take_flag(&self.signal) | take_flag(&self.entered)
    }

    /// Starts a thread that waits for Enter. The thread is not joined: only the end of the program
    /// interrupts its wait.
    fn listen_for_enter(&self) {
        let entered = Arc::clone(&self.entered);
        let _ = threads::spawn("enter", move || {
            let read = std::io::stdin().read_line(&mut String::new());
            // Zero bytes are the end of the input, not a pressed key.
            entered.store(read.is_ok_and(|bytes| bytes > 0), Ordering::Relaxed);
        });
    }
}

/// Runs `step` on the configured devices and returns its result. `device_note` is the name and the
/// serial number of the device as stated by the user.
pub fn run_step(
    step: &mut dyn Step,
    config: &Config,
    args: &LiveArgs,
    device_note: (Option<&String>, Option<&String>),
) -> anyhow::Result<Finished> {
    let mut config = config.clone();
    config.status.listen = args.listen.unwrap_or(config.status.listen);
    let live = Live::new(&config, false)?;
    let wants = step.inputs();
    if let Some(reason) = devices::missing_device(&wants, &live.devices) {
        bail!("{reason}");
    }
    let monitor = CalibrationMonitor::new(Vec::new());
    monitor.begin(step.name(), step_title(step.name()), BTreeMap::new());
    let server = server(&config, args, &monitor)?;
    let address = address(server.as_ref(), &config);
    let signals = EndSignals::default();
    let service = Service::start(server, signals.signal.clone())?;
    address.into_iter().for_each(crate::cli::say);
    signals.listen_for_enter();
    live.open()?;
    let reason = observe(step, &config, args, (&live, &monitor, &signals));
    if reason == EndReason::Aborted {
        bail!("aborted; nothing was written");
    }
    let devices = live.supervised();
    if let Some(problem) = devices::device_problem(&wants, devices)
        && devices.iter().all(|d| d.status().received == 0)
    {
        bail!("no data: {problem}");
    }
    monitor.set_evaluating();
    let provenance = devices::provenance(&wants, devices);
    let provenance = CalibrationProvenance {
        device: device_note.0.cloned().or(provenance.device),
        serial: device_note.1.cloned().or(provenance.serial),
        ..provenance
    };
    let found = evaluate(step, &provenance, &signals)?;
    drop((live, service));
    Ok(found)
}

/// Starts the status page, which shows the picture. A port in use is an error only if the user has
/// named it.
fn server(
    config: &Config,
    args: &LiveArgs,
    monitor: &Arc<CalibrationMonitor>,
) -> anyhow::Result<Option<StatusServer>> {
    let status = SharedStatus::new(live_settings(config));
    status.set_calibrator(monitor.clone());
    status.update(|s| {
        "calibration".clone_into(&mut s.session.name);
        s.session.state = SessionState::Live;
        "A calibration step is running; pictures are not composited."
            .clone_into(&mut s.session.description);
    });
    match status_server(config, &status) {
        Ok(server) => Ok(Some(server)),
        Err(error) if args.listen.is_none() => {
            crate::cli::warn(format_args!("no status page: {error}"));
            Ok(None)
        }
        Err(error) => Err(error.into()),
    }
}

/// Passes the live data to the step until it ends.
fn observe(
    step: &mut dyn Step,
    config: &Config,
    args: &LiveArgs,
    (live, monitor, signals): (&Live, &CalibrationMonitor, &EndSignals),
) -> EndReason {
    let tracker = live.contents.files.document(config).ok();
    let tracker = tracker.and_then(|rig| rig.calibration.tracker);
    let wants = step.inputs();
    let line = Line::new(step.name());
    if std::io::stderr().is_terminal() {
        crate::cli::say("Enter or Ctrl-C finishes the step; Ctrl-C again aborts");
    }
    let feed = LiveFeed {
        hub: &live.hub,
        config,
        metres_per_unit: tracker.map(|t| t.metres_per_unit),
        time_limit: args.seconds.map(Duration::from_secs_f64),
    };
    let reason = feed.run(step, &mut |update| {
        let problem = devices::device_problem(&wants, live.supervised());
        show_update(&line, update, problem.as_deref());
        match monitor.update(update, problem) {
            StepRequest::Continue if signals.take() => StepRequest::Finish,
            request => request,
        }
    });
    line.finish();
    reason
}

/// Shows the progress, and the problem of a device or else the step's hint.
fn show_update(line: &Line, update: &StepUpdate, problem: Option<&str>) {
    let progress = update.progress;
    let advice = problem.unwrap_or(&progress.hint);
    let parts = [progress.message.as_str(), advice];
    let parts: Vec<&str> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    line.show(progress.share, &parts.join("; "));
}

/// Evaluates the step. A signal meanwhile ends the program: nothing has been written yet, and the
/// evaluation cannot be interrupted.
fn evaluate(
    step: &mut dyn Step,
    provenance: &CalibrationProvenance,
    signals: &EndSignals,
) -> anyhow::Result<Finished> {
    let done = Arc::new(AtomicBool::new(false));
    let (is_done, signal) = (Arc::clone(&done), Arc::clone(&signals.signal));
    let watcher = threads::spawn("abort", move || {
        while !is_done.load(Ordering::Relaxed) {
            if signal.load(Ordering::Relaxed) {
                crate::cli::complain(&anyhow::anyhow!("aborted; nothing was written"));
                exit_interrupted();
            }
            std::thread::sleep(CHECK_INTERVAL);
        }
    })?;
    let found = step.finish(provenance);
    done.store(true, Ordering::Relaxed);
    let _ = watcher.join();
    Ok(found)
}

#[expect(
    clippy::disallowed_methods,
    reason = "no file is open, and the step's thread cannot be interrupted"
)]
fn exit_interrupted() {
    std::process::exit(INTERRUPTED);
}
