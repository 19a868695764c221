//! `penumbra bench`.

use super::files::JsonFile;
use super::progress::Progress;
use crate::bench::{BenchOptions, CASES};
use clap::Args;
use clap::builder::PossibleValuesParser;
use penumbra_compositor::Gpu;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Case to run; all without it
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(CASES))]
    case: Option<String>,
    /// Also write the table as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Part of the graphics adapter's name, or its number
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Frames per row of the table; without it 60, 900 of the live case, 300 pictures per camera
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
    /// Picture size; without it the case's
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<(u32, u32)>,
    /// Recording that the live case plays; without it the bundled one
    #[arg(long, value_name = "FILE.mcap")]
    session: Option<PathBuf>,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
}

pub fn run(args: BenchArgs) -> anyhow::Result<ExitCode> {
    let json = args
        .json
        .as_deref()
        .map(|path| JsonFile::claim(path, args.force))
        .transpose()?;
    let options = BenchOptions {
        case: args.case,
        frames: args.frames,
        size: args.size,
        session: args.session,
    };
    let gpu = if options.needs_gpu() {
        let gpu = Gpu::open(args.adapter.as_deref())?;
        super::say(format_args!("adapter: {}", gpu.name));
        Some(gpu)
    } else {
        None
    };
    let progress = Progress::new("benchmark");
    let rows = options.rows().max(1) as f64;
    let mut done = 0.0;
    let report = crate::bench::run(gpu.as_ref(), &options, &mut |row| {
        progress.aside(|| super::say(row));
        progress.set(done / rows);
        done += 1.0;
    })?;
    progress.finish();
    if let Some(json) = json {
        json.write(&report)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// `800x600`.
fn size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| text.parse().ok().filter(|n| (16..=8192).contains(n));
    let sides = text
        .split_once('x')
        .and_then(|(w, h)| Some((side(w)?, side(h)?)));
    sides.ok_or_else(|| "expected a size such as 1920x1080, 16 to 8192 a side".to_owned())
}
