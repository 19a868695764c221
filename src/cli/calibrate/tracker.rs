//! `penumbra calibrate tracker`.

use super::args::InputArgs;
use super::landmarks::{board_landmarks, tag_map};
use anyhow::bail;
use clap::Args;
use penumbra_calibration::hand_eye_calibration::{
    Landmarks, LatencyChoice, MountingOptions, MountingStep,
};
use penumbra_calibration::intrinsics::Board;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct TrackerArgs {
    #[command(flatten)]
    input: InputArgs,
    /// A static chessboard instead of the rig's markers: its first corner is the world's origin, +Z
    /// points out of the paper
    #[arg(long, value_name = "chess:9x6:0.025", value_parser = super::dictionary::board)]
    board: Option<Board>,
    /// The tracker's station that is mounted on the camera
    #[arg(long, value_name = "N", default_value_t = 1)]
    station: u8,
    /// Tracker latency: estimated here, the calibration's, or seconds
    #[arg(long, value_name = "estimate|calibration|SECONDS", default_value = "estimate", value_parser = latency)]
    latency: LatencyChoice,
    /// Estimate the distortion of the tracker's field by metal, and correct it if that reduces the
    /// error
    #[arg(long)]
    distortion: bool,
}

fn latency(text: &str) -> Result<LatencyChoice, String> {
    match text {
        "estimate" => Ok(LatencyChoice::Estimate),
        "calibration" => Ok(LatencyChoice::Calibration),
        _ => text
            .parse::<f64>()
            .ok()
            .filter(|s| s.abs() <= 2.0)
            .map(LatencyChoice::Seconds)
            .ok_or_else(|| "expected `estimate`, `calibration` or seconds".to_owned()),
    }
}

pub fn run(args: &TrackerArgs) -> anyhow::Result<ExitCode> {
    let rig = args.input.rig()?;
    let landmarks = match args.board {
        Some(board) => board_landmarks(board)?,
        None => match tag_map(&rig.markers)? {
            Some(tags) => Landmarks::Tags(tags),
            None => bail!(
                "the rig has no markers; run `calibrate map` and put calibration/markers.json beside \
                 rig.json, or name a --board"
            ),
        },
    };
    let options = MountingOptions {
        station: args.station,
        latency: args.latency,
        distortion: args.distortion,
        world_is_board: args.board.is_some(),
    };
    let mut step = MountingStep::new(&rig.calibration, landmarks, options);
    args.input.run_step(&mut step)
}
