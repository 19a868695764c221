//! Every input in the fuzz targets' corpora passes through the function that its target calls
//! (tests/fuzz), here without sanitizers and limits. `make fuzz` looks for new inputs.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test fails by panicking"
)]

#[path = "fuzz/src/dialogue.rs"]
mod dialogue;
#[path = "fuzz/src/files.rs"]
mod files;
#[path = "fuzz/src/http.rs"]
mod http;
#[path = "fuzz/src/picture.rs"]
mod picture;
#[path = "fuzz/src/session.rs"]
mod session;
#[path = "fuzz/src/trackers.rs"]
mod trackers;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fuzz")
        .join(name)
}

/// The names in a folder, without extensions.
fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    paths
        .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
        .collect()
}

fn replay(target: &str, run: fn(&[u8])) {
    let folder = folder("corpus").join(target);
    let inputs = names(&folder);
    assert!(!inputs.is_empty(), "{target} has no corpus");
    for input in inputs {
        // Shown if the test fails.
        println!("tests/fuzz/corpus/{target}/{input}");
        run(&std::fs::read(folder.join(input)).unwrap());
    }
}

/// A test for each target, and their names.
macro_rules! targets {
    ($($module:ident::$name:ident),* $(,)?) => {
        const TARGETS: &[&str] = &[$(stringify!($name)),*];
        $(
            #[test]
            fn $name() {
                replay(stringify!($name), $module::$name);
            }
        )*
    };
}

targets!(
    trackers::fastrak,
    trackers::liberty,
    trackers::flock,
    trackers::freed,
    trackers::csv,
    trackers::vrpn,
    dialogue::dialogue,
    session::session,
    files::config,
    files::scene,
    files::gltf,
    files::ply,
    files::rig,
    picture::picture,
    http::http,
);

#[test]
fn every_target_is_replayed_here() {
    let targets: BTreeSet<String> = TARGETS.iter().map(|name| (*name).to_owned()).collect();
    assert_eq!(names(&folder("fuzz_targets")), targets);
    assert_eq!(names(&folder("corpus")), targets);
}
