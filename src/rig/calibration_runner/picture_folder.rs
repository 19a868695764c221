//! Reads the pictures of a folder.

use crate::error::RigError;
use penumbra_picture::{MAX_PICTURE_BYTES, Picture, read_bounded};
use std::path::{Path, PathBuf};

/// A picture of a folder.
#[derive(Debug)]
pub struct FolderPicture<'a> {
    /// The file's name.
    pub name: String,
    /// The decoded picture.
    pub picture: &'a Picture,
    /// Share of the folder's pictures that have been read, this one included, 0 to 1.
    pub share: f64,
}

/// Returns the paths of the JPEG and PNG pictures of a folder, sorted by name.
///
/// # Errors
/// The folder cannot be read or has no picture.
pub fn picture_files(folder: &Path) -> Result<Vec<PathBuf>, RigError> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect())
        .map_err(|e| unreadable(folder, &e))?;
    files.retain(|path| is_picture(path));
    files.sort();
    if files.is_empty() {
        return Err(RigError::Pictures {
            path: folder.to_owned(),
            reason: "there is no .jpg, .jpeg or .png in it".to_owned(),
        });
    }
    Ok(files)
}

/// Calls `visit` with the JPEG and PNG pictures of a folder, sorted by name; returns how many
/// could not be decoded.
///
/// # Errors
/// The folder or a file cannot be read, or the folder has no picture.
pub fn for_each_picture(
    folder: &Path,
    mut visit: impl FnMut(FolderPicture),
) -> Result<usize, RigError> {
    let files = picture_files(folder)?;
    let mut damaged = 0;
    for (i, path) in files.iter().enumerate() {
        let bytes = read_bounded(path, MAX_PICTURE_BYTES).map_err(|e| unreadable(path, &e))?;
        let Ok(picture) = Picture::from_file_bytes(&bytes) else {
            damaged += 1;
            continue;
        };
        let name = path.file_name().unwrap_or_default();
        visit(FolderPicture {
            name: name.to_string_lossy().into_owned(),
            picture: &picture,
            share: (i + 1) as f64 / files.len() as f64,
        });
    }
    Ok(damaged)
}

fn unreadable(path: &Path, source: &std::io::Error) -> RigError {
    RigError::Pictures {
        path: path.to_owned(),
        reason: source.to_string(),
    }
}

fn is_picture(path: &Path) -> bool {
    let known = ["jpg", "jpeg", "png"];
    path.extension()
        .is_some_and(|e| known.iter().any(|k| e.eq_ignore_ascii_case(k)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folder_without_pictures_is_named_in_the_error() {
        let folder = tempfile::tempdir().unwrap();
        let error = for_each_picture(folder.path(), |_| panic!("no picture")).unwrap_err();
        assert!(error.to_string().contains("no .jpg"), "{error}");
        std::fs::write(folder.path().join("a.JPG"), b"no picture").unwrap();
        assert_eq!(
            for_each_picture(folder.path(), |_| panic!("broken")).unwrap(),
            1
        );
        let none = folder.path().join("none");
        let error = for_each_picture(&none, |_| ()).unwrap_err().to_string();
        assert!(error.contains("none") && !error.contains('\n'), "{error}");
    }
}
