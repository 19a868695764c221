//! `penumbra record`.

use anyhow::{Context, bail};
use clap::Args;
use penumbra_capture::{DeviceReport, DeviceStatus};
use penumbra_config::Config;
use penumbra_interface::DeviceKind;
use penumbra_rig::service::Service;
use penumbra_rig::{Live, Recorder, live_settings};
use penumbra_status::SharedStatus;
use penumbra_status::recording::{Recording, RecordingRequest, RecordingState};
use serde_json::Value;
use std::io::{IsTerminal, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Interval at which the end of the recording is checked and its size printed.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Timeout for the response of the running rig.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(15);

#[derive(Debug, Args)]
pub struct RecordArgs {
    /// The session to write; with --while-running its name in the recording folder of the running rig
    #[arg(value_name = "OUT.mcap")]
    output: PathBuf,
    /// Configuration file: devices and calibration
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Stop after SECONDS; without it at Ctrl-C
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    duration: Option<f64>,
    /// Record with the `penumbra run` that is already running
    #[arg(long)]
    while_running: bool,
    /// Address of its status page
    #[arg(long, value_name = "ADDR:PORT", requires = "while_running")]
    listen: Option<SocketAddr>,
    /// Have the composited pictures recorded, too, as `[recording] composite` does
    #[arg(long, requires = "while_running")]
    composite: bool,
    /// Token of its status page
    #[arg(long, value_name = "TOKEN", requires = "while_running")]
    token: Option<String>,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|s| (1.0..=1e7).contains(s));
    seconds.ok_or_else(|| "expected a number of seconds from 1 to 10000000".to_owned())
}

/// Records until the requested duration has passed or a signal arrives.
pub fn run(args: &RecordArgs) -> anyhow::Result<ExitCode> {
    let config = match &args.config {
        Some(path) => Config::load(path)?,
        None => Config::default(),
    };
    if args.while_running {
        return record_on_running_rig(args, &config);
    }
    let status = SharedStatus::new(live_settings(&config));
    let live = Live::new(&config, false)?;
    // The recording would hold files that nobody can use.
    live.contents.files.document(&config)?;
    let (hub, contents) = (live.hub.clone(), live.contents.clone());
    let recorder = Recorder::new(hub, contents, config.recording, status.clone());
    let shutdown = Arc::new(AtomicBool::new(false));
    let service = Service::start(None, shutdown.clone())?;
    let duration = args.duration.map(Duration::from_secs_f64);
    // Nothing is composed here, so there are no composited pictures.
    recorder.start(&args.output, duration, false)?;
    live.open()?;
    while recorder.is_recording() && !shutdown.load(Ordering::Relaxed) {
        std::thread::sleep(POLL_INTERVAL);
        print_progress(&status.snapshot().recording);
    }
    let recording = recorder.stop();
    let mut reports = Vec::new();
    for device in live.supervised() {
        let status = device.status();
        match &status.reason {
            Some(trouble) if status.received == 0 => super::warn(format_args!(
                "no data from {}: {trouble}",
                device.kind.label()
            )),
            _ => reports.push(describe_device(device.kind, &status)),
        }
    }
    drop((live, service));
    let Some(recording) = recording else {
        bail!(
            "{}: the recorder stopped unexpectedly",
            args.output.display()
        );
    };
    if recording.state == RecordingState::Failed {
        bail!("{}", recording.description);
    }
    super::say(describe(&recording));
    reports.iter().for_each(super::say);
    Ok(ExitCode::SUCCESS)
}

/// Describes the data that a device delivered, and its errors.
fn describe_device(kind: DeviceKind, status: &DeviceStatus) -> String {
    let mut words = vec![format!("{} delivered", status.received)];
    let mut count = |n: u64, what: &str| {
        if n > 0 {
            words.push(format!("{n} {what}"));
        }
    };
    count(status.losses, "disconnections");
    let identity = match &status.report {
        DeviceReport::None => "",
        DeviceReport::Tracker(report) => &report.identity,
        DeviceReport::Camera(report) => {
            let counters = report.counters;
            count(counters.lost, "lost");
            count(counters.damaged.max(status.damaged), "damaged");
            count(counters.superseded, "replaced by newer ones");
            count(counters.unattributed, "of unknown exposure");
            count(
                counters.controls_changed,
                "controls changed by other programs",
            );
            words.extend(report.notes.iter().cloned());
            &report.identity
        }
    };
    format!("  {} {identity}: {}", kind.label(), words.join(", "))
}

