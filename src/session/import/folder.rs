//! The imported folder and the tables in it.

use super::ImportError;
use penumbra_interface::MonotonicTime;
use std::fs;
use std::path::{Component, Path, PathBuf};

/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Reads files below a folder, never outside it.
#[derive(Debug)]
pub(super) struct Folder {
    root: PathBuf,
    canonical: PathBuf,
}

#[derive(Debug, Default)]
struct Entries {
    files: Vec<PathBuf>,
    folders: Vec<PathBuf>,
}

impl Folder {
    pub fn open(root: &Path) -> Result<Self, ImportError> {
        let path = root.to_owned();
        if !root.is_dir() {
            return Err(ImportError::NoFolder { path });
        }
        let canonical = root.canonicalize().map_err(|e| ImportError::io(root, e))?;
        Ok(Self {
            root: path,
            canonical,
        })
    }

    /// Returns the path of a file of the folder.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.root.join(name)
    }

    pub fn has(&self, name: &str) -> bool {
        self.path(name).is_file()
    }

    /// Reads the bytes of a file.
    pub fn read(&self, name: &Path) -> Result<Vec<u8>, ImportError> {
        let path = self.inside(name)?;
        let metadata = fs::metadata(&path).map_err(|e| ImportError::io(&path, e))?;
        if metadata.len() > MAX_FILE_BYTES {
            return Err(ImportError::TooLarge {
                path,
                bytes: metadata.len(),
                limit: MAX_FILE_BYTES,
            });
        }
        fs::read(&path).map_err(|e| ImportError::io(&path, e))
    }

    /// Reads the text of a table.
    pub fn text(&self, name: &str) -> Result<String, ImportError> {
        let bytes = self.read(Path::new(name))?;
        String::from_utf8(bytes).map_err(|_| self.line(name, 1, "not text"))
    }

    /// Returns whether a file named by a table exists.
    pub fn lists(&self, name: &Path) -> Result<bool, ImportError> {
        Ok(self.plain(name)?.is_file())
    }

    /// Returns the path of a file whose name does not lead out of the folder.
    fn plain(&self, name: &Path) -> Result<PathBuf, ImportError> {
        let path = self.path(name);
        let plain = |part: Component| matches!(part, Component::Normal(_) | Component::CurDir);
        if name.components().all(plain) {
            Ok(path)
        } else {
            Err(ImportError::Outside { path })
        }
    }

    /// Returns the path of a file if neither its name nor a link leads out of the folder.
    fn inside(&self, name: &Path) -> Result<PathBuf, ImportError> {
        let path = self.plain(name)?;
        let outside = || ImportError::Outside { path: path.clone() };
        let canonical = path.canonicalize().map_err(|e| ImportError::io(&path, e))?;
        if !canonical.starts_with(&self.canonical) {
            return Err(outside());
        }
        Ok(path)
    }

    /// Lists the files directly in a folder, as paths relative to the imported folder.
    pub fn files_in(&self, name: &Path) -> Result<Vec<PathBuf>, ImportError> {
        Ok(self.entries(name)?.files)
    }

    /// Lists the files below `name`, as paths relative to the imported folder, sorted.
    pub fn files_below(&self, name: &str) -> Result<Vec<PathBuf>, ImportError> {
        let mut files = Vec::new();
        let mut folders = vec![PathBuf::from(name)];
        while let Some(folder) = folders.pop() {
            let entries = self.entries(&folder)?;
            folders.extend(entries.folders);
            files.extend(entries.files);
        }
        files.sort();
        Ok(files)
    }

    /// Lists a folder's direct entries; nothing if the folder does not exist.
    fn entries(&self, name: &Path) -> Result<Entries, ImportError> {
        let mut found = Entries::default();
        let path = self.plain(name)?;
        if !path.is_dir() {
            return Ok(found);
        }
        for entry in fs::read_dir(&path).map_err(|e| ImportError::io(&path, e))? {
            let entry = entry.map_err(|e| ImportError::io(&path, e))?;
            let kind = entry.file_type().map_err(|e| ImportError::io(&path, e))?;
            let below = name.join(entry.file_name());
            // A link to a folder may form a loop; a link to a file is checked when it is read.
            if kind.is_dir() {
                found.folders.push(below);
            } else if kind.is_file() || self.path(&below).is_file() {
                found.files.push(below);
            }
        }
        Ok(found)
    }

    pub fn line(&self, name: &str, line: usize, reason: &str) -> ImportError {
        ImportError::Line {
            path: self.path(name),
            line,
            reason: reason.to_owned(),
        }
    }

    /// Reads the given `columns` of a table with a heading, row by row, with the line number of
    /// each row.
    pub fn table<const N: usize>(
        &self,
        name: &str,
        text: &str,
        columns: [&str; N],
    ) -> Result<Vec<(usize, [String; N])>, ImportError> {
        let mut lines = text.lines().enumerate();
        let heading: Vec<&str> = lines
            .next()
            .map(|(_, line)| line.split(',').map(str::trim).collect())
            .unwrap_or_default();
        let mut places = [0; N];
        for (place, column) in places.iter_mut().zip(columns) {
            *place = heading
                .iter()
                .position(|heading| *heading == column)
                .ok_or_else(|| self.line(name, 1, &format!("no column {column}")))?;
        }
        let rows = lines.filter(|(_, line)| !line.trim().is_empty());
        rows.map(|(i, line)| {
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let mut row = [const { String::new() }; N];
            for (cell, place) in row.iter_mut().zip(places) {
                let found = cells.get(place).filter(|found| !found.is_empty());
                let missing = || self.line(name, i + 1, "too few columns");
                *cell = (*found.ok_or_else(missing)?).to_owned();
            }
            Ok((i + 1, row))
        })
        .collect()
    }

    /// Parses a cell of nanoseconds.
    pub fn nanos(&self, name: &str, line: usize, cell: &str) -> Result<MonotonicTime, ImportError> {
        let nanos: Option<i64> = cell.parse().ok().filter(|nanos| *nanos >= 0);
        nanos
            .map(MonotonicTime::from_nanos)
            .ok_or_else(|| self.line(name, line, &format!("{cell:?} is no time in nanoseconds")))
    }
}
