//! `penumbra calibrate tags`.

use crate::cli::files::{claim, write};
use clap::Args;
use penumbra_camera::Response;
use penumbra_fiducials::{Detector, Family};
use penumbra_rig::calibration_runner::{FolderPicture, for_each_picture};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Maximum number of outlines that are examined in a picture; no time limit applies here.
const MAX_CANDIDATES: usize = 20_000;

#[derive(Debug, Args)]
pub struct TagsArgs {
    /// A folder of pictures (JPEG, PNG)
    #[arg(long, value_name = "DIR")]
    pictures: PathBuf,
    /// Tag families: tag36h11, tag25h9, tag16h5, kalibr36h11 (with Kalibr's border), 4x4_50 to
    /// 7x7_1000, aruco_original, aruco_mip_36h12, or the file of a dictionary: OpenCV's .yml or
    /// .xml, or a .txt with the bits of a marker per line
    #[arg(
        long,
        value_name = "NAME",
        default_value = "tag36h11",
        value_delimiter = ',',
        value_parser = super::dictionary::family
    )]
    family: Vec<Family>,
    /// One line per tag: picture, family, number, corners clockwise from the top left (pixels),
    /// decision margin from 0 to 1, number of wrong bits
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
}

pub fn run(args: &TagsArgs) -> anyhow::Result<ExitCode> {
    claim(&args.out, args.force)?;
    let mut detector =
        Detector::new(&args.family, &Response::srgb()).with_max_candidates(MAX_CANDIDATES);
    let mut table = String::from("picture,family,id,x0,y0,x1,y1,x2,y2,x3,y3,margin,wrong_bits\n");
    let damaged = for_each_picture(&args.pictures, |file: FolderPicture| {
        let start = Instant::now();
        let tags = detector.detect(file.picture, None);
        let millis = 1e3 * start.elapsed().as_secs_f64();
        let name = file.name.replace([',', '\n', '\r'], " ");
        crate::cli::say(format_args!(
            "{name}: {} tags in {millis:.2} ms",
            tags.len()
        ));
        for tag in tags {
            let _ = write!(table, "{name},{},{}", tag.family, tag.id);
            for c in tag.corners {
                let _ = write!(table, ",{:.4},{:.4}", c.x, c.y);
            }
            let _ = writeln!(table, ",{:.3},{}", tag.margin, tag.wrong_bits);
        }
    })?;
    if damaged > 0 {
        crate::cli::warn(format_args!("{damaged} damaged pictures were skipped"));
    }
    write(&args.out, table.as_bytes(), args.force)?;
    Ok(ExitCode::SUCCESS)
}
