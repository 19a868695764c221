//! Pictures of a folder to calibrate from.

use crate::error::RigError;
use penumbra_picture::Picture;
use std::path::{Path, PathBuf};

/// One picture on its way to an estimator.
#[derive(Debug)]
pub struct Looked<'a> {
    /// The file's name.
    pub name: String,
    /// Decoded.
    pub picture: &'a Picture,
    /// How much of all has been looked at, 0 to 1.
    pub share: f64,
}

/// Shows `visit` the JPEG and PNG pictures of a folder, in the order of their names; returns
/// how many could not be decoded.
///
/// # Errors
/// No such folder, no picture in it, a file that cannot be read.
pub fn pictures_of_folder(folder: &Path, mut visit: impl FnMut(Looked)) -> Result<usize, RigError> {
    let unreadable = |path: &Path, source: std::io::Error| RigError::Pictures {
        path: path.to_owned(),
        reason: source.to_string(),
    };
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect())
        .map_err(|e| unreadable(folder, e))?;
    files.retain(|path| is_picture(path));
    files.sort();
    if files.is_empty() {
        return Err(RigError::Pictures {
            path: folder.to_owned(),
            reason: "there is no .jpg, .jpeg or .png in it".to_owned(),
        });
    }
    let mut damaged = 0;
    for (i, path) in files.iter().enumerate() {
        let bytes = std::fs::read(path).map_err(|e| unreadable(path, e))?;
        let Ok(picture) = Picture::from_file_bytes(&bytes) else {
            damaged += 1;
            continue;
        };
        let name = path.file_name().unwrap_or_default();
        visit(Looked {
            name: name.to_string_lossy().into_owned(),
            picture: &picture,
            share: (i + 1) as f64 / files.len() as f64,
        });
    }
    Ok(damaged)
}

fn is_picture(path: &Path) -> bool {
    let known = ["jpg", "jpeg", "png"];
    path.extension()
        .is_some_and(|e| known.iter().any(|k| e.eq_ignore_ascii_case(k)))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    #[test]
    fn a_folder_without_pictures_is_told_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = pictures_of_folder(folder.path(), |_| panic!("no picture")).unwrap_err();
        assert!(error.to_string().contains("no .jpg"), "{error}");
        std::fs::write(folder.path().join("a.JPG"), b"no picture").unwrap();
        assert_eq!(
            pictures_of_folder(folder.path(), |_| panic!("broken")).unwrap(),
            1
        );
        let none = folder.path().join("none");
        let error = pictures_of_folder(&none, |_| ()).unwrap_err().to_string();
        assert!(error.contains("none") && !error.contains('\n'), "{error}");
    }
}
