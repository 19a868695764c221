//! `penumbra calibrate verify`.

use super::from::FromArgs;
use clap::Args;
use penumbra_rig::calibration_runner::verify_step;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct VerifyArgs {
    #[command(flatten)]
    from: FromArgs,
}

pub fn run(args: &VerifyArgs) -> anyhow::Result<ExitCode> {
    let files = args.from.files()?;
    let files = |name: &str| files.get(name);
    let mut step = verify_step(args.from.rig()?, &files, &args.from.config()?)?;
    args.from.carry_out(&mut step)
}
