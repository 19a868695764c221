//! `penumbra calibrate board`.

use crate::cli::files::{claim, write};
use anyhow::bail;
use clap::Args;
use image::{ExtendedColorType, ImageEncoder};
use penumbra_calibration::board_sheet::sheet_of;
use penumbra_calibration::intrinsics::Board;
use penumbra_calibration::sheet::Sheet;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct BoardArgs {
    /// chess:9x6:0.025 (inner corners, square in metres), aprilgrid:6x6:0.03:0.3 (tags, tag in
    /// metres, gap as a share of it) or charuco:8x5:0.03:0.022:4x4_50 (squares, square and marker
    /// in metres, dictionary: also OpenCV's .yml or .xml, or a .txt)
    #[arg(long, value_name = "BOARD", default_value = "chess:9x6:0.025", value_parser = super::dictionary::board)]
    board: Board,
    /// The file to write: .pdf, .svg or .png
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Dots per inch of a .png
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(20..=4800))]
    dpi: u32,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
}

pub fn run(args: &BoardArgs) -> anyhow::Result<ExitCode> {
    let kind = args
        .out
        .extension()
        .map(|e| e.to_string_lossy().to_lowercase());
    let sheet = sheet_of(&args.board);
    claim(&args.out, args.force)?;
    let bytes = match kind.as_deref() {
        Some("pdf") => sheet.pdf(),
        Some("svg") => sheet.svg().into_bytes(),
        Some("png") => png(&sheet, args.dpi)?,
        _ => bail!("{}: name a .pdf, .svg or .png file", args.out.display()),
    };
    write(&args.out, &bytes, args.force)?;
    crate::cli::say(format_args!(
        "{}: {:.0} x {:.0} mm; print at 100 %, measure the line, glue it to something flat",
        args.out.display(),
        1000.0 * sheet.width,
        1000.0 * sheet.height
    ));
    Ok(ExitCode::SUCCESS)
}

fn png(sheet: &Sheet, dpi: u32) -> anyhow::Result<Vec<u8>> {
    let (pixels, width, height) = sheet.raster(dpi)?;
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes).write_image(
        &pixels,
        width,
        height,
        ExtendedColorType::L8,
    )?;
    Ok(bytes)
}
