//! `penumbra calibrate map`.

use super::args::InputArgs;
use clap::Args;
use penumbra_calibration::tag_map::{MapOptions, MapStep};
use penumbra_fiducials::Family;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(flatten)]
    input: InputArgs,
    /// Edge of the tags' black border, metres, if the calibration does not state it
    #[arg(long, value_name = "METRES", value_parser = metres)]
    size: Option<f64>,
    /// Edge of the black border of a single tag
    #[arg(long, value_name = "ID=METRES", value_parser = size_of)]
    size_of: Vec<(u32, f64)>,
    /// Tag that defines a new world frame and lies on the table: +X to its right, +Z up. Without it
    /// the frame of the known markers is kept, or the lowest number defines it
    #[arg(long, value_name = "ID")]
    origin: Option<u32>,
    /// Tag family
    #[arg(long, value_name = "NAME", default_value = "tag36h11", value_parser = super::dictionary::family)]
    family: Vec<Family>,
}

fn metres(text: &str) -> Result<f64, String> {
    let size = text.parse::<f64>().ok();
    size.filter(|s| (0.002..=5.0).contains(s))
        .ok_or_else(|| "expected metres from 0.002 to 5 (8 cm is 0.08)".to_owned())
}

fn size_of(text: &str) -> Result<(u32, f64), String> {
    let (id, size) = text.split_once('=').ok_or("expected ID=METRES")?;
    let id = id.parse().map_err(|_| "expected a tag's number before =")?;
    Ok((id, metres(size)?))
}

pub fn run(args: &MapArgs) -> anyhow::Result<ExitCode> {
    let rig = args.input.rig()?;
    let options = MapOptions {
        families: args.family.clone(),
        size: args.size,
        sizes: args.size_of.iter().copied().collect(),
        origin: args.origin,
    };
    let mut step = MapStep::new(&rig.calibration, &rig.markers, options);
    args.input.run_step(&mut step)
}
