//! `penumbra light`.

use super::files::refuse_overwriting;
use anyhow::bail;
use clap::Args;
use penumbra::environment::LightReport;
use penumbra::environment::photograph::PhotographKind;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct LightArgs {
    /// A photograph (JPEG, PNG) or a session
    #[arg(value_name = "IMAGE|SESSION.mcap")]
    source: PathBuf,
    /// What the photograph shows
    #[arg(long, value_enum)]
    kind: Option<PhotographKind>,
    /// The photograph's geometry, where it is not to be found in the picture
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Folder for environment.exr, environment.png, lights.png and light.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write over files that are there
    #[arg(long)]
    force: bool,
}

const FILES: [&str; 4] = [
    "environment.exr",
    "environment.png",
    "lights.png",
    "light.json",
];

pub fn run(args: &LightArgs) -> anyhow::Result<ExitCode> {
    refuse_overwriting(&args.out, &FILES, args.force)?;
    if args.out.exists() && !args.out.is_dir() {
        bail!("{}: is a file; name a folder", args.out.display());
    }
    let report = LightReport::of_photograph(&args.source, args.kind, args.calibration.as_deref())?;
    report.write(&args.out)?;
    super::say(in_words(&report));
    Ok(ExitCode::SUCCESS)
}

fn in_words(report: &LightReport) -> String {
    let d = report.dominant_direction;
    format!(
        "light comes mostly from azimuth {:.1}°, elevation {:.1}°; {} dome lights, {} clipped pixels",
        d.y.atan2(d.x).to_degrees(),
        d.z.clamp(-1.0, 1.0).asin().to_degrees(),
        report.lighting.lights.len(),
        report.clipped_pixels
    )
}
