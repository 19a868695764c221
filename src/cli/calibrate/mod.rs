//! `penumbra calibrate`: from unpacked hardware to figures that are known, one step after
//! the other.

mod board;
mod convert;
mod environment;
mod folder;
mod from;
mod intrinsics;
mod landmarks;
mod latency;
mod live;
mod map;
mod radiometric;
mod tags;
mod tracker;
mod verify;

pub use from::progress_bar;

use clap::{Args, Subcommand};
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct CalibrateArgs {
    #[command(subcommand)]
    step: Step,
}

#[derive(Debug, Subcommand)]
enum Step {
    /// A camera's lens, from pictures of a board
    Intrinsics(Box<intrinsics::IntrinsicsArgs>),
    /// Where the environment camera stands and how it looks
    Environment(Box<environment::EnvironmentArgs>),
    /// Where tags are on one another, from pictures that show several at a time
    Map(Box<map::MapArgs>),
    /// How late the tracker and each camera are, from how both turn
    Latency(Box<latency::LatencyArgs>),
    /// How the scene camera sits on the tracker's sensor, and where its transmitter stands
    Tracker(Box<tracker::TrackerArgs>),
    /// A board to print, at true scale
    Board(board::BoardArgs),
    /// A check of the whole rig, in a minute
    Verify(verify::VerifyArgs),
    /// White balance and exposure between the cameras, tone curves, vignetting, noise
    Radiometric(Box<radiometric::RadiometricArgs>),
    /// The old name of `radiometric`.
    #[command(hide = true)]
    Photometric(OldArgs),
    /// Which tags pictures show, and where
    Tags(tags::TagsArgs),
    /// A lens's calibration from and to other programs' files
    Convert(convert::ConvertArgs),
}

/// Whatever an old command line holds.
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
struct OldArgs {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    _arguments: Vec<String>,
}

/// Carries out a step.
pub fn run(args: CalibrateArgs) -> anyhow::Result<ExitCode> {
    match args.step {
        Step::Intrinsics(args) => intrinsics::run(&args),
        Step::Environment(args) => environment::run(&args),
        Step::Map(args) => map::run(&args),
        Step::Latency(args) => latency::run(&args),
        Step::Tracker(args) => tracker::run(&args),
        Step::Board(args) => board::run(&args),
        Step::Verify(args) => verify::run(&args),
        Step::Radiometric(args) => radiometric::run(&args),
        Step::Photometric(_) => anyhow::bail!(
            "`penumbra calibrate photometric` is now called `penumbra calibrate radiometric`"
        ),
        Step::Tags(args) => tags::run(&args),
        Step::Convert(args) => convert::run(&args),
    }
}
