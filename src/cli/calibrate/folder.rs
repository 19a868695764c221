//! Reads pictures from files.

use anyhow::{Context as _, bail};
use penumbra_picture::Picture;
use std::path::{Path, PathBuf};

/// Reads the pictures of a folder in the order of their names.
pub fn pictures(folder: &Path) -> anyhow::Result<Vec<Picture>> {
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("{}: cannot be read", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    files.retain(|path| {
        let extension = path
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or_default();
        ["jpg", "jpeg", "png"].contains(&extension.to_lowercase().as_str())
    });
    files.sort();
    if files.is_empty() {
        bail!("{}: holds no JPEG or PNG pictures", folder.display());
    }
    files.iter().map(|file| picture(file)).collect()
}

/// Reads one picture.
pub fn picture(file: &Path) -> anyhow::Result<Picture> {
    let bytes =
        std::fs::read(file).with_context(|| format!("{}: cannot be read", file.display()))?;
    Picture::from_file_bytes(&bytes).with_context(|| file.display().to_string())
}
