//! Runs a calibration step on the live rig: opens the configured devices, shows a progress bar and
//! the picture in a browser, and ends at Enter or Ctrl-C.

use super::from::progress_bar;
use crate::cli::show::{address, status_server};
use anyhow::bail;
use clap::Args;
use indicatif::ProgressBar;
use penumbra_calibration::step::{Finished, Made, Step};
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_rig::calibration_runner::live::{EndedBy, LiveShow, Moment, Wish};
use penumbra_rig::calibration_runner::steps::title_of;
use penumbra_rig::calibration_runner::{Showcase, devices};
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
const POLL_INTERVAL: Duration = Duration::from_millis(50);
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
struct Ends {
    /// SIGINT or SIGTERM was received.
    signal: Arc<AtomicBool>,
    /// Enter was pressed.
    entered: Arc<AtomicBool>,
}

impl Ends {
    /// Whether an end was requested since the last call.
    fn take_request(&self) -> bool {
        let take = |flag: &AtomicBool| flag.swap(false, Ordering::Relaxed);
        take(&self.signal) | take(&self.entered)
    }

    /// Starts a thread that waits for Enter. It is not joined, as only the end of the program
    /// interrupts reading a key.
    fn listen_for_enter(&self) {
        let entered = Arc::clone(&self.entered);
        let _ = threads::spawn("enter", move || {
            let read = std::io::stdin().read_line(&mut String::new());
            // No bytes mean the end of the input, not a pressed key.
            entered.store(read.is_ok_and(|bytes| bytes > 0), Ordering::Relaxed);
        });
    }
}

/// Runs `step` on the data of the configured devices and returns its result. `noted` holds the
/// device name and serial number from the command line.
pub fn carry_out(
    step: &mut dyn Step,
    config: &Config,
    args: &LiveArgs,
    noted: (Option<&String>, Option<&String>),
) -> anyhow::Result<Finished> {
    let mut config = config.clone();
    config.status.listen = args.listen.unwrap_or(config.status.listen);
    let live = Live::new(&config, false)?;
    let wants = step.wants();
    if let Some(reason) = devices::lacking(&wants, &live.devices) {
        bail!("{reason}");
    }
    let showcase = Showcase::new(Vec::new());
    showcase.begin(step.name(), title_of(step.name()), BTreeMap::new());
    let server = server(&config, args, &showcase)?;
    let address = address(server.as_ref(), &config);
    let ends = Ends::default();
    let service = Service::start(server, ends.signal.clone())?;
    address.into_iter().for_each(crate::cli::say);
    ends.listen_for_enter();
    live.open()?;
    let ended = show(step, &config, args, (&live, &showcase, &ends));
    if ended == EndedBy::Aborted {
        bail!("aborted; nothing was written");
    }
    let devices = live.supervised();
    if let Some(trouble) = devices::trouble(&wants, devices)
        && devices.iter().all(|d| d.status().received == 0)
    {
        bail!("no data: {trouble}");
    }
    showcase.evaluate();
    let made = devices::made(&wants, devices);
    let made = Made {
        device: noted.0.cloned().or(made.device),
        serial: noted.1.cloned().or(made.serial),
        ..made
    };
    let found = evaluate(step, &made, &ends)?;
    drop((live, service));
    Ok(found)
}

/// Starts the status page, which shows the picture. A port in use is an error only if --listen was
/// given.
fn server(
    config: &Config,
    args: &LiveArgs,
    showcase: &Arc<Showcase>,
) -> anyhow::Result<Option<StatusServer>> {
    let status = SharedStatus::new(live_settings(config));
    status.set_calibrator(showcase.clone());
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

fn show(
    step: &mut dyn Step,
    config: &Config,
    args: &LiveArgs,
    (live, showcase, ends): (&Live, &Showcase, &Ends),
) -> EndedBy {
    let tracker = live.files.document(config).ok();
    let tracker = tracker.and_then(|rig| rig.calibration.tracker);
    let wants = step.wants();
    let bar = progress_bar();
    if std::io::stderr().is_terminal() {
        crate::cli::say("Enter or Ctrl-C finishes the step; Ctrl-C again aborts");
    }
    let shown = LiveShow {
        hub: &live.hub,
        config,
        metres_per_unit: tracker.map(|t| t.metres_per_unit),
        longest: args.seconds.map(Duration::from_secs_f64),
    };
    let ended = shown.show(step, &mut |moment| {
        let trouble = devices::trouble(&wants, live.supervised());
        show_moment(&bar, moment, trouble.as_deref());
        match showcase.tell(moment, trouble) {
            Wish::GoOn if ends.take_request() => Wish::Finish,
            wish => wish,
        }
    });
    bar.finish_and_clear();
    ended
}

/// Shows progress on the bar, with the device's error or else the step's hint.
fn show_moment(bar: &ProgressBar, moment: &Moment, trouble: Option<&str>) {
    let progress = moment.progress;
    bar.set_position((1000.0 * progress.share) as u64);
    let next = trouble.unwrap_or(&progress.hint);
    let parts = [progress.message.as_str(), next];
    let shown: Vec<&str> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    bar.set_message(shown.join("; "));
}

/// Evaluates the step. A signal during the evaluation ends the program, because the evaluation
/// cannot be interrupted; nothing has been written by then.
fn evaluate(step: &mut dyn Step, made: &Made, ends: &Ends) -> anyhow::Result<Finished> {
    let done = Arc::new(AtomicBool::new(false));
    let (watched, signal) = (Arc::clone(&done), Arc::clone(&ends.signal));
    let watcher = threads::spawn("abort", move || {
        while !watched.load(Ordering::Relaxed) {
            if signal.load(Ordering::Relaxed) {
                crate::cli::complain(&anyhow::anyhow!("aborted; nothing was written"));
                leave();
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    })?;
    let found = step.finish(made);
    done.store(true, Ordering::Relaxed);
    let _ = watcher.join();
    Ok(found)
}

#[expect(
    clippy::disallowed_methods,
    reason = "no file is open, and the step's thread cannot be interrupted"
)]
fn leave() {
    std::process::exit(INTERRUPTED);
}
