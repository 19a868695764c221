//! `penumbra import`.

use crate::cli::progress::Progress;
use clap::Args;
use penumbra_session::import;
use penumbra_session::import::{ImportSummary, Lens};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct ImportArgs {
    /// A rig's folder (`scene_timestamps.csv`, `scene/`, `rig.json`, …) or a TUM RGB-D one
    /// (`rgb.txt`, `groundtruth.txt`)
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The session to write
    #[arg(value_name = "OUT.mcap")]
    output: PathBuf,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
}

pub fn run(args: ImportArgs) -> anyhow::Result<ExitCode> {
    let output = args.output.clone();
    let args = import::ImportArgs {
        folder: args.folder,
        output: args.output,
        force: args.force,
    };
    let progress = Progress::new("importing");
    let summary = import::import(&args, &mut |share| progress.set(share))?;
    progress.finish();
    super::say(format_args!("{}: {}", output.display(), describe(&summary)));
    if let Some(note) = summary.lens.and_then(note_on_lens) {
        super::say(note);
    }
    Ok(ExitCode::SUCCESS)
}

/// What a user must know about the lens of a TUM RGB-D folder.
fn note_on_lens(lens: Lens) -> Option<String> {
    match lens {
        Lens::Stated => None,
        Lens::Published { sequence } => Some(format!(
            "lens: the benchmark's values ({sequence}); a rig.json in the folder replaces them"
        )),
        Lens::Unknown => Some(
            "lens: unknown, as the pictures are no PNGs of 640x480 pixels; it cannot be replayed \
             without a rig.json in the folder (scene_camera with image_size and K)"
                .to_owned(),
        ),
    }
}

fn describe(summary: &ImportSummary) -> String {
    let megabytes = summary.bytes as f64 * 1e-6;
    format!(
        "{megabytes:.1} MB; {} scene pictures, {} environment pictures, {} chunks of tracker \
         bytes, {} poses, {} attachments",
        summary.scene_frames,
        summary.environment_frames,
        summary.tracker_chunks,
        summary.poses,
        summary.attachments
    )
}
