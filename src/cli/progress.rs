//! The progress of long-running commands: one line that is updated on a terminal, otherwise a plain
//! line every ten seconds; on standard error, and nothing with `--quiet`.

use indicatif::{ProgressBar, ProgressStyle};
use penumbra_interface::threads;
use std::cell::Cell;
use std::io::{IsTerminal as _, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval of plain lines.
const PLAIN_INTERVAL: Duration = Duration::from_secs(10);
/// Interval at which the state of work on another thread is read.
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Units of a bar.
const UNITS: f64 = 1000.0;

static QUIET: AtomicBool = AtomicBool::new(false);

/// Shows no progress from now on.
pub fn silence() {
    QUIET.store(true, Ordering::Relaxed);
}

/// The progress of one task.
pub struct Progress {
    what: &'static str,
    bar: ProgressBar,
    begun: Instant,
    /// The last plain line; `None` on a terminal and with `--quiet`.
    printed: Option<Cell<Instant>>,
    share: Cell<f64>,
}

impl Progress {
    /// Begins to show the progress of `what`, e.g. "baking".
    pub fn new(what: &'static str) -> Self {
        let is_quiet = QUIET.load(Ordering::Relaxed);
        let bar = if is_quiet {
            ProgressBar::hidden()
        } else {
            // indicatif hides the bar if standard error is not a terminal.
            ProgressBar::new(UNITS as u64)
        };
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent} % {msg}") {
            bar.set_style(style);
        }
        let begun = Instant::now();
        let is_plain = !is_quiet && !std::io::stderr().is_terminal();
        Self {
            what,
            bar,
            begun,
            printed: is_plain.then(|| Cell::new(begun)),
            share: Cell::new(0.0),
        }
    }

    /// Sets the share that is done, 0 to 1.
    pub fn set(&self, share: f64) {
        self.show(share, "");
    }

    /// Sets the share that is done, with a message.
    pub fn show(&self, share: f64, message: &str) {
        let share = if share.is_finite() {
            share.clamp(0.0, 1.0)
        } else {
            0.0
        };
        self.share.set(share);
        let text = describe(share, self.begun.elapsed(), message);
        if let Some(printed) = &self.printed
            && printed.get().elapsed() >= PLAIN_INTERVAL
        {
            printed.set(Instant::now());
            let percent = (100.0 * share) as u32;
            let line = format!("{}: {percent} %{}{text}", self.what, separator(&text));
            let _ = writeln!(std::io::stderr().lock(), "{line}");
        }
        self.bar.set_position((UNITS * share) as u64);
        self.bar.set_message(text);
    }

    /// Prints to standard output without the line of the progress.
    pub fn aside(&self, print: impl FnOnce()) {
        self.bar.suspend(print);
    }

    /// Removes the line on a terminal.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}

const fn separator(text: &str) -> &'static str {
    if text.is_empty() { "" } else { ", " }
}

/// Describes the time left and a message.
fn describe(share: f64, elapsed: Duration, message: &str) -> String {
    let left = time_left(share, elapsed).map(|left| format!("{} left", duration(left)));
    let parts = [left.as_deref().unwrap_or(""), message];
    let parts: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    parts.join("; ")
}

/// Estimates the time left; `None` during the first two seconds and the first per cent.
fn time_left(share: f64, elapsed: Duration) -> Option<Duration> {
    let is_known = share >= 0.01 && elapsed >= Duration::from_secs(2);
    is_known.then(|| elapsed.mul_f64((1.0 - share) / share))
}

/// Formats a duration: `40 s`, `3 min 20 s`, `2 h 5 min`.
fn duration(time: Duration) -> String {
    let seconds = time.as_secs();
    let (minutes, hours) = (seconds / 60, seconds / 3600);
    match seconds {
        0..60 => format!("{seconds} s"),
        60..3600 => format!("{minutes} min {} s", seconds % 60),
        _ => format!("{hours} h {} min", minutes % 60),
    }
}

/// Shows the progress of work on another thread, until it is dropped.
pub struct Watch {
    is_done: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Begins to show the progress of `what`; `share` returns what is done, 0 to 1, `None` if it is
    /// not known.
    pub fn start(
        what: &'static str,
        share: impl Fn() -> Option<f64> + Send + 'static,
    ) -> std::io::Result<Self> {
        let is_done = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&is_done);
        let thread = threads::spawn("progress", move || {
            let progress = Progress::new(what);
            while !is_over.load(Ordering::Relaxed) {
                if let Some(share) = share() {
                    progress.set(share);
                }
                std::thread::park_timeout(POLL_INTERVAL);
            }
            progress.finish();
        })?;
        Ok(Self {
            is_done,
            thread: Some(thread),
        })
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.is_done.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_is_estimated_from_what_is_done() {
        let seconds = Duration::from_secs;
        assert_eq!(time_left(0.25, seconds(20)), Some(seconds(60)));
        assert_eq!(time_left(0.25, seconds(1)), None);
        assert_eq!(time_left(0.001, seconds(20)), None);
        assert_eq!(
            describe(0.5, seconds(200), "12 views"),
            "3 min 20 s left; 12 views"
        );
        assert_eq!(describe(0.0, seconds(200), ""), "");
        assert_eq!(duration(seconds(59)), "59 s");
        assert_eq!(duration(seconds(7500)), "2 h 5 min");
    }
}
