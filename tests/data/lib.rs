//! Finds test data: files of the repository, and rigs and photographs too large for it.

use std::path::{Path, PathBuf};

/// A file or folder of the repository, by its path from the root.
#[must_use]
pub fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(path)
}

/// A file or folder below `tests/fixtures`, such as `sessions/desk.mcap`.
#[must_use]
pub fn fixture(path: &str) -> PathBuf {
    repository("tests/fixtures").join(path)
}

/// A file or folder of the data beside the repository, such as `truth/desk`. If it is missing,
/// prints `SKIPPED` with the name of the running test and returns `None`; the test must then
/// return.
#[must_use]
pub fn shared(path: &str) -> Option<PathBuf> {
    let found = repository("../shared").join(path);
    if found.exists() {
        return Some(found);
    }
    // The test runner names each thread after its test.
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    eprintln!("SKIPPED {test}: ../shared/{path} is missing");
    None
}

/// Compares a generated page with the committed file `path`, which is relative to the root. With
/// the environment variable `UPDATE_DOCS` it writes the page instead.
///
/// # Panics
/// The committed page differs, or the page cannot be written.
pub fn check_page(path: &str, page: &str) {
    let file = repository(path);
    if std::env::var_os("UPDATE_DOCS").is_some() {
        let written = std::fs::write(&file, page);
        assert!(written.is_ok(), "{path}: {written:?}");
        return;
    }
    let committed = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(
        committed == page,
        "{path} is outdated; `make docs-write` rewrites it"
    );
}
