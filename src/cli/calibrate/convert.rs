//! `penumbra calibrate convert`.

use crate::cli::files::{claim, write};
use anyhow::{anyhow, bail};
use clap::{Args, ValueEnum};
use penumbra_calibration::formats::{self, Dialect, NamedLens};
use penumbra_picture::read_bounded;
use penumbra_rig::wall_date::iso_now;
use penumbra_rig_model::lens_record::LensRecord;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// OpenCV's YAML or XML, ROS's or Kalibr's YAML, Basalt's or Penumbra's JSON
    #[arg(value_name = "FILE")]
    from: PathBuf,
    /// Output format
    #[arg(long, value_enum)]
    to: Format,
    /// Name of the camera, for a file that has several
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Picture size, if the file does not state it
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
    /// The file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// calibration/scene_camera.json
    Penumbra,
    /// FileStorage
    Opencv,
    /// camera_info
    Ros,
    /// camchain
    Kalibr,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once(['x', 'X']);
    let parsed = sides.and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parsed
        .filter(|(w, h)| (1..=65_536).contains(w) && (1..=65_536).contains(h))
        .ok_or_else(|| "expected WIDTHxHEIGHT in pixels, e.g. 640x480".to_owned())
}

pub fn run(args: &ConvertArgs) -> anyhow::Result<ExitCode> {
    claim(&args.out, args.force)?;
    let source = args.from.display().to_string();
    let bytes = read_bounded(&args.from, 64 << 20)
        .map_err(|error| anyhow!("{source}: cannot be read ({error})"))?;
    let camera = selected(lenses(&source, &bytes, args.size)?, args)?;
    let text = match args.to {
        Format::Penumbra => {
            let record = LensRecord::from_lens(&camera.lens, &camera.name, iso_now());
            serde_json::to_string_pretty(&LensRecord { source, ..record })? + "\n"
        }
        Format::Opencv => formats::write(Dialect::Opencv, &[camera])?,
        Format::Ros => formats::write(Dialect::Ros, &[camera])?,
        Format::Kalibr => formats::write(Dialect::Kalibr, &[camera])?,
    };
    write(&args.out, text.as_bytes(), args.force)?;
    Ok(ExitCode::SUCCESS)
}

/// Reads the lenses of a file in any of the formats; `source` is its name.
fn lenses(source: &str, bytes: &[u8], size: Option<(u32, u32)>) -> anyhow::Result<Vec<NamedLens>> {
    let text = std::str::from_utf8(bytes).map_err(|_| anyhow!("{source}: is not text"))?;
    let is_json = Path::new(source)
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("json"));
    if is_json && !text.contains("\"value0\"") {
        let record = LensRecord::parse(source, bytes)?;
        let lens = record.lens(source)?;
        return Ok(vec![NamedLens {
            name: record.camera,
            lens,
        }]);
    }
    formats::read(text, size).map_err(|e| anyhow!("{source}: {e}"))
}

/// Returns the camera with the name of `--name`, else the only camera.
fn selected(mut cameras: Vec<NamedLens>, args: &ConvertArgs) -> anyhow::Result<NamedLens> {
    let names: Vec<String> = cameras.iter().map(|c| c.name.clone()).collect();
    if let Some(name) = &args.name {
        cameras.retain(|c| c.name == *name);
    }
    match (cameras.pop(), cameras.is_empty()) {
        (Some(camera), true) => Ok(camera),
        _ => bail!(
            "{}: choose one camera with --name: {}",
            args.from.display(),
            names.join(", ")
        ),
    }
}
