//! Runs the program in a temporary folder.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// A temporary folder in which the program runs, with additional variables of the environment.
pub struct Desk {
    folder: TempDir,
    environment: Vec<(&'static str, &'static str)>,
}

/// Returns the path of the bundled session.
pub fn desk_session() -> PathBuf {
    penumbra_test_data::fixture("sessions/desk.mcap")
}

impl Desk {
    pub fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            environment: Vec::new(),
        }
    }

    /// Adds a variable of the environment.
    pub fn with(mut self, name: &'static str, value: &'static str) -> Self {
        self.environment.push((name, value));
        self
    }

    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn put(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path
    }

    pub fn read(&self, name: impl AsRef<Path>) -> Vec<u8> {
        let path = self.path(name);
        std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    }

    pub fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(name)).unwrap()
    }

    /// Returns the names in a folder, sorted.
    pub fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).unwrap();
        let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name();
        let mut names: Vec<_> = entries
            .map(|e| name(e).to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    /// Returns the program as a command, on a machine without a desktop.
    pub fn command<S: AsRef<OsStr>>(&self, arguments: &[S]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_penumbra"));
        // On a slow machine the progress would mix with the messages that tests count.
        command.arg("--quiet").args(arguments);
        command.current_dir(self.folder.path());
        let desktop = [
            "DISPLAY",
            "WAYLAND_DISPLAY",
            "WAYLAND_SOCKET",
            "XDG_RUNTIME_DIR",
        ];
        for name in desktop.iter().chain(&["NODEVICE_SELECT", "RUST_LOG"]) {
            command.env_remove(name);
        }
        command.envs(self.environment.iter().copied());
        command
    }

    pub fn run(&self, line: &str) -> Output {
        self.command(&words(line)).output().unwrap()
    }

    /// Runs a command line that must succeed; returns its standard output.
    pub fn works(&self, line: &str) -> String {
        let output = self.run(line);
        let error = text(&output.stderr);
        assert!(output.status.success(), "{line}: {error}");
        text(&output.stdout)
    }

    /// Runs a command line that must fail; returns its one-line error without the prefix.
    pub fn refuses(&self, line: &str) -> String {
        let output = self.run(line);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{line}: {error}");
        assert!(!error.contains("panicked"), "{line}: {error}");
        let message = error
            .strip_prefix("penumbra: ")
            .unwrap_or_else(|| panic!("{line}: {error}"));
        assert_eq!(error.lines().count(), 1, "{line}: {error}");
        message.trim_end().to_owned()
    }
}

/// Splits a command line into words. `DESK` is replaced by the path of the bundled session.
fn words(line: &str) -> Vec<String> {
    let session = desk_session().display().to_string();
    line.split_whitespace()
        .map(|word| word.replace("DESK", &session))
        .collect()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
