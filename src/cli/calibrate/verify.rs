//! `penumbra calibrate verify`.

use super::args::InputArgs;
use clap::Args;
use penumbra_rig::calibration_runner::verify_step;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct VerifyArgs {
    #[command(flatten)]
    input: InputArgs,
}

pub fn run(args: &VerifyArgs) -> anyhow::Result<ExitCode> {
    let files = args.input.files()?;
    let files = |name: &str| files.get(name);
    let mut step = verify_step(args.input.rig()?, &files, &args.input.config()?)?;
    args.input.run_step(&mut step)
}
