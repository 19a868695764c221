//! The program under test, run as a user would.

use rustix::process::{Pid, Signal, kill_process};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Runs the program, which must succeed; returns its output.
pub fn succeeds(arguments: &[&str]) -> String {
    let output = Command::new("penumbra")
        .args(arguments)
        .output()
        .expect("penumbra starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "penumbra {arguments:?}: {}\n{errors}",
        output.status
    );
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// The running program; dropping it kills it.
pub struct Running {
    child: Child,
    log: PathBuf,
}

impl Running {
    /// Starts the program; its output goes to a file that the host keeps.
    pub fn start(arguments: &[&str], log: &Path) -> Self {
        let file = File::create(log).unwrap();
        let child = Command::new("penumbra")
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(file.try_clone().unwrap())
            .stderr(file)
            .spawn()
            .expect("penumbra starts");
        Self {
            child,
            log: log.to_owned(),
        }
    }

    /// The output so far.
    pub fn output(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap_or_default()
    }

    /// Processor time so far by thread name, nanoseconds.
    pub fn thread_times(&self) -> BTreeMap<String, u64> {
        let tasks = format!("/proc/{}/task", self.child.id());
        let tasks = std::fs::read_dir(tasks).into_iter().flatten().flatten();
        let times = tasks.filter_map(|task| {
            let read = |name: &str| std::fs::read_to_string(task.path().join(name)).ok();
            let spent = read("schedstat")?.split(' ').next()?.parse().ok()?;
            Some((read("comm")?.trim_end().to_owned(), spent))
        });
        times.collect()
    }

    /// Waits up to ten seconds for a condition; fails if the program ends before.
    pub fn wait_until(&mut self, what: &str, is_true: impl Fn(&str) -> bool) {
        let began = Instant::now();
        while !is_true(&self.output()) {
            let status = self.child.try_wait().unwrap();
            let is_over = status.is_some() || began.elapsed() > Duration::from_secs(10);
            assert!(!is_over, "never: {what} ({status:?})\n{}", self.output());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits for the program to end by itself.
    pub fn end(mut self, within: Duration) -> ExitStatus {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            assert!(began.elapsed() < within, "does not end:\n{}", self.output());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Interrupts the program like Ctrl-C; it must end successfully.
    pub fn stop(self) {
        self.signal(Signal::INT);
        let log = self.log.clone();
        let status = self.end(Duration::from_secs(10));
        let output = std::fs::read_to_string(log).unwrap_or_default();
        assert!(status.success(), "{status}\n{output}");
    }

    /// Kills the program.
    pub fn kill(self) {
        self.signal(Signal::KILL);
        self.end(Duration::from_secs(5));
    }

    fn signal(&self, signal: Signal) {
        let pid = Pid::from_child(&self.child);
        kill_process(pid, signal).expect("it runs");
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // An error means that it has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
