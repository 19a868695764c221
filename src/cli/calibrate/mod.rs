//! `penumbra calibrate`: from unpacked hardware to figures that are known, one step after
//! the other.

mod board;
mod convert;
mod intrinsics;

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
    /// A board to print, at true scale
    Board(board::BoardArgs),
    /// A lens's calibration from and to other programs' files
    Convert(convert::ConvertArgs),
}

/// Carries out a step.
pub fn run(args: CalibrateArgs) -> anyhow::Result<ExitCode> {
    match args.step {
        Step::Intrinsics(args) => intrinsics::run(&args),
        Step::Board(args) => board::run(&args),
        Step::Convert(args) => convert::run(&args),
    }
}
