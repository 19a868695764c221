//! `penumbra doctor`: checks what works on this machine, and prints the command that fixes the rest.
//!
//! [`examine`] checks the graphics driver (`graphics`), the permissions of cameras, GPUs and serial
//! ports (`devices`), and ports, display and disk (`machine`). It changes nothing and opens no device
//! but the GPU.

#[cfg(unix)]
mod devices;
mod graphics;
mod machine;

use serde::Serialize;
use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;

/// What to examine.
#[derive(Clone, Debug)]
pub struct DoctorOptions {
    /// Address of the status server.
    pub listen: SocketAddr,
    /// Folder of recordings.
    pub recordings: PathBuf,
    /// As `--adapter`: a part of the adapter's name, or its number.
    pub adapter: Option<String>,
    /// The file system's root; another one in tests.
    pub root: PathBuf,
}

impl Default for DoctorOptions {
    fn default() -> Self {
        Self {
            listen: penumbra_status::DEFAULT_LISTEN,
            recordings: PathBuf::from("."),
            adapter: None,
            root: PathBuf::from("/"),
        }
    }
}

/// Outcome of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Works.
    Ok,
    /// Works with restrictions, or is needed by some uses only.
    Warn,
    /// The program does not work.
    Fail,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    /// Subject.
    pub name: &'static str,
    /// Outcome.
    pub state: State,
    /// Result, one sentence.
    pub found: String,
    /// Remedy, a command or an action; present unless the state is Ok.
    pub remedy: Option<String>,
}

impl Check {
    fn ok(name: &'static str, found: impl Into<String>) -> Self {
        Self {
            name,
            state: State::Ok,
            found: found.into(),
            remedy: None,
        }
    }

    fn warn(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            name,
            state: State::Warn,
            found: found.into(),
            remedy: Some(remedy.into()),
        }
    }

    fn fail(name: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            state: State::Fail,
            ..Self::warn(name, found, remedy)
        }
    }
}

/// All checks, in the order in which to fix them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Report {
    /// The checks.
    pub checks: Vec<Check>,
}

impl Report {
    /// Returns the worst outcome; Ok for an empty report.
    #[must_use]
    pub fn state(&self) -> State {
        self.checks
            .iter()
            .map(|check| check.state)
            .max()
            .unwrap_or(State::Ok)
    }

    fn count(&self, state: State) -> usize {
        self.checks.iter().filter(|c| c.state == state).count()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for check in &self.checks {
            writeln!(f, "{check}")?;
        }
        match self.state() {
            State::Ok => write!(f, "everything works"),
            State::Warn => write!(f, "works, with {} warnings", self.count(State::Warn)),
            State::Fail => write!(
                f,
                "{} failures, {} warnings; fix the failures first",
                self.count(State::Fail),
                self.count(State::Warn)
            ),
        }
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mark = match self.state {
            State::Ok => "ok  ",
            State::Warn => "warn",
            State::Fail => "FAIL",
        };
        write!(f, "{mark}  {:<16} {}", self.name, self.found)?;
        match &self.remedy {
            Some(remedy) => write!(f, "\n      {:<16} fix: {remedy}", ""),
            None => Ok(()),
        }
    }
}

/// Runs all checks. Takes about a second, because the shaders are compiled.
#[must_use]
pub fn examine(options: &DoctorOptions) -> Report {
    let mut checks = graphics::examine(options);
    // On other systems devices are not files with groups.
    #[cfg(unix)]
    checks.extend(devices::examine(&options.root));
    checks.extend(machine::examine(options));
    Report { checks }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine without any device or driver in it.
    fn bare() -> (tempfile::TempDir, DoctorOptions) {
        let root = tempfile::tempdir().unwrap();
        let options = DoctorOptions {
            root: root.path().to_path_buf(),
            recordings: root.path().to_path_buf(),
            listen: ([127, 0, 0, 1], 0).into(),
            ..DoctorOptions::default()
        };
        (root, options)
    }

    #[test]
    fn every_failed_check_has_a_remedy() {
        let (_root, mut options) = bare();
        options.adapter = Some("no such adapter".into());
        options.recordings = PathBuf::from("/no/such/folder");
        let report = examine(&options);
        assert_eq!(report.state(), State::Fail);
        for check in &report.checks {
            let has_remedy = check.remedy.as_ref().is_some_and(|r| !r.is_empty());
            assert_eq!(has_remedy, check.state != State::Ok, "{check}");
        }
    }

    #[test]
    fn report_shows_every_check_and_a_summary() {
        let report = Report {
            checks: vec![
                Check::ok("one", "is there"),
                Check::warn("two", "is slow", "buy another"),
                Check::fail("three", "is missing", "install it"),
            ],
        };
        let text = report.to_string();
        for part in ["ok    one", "warn  two", "FAIL  three", "fix: install it"] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert!(text.ends_with("1 failures, 1 warnings; fix the failures first"));
    }

    #[test]
    fn state_of_the_report_is_that_of_the_worst_check() {
        let ok = Report {
            checks: vec![Check::ok("one", "is there")],
        };
        assert_eq!(ok.state(), State::Ok);
        assert_eq!(ok.to_string().lines().last(), Some("everything works"));
        assert_eq!(Report::default().state(), State::Ok);
    }
}
