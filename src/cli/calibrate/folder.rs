//! Reads pictures from files.

use anyhow::anyhow;
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
    let named = |what: &dyn std::fmt::Display| anyhow!("{}: {what}", file.display());
    let bytes = read_bounded(file, MAX_PICTURE_BYTES).map_err(|error| named(&error))?;
    Picture::from_file_bytes(&bytes).map_err(|error| named(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_picture_is_named_with_the_reason() {
        let folder = std::env::temp_dir();
        let file = folder.join(format!("penumbra-damaged-{}.jpg", std::process::id()));
        std::fs::write(&file, b"\xff\xd8 this is no picture").unwrap();
        let text = picture(&file).unwrap_err().to_string();
        std::fs::remove_file(&file).unwrap();
        let name = file.display().to_string();
        assert!(text.len() > name.len() + 10, "{text}");
        assert!(text.starts_with(&format!("{name}: ")), "{text}");
    }
}
