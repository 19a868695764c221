//! `penumbra doctor`: what works on this machine, and the command that mends what doesn't.
//!
//! [`examine`] looks at the graphics driver (`graphics`), at the permissions of cameras,
//! GPUs and serial ports (`devices`) and at ports, display and disk (`machine`), and
//! changes nothing: no device is opened but the GPU.

#[cfg(unix)]
mod devices;
mod graphics;
mod machine;

use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;

/// What to examine.
#[derive(Clone, Debug)]
pub struct DoctorOptions {
    /// Where status would listen.
    pub listen: SocketAddr,
    /// Where sessions would be recorded.
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

/// How a check came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// Works.
    Ok,
    /// Works with less than it could, or is needed by some uses only.
    Warn,
    /// The program cannot do its work.
    Fail,
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// What was looked at.
    pub name: &'static str,
    /// How it came out.
    pub state: State,
    /// What was found, one sentence.
    pub found: String,
    /// The command or the act that mends it; always there unless the state is Ok.
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

/// All checks, in the order in which mending them makes sense.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// The checks.
    pub checks: Vec<Check>,
}

impl Report {
    /// The worst outcome; Ok for an empty report.
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
                "{} failures, {} warnings; mend the failures first",
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
            Some(remedy) => write!(f, "\n      {:<16} mend: {remedy}", ""),
            None => Ok(()),
        }
    }
}

/// Looks at everything. Takes about a second: the shaders are compiled.
#[must_use]
pub fn examine(options: &DoctorOptions) -> Report {
    let mut checks = graphics::examine(options);
    // Elsewhere devices are no files, and no groups own them.
    #[cfg(unix)]
    checks.extend(devices::examine(&options.root));
    checks.extend(machine::examine(options));
    Report { checks }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
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
    fn whatever_is_not_ok_says_how_to_mend_it() {
        let (_root, mut options) = bare();
        options.adapter = Some("no such adapter".into());
        options.recordings = PathBuf::from("/no/such/folder");
        let report = examine(&options);
        assert_eq!(report.state(), State::Fail);
        for check in &report.checks {
            let told = check.remedy.as_ref().is_some_and(|r| !r.is_empty());
            assert_eq!(told, check.state != State::Ok, "{check}");
        }
    }

    #[test]
    fn the_report_shows_every_check_and_a_verdict() {
        let report = Report {
            checks: vec![
                Check::ok("one", "is there"),
                Check::warn("two", "is slow", "buy another"),
                Check::fail("three", "is missing", "install it"),
            ],
        };
        let text = report.to_string();
        for part in ["ok    one", "warn  two", "FAIL  three", "mend: install it"] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert!(text.ends_with("1 failures, 1 warnings; mend the failures first"));
    }

    #[test]
    fn the_worst_check_is_the_report_s_state() {
        let ok = Report {
            checks: vec![Check::ok("one", "is there")],
        };
        assert_eq!(ok.state(), State::Ok);
        assert_eq!(ok.to_string().lines().last(), Some("everything works"));
        assert_eq!(Report::default().state(), State::Ok);
    }
}
