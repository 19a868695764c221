//! The log of an operator: what happened to the rig, when, and how serious it is.
//!
//! Entries are made from changes of the snapshot, so that everything in the status appears in the log
//! without further calls, and a frame without changes costs a few comparisons.

use super::recording::RecordingState;
use super::registration::RegistrationSource;
use super::snapshot::{DeviceState, SessionState, Snapshot};
use penumbra_interface::DeviceKind;
use serde::Serialize;
use std::collections::VecDeque;
use std::time::{SystemTime, UNIX_EPOCH};

/// Maximum number of entries; older ones are dropped.
const MAX_ENTRIES: usize = 500;
/// An entry that repeats one of this many newest ones is counted instead.
const REPEATS: usize = 8;
/// Maximum length of a text, bytes.
const MAX_TEXT_BYTES: usize = 1000;

/// Whether one text says what the other says, as status and log do of one event.
fn are_related(a: &str, b: &str) -> bool {
    a.contains(b) || b.contains(a)
}

/// How serious an entry is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// A normal event.
    Info,
    /// Something is not as it should be; the rig goes on.
    Warning,
    /// Something has failed.
    Error,
}

/// An entry of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LogEntry {
    /// Number, increasing; a repeated entry gets a new one.
    pub number: u64,
    /// When it happened last, milliseconds since 1970 (UTC).
    pub unix_ms: u64,
    /// How serious it is.
    pub level: Level,
    /// What happened.
    pub text: String,
    /// How often.
    pub count: u64,
    /// Whether it comes from the program's log on standard error. What stands there and in the status is
    /// one event.
    #[serde(skip)]
    pub is_forwarded: bool,
}

/// The log and what it knows of the snapshot.
#[derive(Debug, Default)]
pub(crate) struct Log {
    entries: VecDeque<LogEntry>,
    newest: u64,
    seen: Seen,
}

/// The parts of the last snapshot whose changes are events.
#[derive(Debug, Default)]
struct Seen {
    session: SessionState,
    devices: Vec<(DeviceKind, DeviceState)>,
    warnings: Vec<String>,
    stale: bool,
    has_pose: Option<bool>,
    losses: u64,
    recording: RecordingState,
    loads: u64,
}

impl Log {
    /// Number of the newest entry; 0 without entries.
    pub const fn newest(&self) -> u64 {
        self.newest
    }

    /// Returns the entries after number `after`.
    pub fn since(&self, after: u64) -> Vec<LogEntry> {
        let newer = self.entries.iter().filter(|e| e.number > after);
        newer.cloned().collect()
    }

    /// Adds an entry.
    pub fn add(&mut self, level: Level, text: &str) {
        // The program's log has said the same before.
        let recent = self.entries.len().saturating_sub(REPEATS);
        let is_same = |e: &LogEntry| e.is_forwarded && are_related(&e.text, text);
        let said = (recent..self.entries.len()).find(|&i| is_same(&self.entries[i]));
        if let Some(said) = said {
            self.entries.remove(said);
        }
        self.enter(level, text, false);
    }

    /// Adds an entry of the program's log on standard error, unless the status has reported the same.
    pub fn forward(&mut self, level: Level, text: &str) {
        let mut recent = self.entries.iter().rev().take(REPEATS);
        if !recent.any(|e| !e.is_forwarded && are_related(&e.text, text)) {
            self.enter(level, text, true);
        }
    }

    fn enter(&mut self, level: Level, text: &str, is_forwarded: bool) {
        let text = &text[..text.floor_char_boundary(MAX_TEXT_BYTES)];
        self.newest += 1;
        let recent = self.entries.len().saturating_sub(REPEATS);
        let repeated = (recent..self.entries.len())
            .find(|&i| self.entries[i].text == text && self.entries[i].level == level)
            .and_then(|i| self.entries.remove(i));
        if self.entries.len() == MAX_ENTRIES {
            self.entries.pop_front();
        }
        let now = now().duration_since(UNIX_EPOCH);
        self.entries.push_back(LogEntry {
            number: self.newest,
            unix_ms: now.map_or(0, |d| d.as_millis() as u64),
            level,
            text: text.to_owned(),
            count: repeated.map_or(1, |e| e.count + 1),
            is_forwarded,
        });
    }

    /// Adds entries for what has changed since the last call.
    pub fn compare(&mut self, s: &Snapshot) {
        self.session(s);
        self.devices(s);
        self.warnings(s);
        self.light_and_pose(s);
        self.others(s);
    }

    fn session(&mut self, s: &Snapshot) {
        if self.seen.session == s.session.state {
            return;
        }
        self.seen.session = s.session.state;
        let level = match s.session.state {
            SessionState::Failed => Level::Error,
            _ => Level::Info,
        };
        self.add(level, &s.session.description);
    }

    fn devices(&mut self, s: &Snapshot) {
        let same = |(seen, d): (&(DeviceKind, DeviceState), &super::snapshot::Device)| {
            *seen == (d.kind, d.state)
        };
        let known = &self.seen.devices;
        if known.len() == s.devices.len() && known.iter().zip(&s.devices).all(same) {
            return;
        }
        for device in &s.devices {
            let known = self.seen.devices.iter().find(|(k, _)| *k == device.kind);
            if known.is_some_and(|(_, state)| *state == device.state) {
                continue;
            }
            let level = match device.state {
                DeviceState::Failed => Level::Error,
                DeviceState::Silent | DeviceState::Retrying => Level::Warning,
                _ => Level::Info,
            };
            let kind = device.kind.label().replace('-', " ");
            let what = device.reason.as_deref().unwrap_or(device.description);
            self.add(level, &format!("{kind}, {}: {what}", device.state.label()));
        }
        self.seen.devices = s.devices.iter().map(|d| (d.kind, d.state)).collect();
    }

