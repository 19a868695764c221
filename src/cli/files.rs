//! Writes output files; existing files are overwritten only with `--force`.

use anyhow::bail;
use penumbra_picture::write_whole;
use serde::Serialize;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Checks that an output file can be written, before the work starts.
pub fn claim(path: &Path, force: bool) -> anyhow::Result<()> {
    if !force && path.symlink_metadata().is_ok() {
        bail!(
            "{}: exists already; name another file or pass --force",
            path.display()
        );
    }
    if path.is_dir() {
        bail!("{}: is a folder; name a file", path.display());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        bail!(
            "{}: the folder {} does not exist; create it first",
            path.display(),
            folder.display()
        );
    }
    Ok(())
}

/// A JSON file that is written at the end of the work.
#[derive(Debug)]
pub struct JsonFile {
    path: PathBuf,
    force: bool,
}

impl JsonFile {
    /// Checks that the file can be written; see [`claim`].
    pub fn claim(path: &Path, force: bool) -> anyhow::Result<Self> {
        claim(path, force)?;
        let path = path.to_owned();
        Ok(Self { path, force })
    }

    /// Writes `value` as indented JSON.
    pub fn write(&self, value: &impl Serialize) -> anyhow::Result<()> {
        let mut text = serde_json::to_string_pretty(value)?;
        text.push('\n');
        write(&self.path, text.as_bytes(), self.force)
    }
}

/// Writes a file that was [`claim`]ed. After an error there is no part of it.
pub fn write(path: &Path, bytes: &[u8], force: bool) -> anyhow::Result<()> {
    let claimed = if force {
        Ok(())
    } else {
        // A file that was created since the check belongs to another program.
        File::create_new(path).map(drop)
    };
    let written = claimed.and_then(|()| {
        let whole = write_whole(path, |part| std::fs::write(part, bytes));
        whole.inspect_err(|_| {
            if !force {
                let _ = std::fs::remove_file(path);
            }
        })
    });
    written.map_err(|e| anyhow::anyhow!("{}: cannot be written ({e})", path.display()))
}

/// Reads a printed sheet, of at most 4 MiB.
pub fn read_pdf(path: &Path) -> anyhow::Result<Vec<u8>> {
    const MAX_BYTES: u64 = 4 << 20;
    let trouble = |e: &dyn std::fmt::Display| {
        anyhow::anyhow!("{}: {e}; [status] guide names a PDF", path.display())
    };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|e| trouble(&e))?;
    file.take(MAX_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| trouble(&e))?;
    if bytes.len() as u64 > MAX_BYTES || !bytes.starts_with(b"%PDF-") {
        return Err(trouble(&"is not a PDF of at most 4 MiB"));
    }
    Ok(bytes)
}

/// Refuses a folder that already holds one of `names`, unless `force` is set.
pub fn refuse_overwriting(folder: &Path, names: &[&str], force: bool) -> anyhow::Result<()> {
    if force {
        return Ok(());
    }
    for name in names {
        let path = folder.join(name);
        if path.symlink_metadata().is_ok() {
            bail!(
                "{}: exists already; name another folder or pass --force",
                path.display()
            );
        }
    }
    Ok(())
}
