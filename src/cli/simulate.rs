//! `penumbra simulate`.

use crate::cli::files::{JsonFile, claim};
use crate::cli::progress::Progress;
use anyhow::anyhow;
use clap::{Args, Subcommand};
use penumbra_calibration::simulation::{SimulatedRig, SimulationOptions};
use penumbra_rig::calibration_runner::record_simulation;
use penumbra_rig::simulate::{SimulateOptions, SimulatedPlace, SimulatedSource, simulate};
use penumbra_synthetic::Faults;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct SimulateArgs {
    #[command(subcommand)]
    device: SimulatedDevice,
}

#[derive(Debug, Subcommand)]
enum SimulatedDevice {
    /// Simulate a tracker that answers commands and streams like the real one, until Ctrl-C
    Tracker(TrackerArgs),
    /// Simulate a complete rig before tags or a board: a recording to try `calibrate` on, with its
    /// ground truth
    Session(Box<SessionArgs>),
}

#[derive(Debug, Args)]
struct SessionArgs {
    #[command(flatten)]
    rig: SimulationOptions,
    /// The recording
    #[arg(long, value_name = "SESSION.mcap")]
    out: PathBuf,
    /// Ground truth of the rig: mounting, latency, tags, the pose of every picture
    #[arg(long, value_name = "FILE.json")]
    truth: Option<PathBuf>,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Args)]
struct TrackerArgs {
    /// Protocol: fastrak, liberty, patriot, flock, freed or csv; by default that of the session
    #[arg(long, value_name = "NAME")]
    protocol: Option<String>,
    /// Serve a pseudo-terminal, whose path is printed and, if given, linked to from LINK
    #[arg(long, value_name = "LINK", num_args = 0..=1, required_unless_present = "udp")]
    pty: Option<Option<PathBuf>>,
    /// Send UDP datagrams to this address, as FreeD does
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "pty")]
    udp: Option<SocketAddr>,
    /// Records per second; by default the device's rate
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// Path of the sensor: `orbit`, or a file of lines `seconds x y z qx qy qz qw`
    #[arg(long, value_name = "orbit|FILE", default_value = "orbit")]
    trajectory: PathBuf,
    /// Play the tracker's recorded bytes of a session
    #[arg(long, value_name = "SESSION.mcap", conflicts_with = "trajectory")]
    session: Option<PathBuf>,
    /// Faults, separated by commas: split, drop=RATE, flip=RATE, insert=RATE, silent-after=SECONDS,
    /// hang-up-after=SECONDS
    #[arg(
        long,
        value_name = "LIST",
        default_value = "",
        hide_default_value = true
    )]
    faults: String,
}

pub fn run(args: SimulateArgs) -> anyhow::Result<ExitCode> {
    let args = match args.device {
        SimulatedDevice::Tracker(args) => args,
        SimulatedDevice::Session(args) => return session(*args),
    };
    let options = SimulateOptions {
        faults: Faults::parse(&args.faults).map_err(|e| anyhow!("--faults: {e}"))?,
        source: match args.session {
            Some(session) => SimulatedSource::Session(session),
            None if args.trajectory.as_os_str() == "orbit" => SimulatedSource::Orbit,
            None => SimulatedSource::File(args.trajectory),
        },
        place: match args.udp {
            Some(address) => SimulatedPlace::Udp(address),
            None => SimulatedPlace::Pty(args.pty.flatten()),
        },
        protocol: args.protocol,
        rate: args.rate,
    };
    // Print the address alone, for scripts.
    simulate(options, |address| super::say(address))?;
    Ok(ExitCode::SUCCESS)
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(rate) if (0.1..=10_000.0).contains(&rate) => Ok(rate),
        _ => Err("expected records per second, 0.1 to 10000".to_owned()),
    }
}

fn session(args: SessionArgs) -> anyhow::Result<ExitCode> {
    claim(&args.out, args.force)?;
    let truth = args.truth.as_ref();
    let truth = truth
        .map(|path| JsonFile::claim(path, args.force))
        .transpose()?;
    if args.force && args.out.is_file() {
        std::fs::remove_file(&args.out)?;
    }
    let progress = Progress::new("simulating");
    let simulation = SimulatedRig::new(args.rig);
    let report = |share: f64| progress.set(share);
    let ground_truth = record_simulation(&simulation, &args.out, report)?;
    progress.finish();
    if let Some(file) = truth {
        file.write(&ground_truth)?;
    }
    crate::cli::say(format_args!("{}", args.out.display()));
    Ok(ExitCode::SUCCESS)
}
