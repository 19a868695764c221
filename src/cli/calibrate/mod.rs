//! `penumbra calibrate`: calibrates a rig, step by step.

mod args;
mod board;
mod convert;
mod dictionary;
mod environment;
mod folder;
mod intrinsics;
mod landmarks;
mod latency;
mod live;
mod map;
mod radiometric;
mod tags;
mod tracker;
mod verify;

use clap::{Args, Subcommand};
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct CalibrateArgs {
    #[command(subcommand)]
    step: Step,
}

#[derive(Debug, Subcommand)]
enum Step {
    /// Calibrate a camera's lens from pictures of a board
    Intrinsics(Box<intrinsics::IntrinsicsArgs>),
    /// Calibrate the environment camera's pose and lens
    Environment(Box<environment::EnvironmentArgs>),
    /// Map tags: their relative poses, from pictures that show several at a time
    Map(Box<map::MapArgs>),
    /// Measure tracker and camera latency from their rotations
    Latency(Box<latency::LatencyArgs>),
    /// Calibrate the scene camera's mounting on the tracker's sensor, and the transmitter's pose
    Tracker(Box<tracker::TrackerArgs>),
    /// Create a calibration board to print at true scale
    Board(board::BoardArgs),
    /// Check the complete rig in a minute
    Verify(verify::VerifyArgs),
    /// Calibrate tone curves, vignetting, noise, and the gains between the cameras
    Radiometric(Box<radiometric::RadiometricArgs>),
    /// Detect tags in pictures
    Tags(tags::TagsArgs),
    /// Convert a lens calibration from and to other programs' formats
    Convert(convert::ConvertArgs),
}

/// Runs the step that the command line names.
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
        Step::Tags(args) => tags::run(&args),
        Step::Convert(args) => convert::run(&args),
    }
}