/// Prints a progress line that overwrites the previous one, on terminals only.
fn print_progress(recording: &Recording) {
    let mut err = std::io::stderr();
    if err.is_terminal() {
        let left = recording
            .seconds_left
            .map_or(String::new(), |s| format!(", {s:.0} s left"));
        let megabytes = recording.bytes as f64 * 1e-6;
        let _ = write!(
            err,
            "\r{megabytes:.1} MB, {:.0} s{left}   ",
            recording.seconds
        );
    }
}

/// Describes the result of a recording.
pub fn describe(recording: &Recording) -> String {
    let dropped = match recording.dropped {
        0 => String::new(),
        n => format!(", {n} DROPPED (the disk was too slow)"),
    };
    format!(
        "{}: {:.1} MB, {:.1} s, {} messages{dropped}",
        recording.file.as_deref().unwrap_or_default(),
        recording.bytes as f64 * 1e-6,
        recording.seconds,
        recording.events
    )
}

/// Requests the recording from a running `penumbra run` over HTTP.
fn record_on_running_rig(args: &RecordArgs, config: &Config) -> anyhow::Result<ExitCode> {
    let name = args
        .output
        .file_name()
        .filter(|n| Path::new(n) == args.output);
    let Some(name) = name.and_then(|n| n.to_str()) else {
        bail!(
            "{}: the running rig records into its own folder ([recording] folder); give a plain \
             name such as desk.mcap",
            args.output.display()
        );
    };
    let request = RecordingRequest {
        record: true,
        file: Some(name.to_owned()),
        seconds: args.duration,
        composite: args.composite.then_some(true),
    };
    let address = args.listen.unwrap_or(config.status.listen);
    let token = args.token.as_ref().or(config.status.token.as_ref());
    let answer = post(address, token, &serde_json::to_string(&request)?)?;
    let file = answer["file"].as_str().unwrap_or(name).to_owned();
    super::say(format_args!("{file}: being recorded by the running rig"));
    if args.duration.is_some() {
        return Ok(ExitCode::SUCCESS);
    }
    wait_for_signal()?;
    let answer = post(address, token, r#"{"record": false}"#)?;
    let description = answer["description"].as_str().unwrap_or_default();
    super::say(format_args!("{file}: {description}"));
    Ok(ExitCode::SUCCESS)
}

fn wait_for_signal() -> anyhow::Result<()> {
    let shutdown = Arc::new(AtomicBool::new(false));
    let _service = Service::start(None, shutdown.clone())?;
    while !shutdown.load(Ordering::Relaxed) {
        std::thread::sleep(POLL_INTERVAL);
    }
    Ok(())
}

/// Sends one request to a status page; returns the JSON of the response.
fn post(address: SocketAddr, token: Option<&String>, body: &str) -> anyhow::Result<Value> {
    let no_answer = || {
        format!(
            "{address}: no `penumbra run` answers there; start it, or name its address with --listen"
        )
    };
    let mut stream =
        TcpStream::connect_timeout(&address, RESPONSE_TIMEOUT).with_context(no_answer)?;
    stream.set_read_timeout(Some(RESPONSE_TIMEOUT))?;
    let token = token.map_or(String::new(), |t| format!("Authorization: Bearer {t}\r\n"));
    write!(
        stream,
        "POST /recording HTTP/1.1\r\nHost: {address}\r\n{token}Content-Type: application/json\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )?;
    let mut answer = String::new();
    stream
        .take(1 << 20)
        .read_to_string(&mut answer)
        .with_context(no_answer)?;
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    let json: Value = serde_json::from_str(body).unwrap_or_default();
    if head.starts_with("HTTP/1.1 2") {
        return Ok(json);
    }
    match json["error"].as_str() {
        Some(error) => bail!("{address}: {error}"),
        None => bail!(
            "{address}: {}",
            if body.is_empty() { head } else { body }.trim()
        ),
    }
}
