//! `penumbra calibrate latency`.

use super::args::InputArgs;
use super::landmarks::{board_landmarks, tag_map};
use clap::Args;
use penumbra_calibration::hand_eye_calibration::{Landmarks, LatencyOptions, LatencyStep};
use penumbra_calibration::intrinsics::Board;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct LatencyArgs {
    #[command(flatten)]
    input: InputArgs,
    /// A static chessboard instead of the rig's markers
    #[arg(long, value_name = "chess:9x6:0.025", value_parser = super::dictionary::board)]
    board: Option<Board>,
    /// The tracker's station that is mounted on the camera
    #[arg(long, value_name = "N", default_value_t = 1)]
    station: u8,
    /// Maximum offset to search, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.25, value_parser = range)]
    range: f64,
}

fn range(text: &str) -> Result<f64, String> {
    let seconds = text
        .parse::<f64>()
        .ok()
        .filter(|s| (0.02..=2.0).contains(s));
    seconds.ok_or_else(|| "expected seconds from 0.02 to 2".to_owned())
}

pub fn run(args: &LatencyArgs) -> anyhow::Result<ExitCode> {
    let rig = args.input.rig()?;
    let landmarks = match args.board {
        Some(board) => Some(board_landmarks(board)?),
        None => tag_map(&rig.markers)?.map(Landmarks::Tags),
    };
    let options = LatencyOptions {
        range: args.range,
        station: args.station,
    };
    let mut step = LatencyStep::new(&rig.calibration, landmarks, options);
    args.input.run_step(&mut step)
}