    fn warnings(&mut self, s: &Snapshot) {
        let same = |(seen, w): (&String, &super::snapshot::Warning)| *seen == w.text;
        let known = &self.seen.warnings;
        if known.len() == s.warnings.len() && known.iter().zip(&s.warnings).all(same) {
            return;
        }
        let known = std::mem::take(&mut self.seen.warnings);
        for warning in s.warnings.iter().filter(|w| !known.contains(&w.text)) {
            self.add(Level::Warning, &warning.text);
        }
        let cleared = known
            .iter()
            .filter(|text| s.warnings.iter().all(|w| w.text != **text));
        for text in cleared {
            self.add(Level::Info, &format!("resolved: {text}"));
        }
        self.seen.warnings = s.warnings.iter().map(|w| w.text.clone()).collect();
    }

    fn light_and_pose(&mut self, s: &Snapshot) {
        let stale = s.lighting.stale.as_deref();
        if self.seen.stale != stale.is_some() {
            self.seen.stale = stale.is_some();
            match stale {
                Some(reason) => self.add(Level::Warning, &format!("the light is old: {reason}")),
                None => self.add(Level::Info, "the light is up to date again"),
            }
        }
        let has_pose = s.registration.source != RegistrationSource::None;
        if s.frames.composed > 0 && self.seen.has_pose != Some(has_pose) {
            match self.seen.has_pose.replace(has_pose) {
                None if has_pose => (),
                _ if has_pose => self.add(Level::Info, "the scene camera's pose is known again"),
                _ => self.add(
                    Level::Warning,
                    "the scene camera's pose is unknown: its picture is shown without virtual objects",
                ),
            }
        }
    }

    fn others(&mut self, s: &Snapshot) {
        if s.adapter.losses > self.seen.losses {
            self.add(
                Level::Error,
                &format!(
                    "the graphics device was lost; {} replaces it",
                    s.adapter.name
                ),
            );
        }
        self.seen.losses = s.adapter.losses;
        if s.recording.state != self.seen.recording {
            self.seen.recording = s.recording.state;
            let file = s.recording.file.as_deref().unwrap_or_default();
            match s.recording.state {
                RecordingState::Recording => self.add(Level::Info, &format!("recording {file}")),
                RecordingState::Finished => self.add(Level::Info, &format!("recorded {file}")),
                RecordingState::Failed => self.add(Level::Error, &s.recording.description),
                RecordingState::Unavailable | RecordingState::Idle => (),
            }
        }
        if s.scene.loads > self.seen.loads {
            self.add(Level::Info, "a changed scene is shown");
        }
        self.seen.loads = s.scene.loads;
    }
}

/// The time of day.
#[expect(
    clippy::disallowed_methods,
    reason = "operators compare the log with other clocks; nothing is computed from it"
)]
fn now() -> SystemTime {
    SystemTime::now()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::Device;

    fn texts(log: &Log) -> Vec<(Level, String)> {
        let entries = log.since(0).into_iter();
        entries.map(|e| (e.level, e.text)).collect()
    }

    #[test]
    fn events_are_changes_of_the_status() {
        let (mut log, mut s) = (Log::default(), Snapshot::default());
        log.compare(&s);
        assert_eq!(log.newest(), 0, "nothing has happened");
        s.devices = vec![Device::new("a", DeviceKind::Tracker)];
        s.devices[0].enter(DeviceState::Failed, Some("a: no such device"));
        s.warn("b");
        s.lighting.stale = Some("c".to_owned());
        log.compare(&s);
        log.compare(&s);
        let expected = [
            (Level::Error, "tracker, failed: a: no such device"),
            (Level::Warning, "b"),
            (Level::Warning, "the light is old: c"),
        ];
        assert_eq!(texts(&log), expected.map(|(l, t)| (l, t.to_owned())));
        let before = log.newest();
        s.clear_warning("b");
        s.lighting.stale = None;
        s.session.enter_because(SessionState::Failed, "d");
        log.compare(&s);
        let newer: Vec<_> = log.since(before).into_iter().map(|e| e.text).collect();
        assert_eq!(newer, ["d", "resolved: b", "the light is up to date again"]);
    }

    #[test]
    fn repeated_entries_are_counted_and_the_log_is_bounded() {
        let mut log = Log::default();
        for _ in 0..100 {
            log.add(Level::Warning, "lost");
            log.add(Level::Info, "found");
        }
        let entries = log.since(0);
        assert_eq!(entries.len(), 2);
        assert_eq!((entries[1].count, entries[1].number), (100, 200));
        (0..2000).for_each(|i| log.add(Level::Info, &i.to_string()));
        log.add(Level::Error, &"ü".repeat(5000));
        let entries = log.since(0);
        assert_eq!(entries.len(), MAX_ENTRIES);
        assert!(entries.iter().all(|e| e.text.len() <= MAX_TEXT_BYTES));
        assert!(log.since(log.newest()).is_empty());
    }
}
