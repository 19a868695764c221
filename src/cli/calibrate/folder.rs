//! Reads pictures from files.

use anyhow::Context as _;
use penumbra_picture::{MAX_PICTURE_BYTES, Picture, read_bounded};
use penumbra_rig::calibration_runner::picture_files;
use std::path::Path;

/// Reads the JPEG and PNG pictures of a folder, sorted by name.
pub fn pictures(folder: &Path) -> anyhow::Result<Vec<Picture>> {
    let files = picture_files(folder)?;
    files.iter().map(|file| picture(file)).collect()
}

/// Reads a picture.
pub fn picture(file: &Path) -> anyhow::Result<Picture> {
    let bytes = read_bounded(file, MAX_PICTURE_BYTES)
        .with_context(|| format!("{}: cannot be read", file.display()))?;
    Picture::from_file_bytes(&bytes).with_context(|| file.display().to_string())
}
