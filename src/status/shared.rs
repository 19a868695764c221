//! The state shared by the rig, which writes it, and the server, which reads it.

use super::calibration::CalibrationControl;
use super::guide::GuideStatus;
use super::log::{Level, Log, LogEntry};
use super::memory::Memory;
use super::objects::{ObjectAnswer, ObjectControl, ObjectRefusal, ObjectRequest};
use super::playback::{Playback, PlaybackChange, PlaybackRefusal, PlaybackStatus};
use super::recording::{Recording, RecordingControl, RecordingRefusal, RecordingRequest};
use super::scene_files::SceneControl;
use super::settings::{Settings, SettingsChange, SettingsError};
use super::snapshot::Snapshot;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_picture::Picture;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use tokio::sync::watch;

/// The state shared by the rig and the server. The lock is held for a copy at most, never while
/// something is encoded or sent, so that a browser cannot delay a frame.
pub struct SharedStatus {
    clock: Box<dyn Clock>,
    started: MonotonicTime,
    state: Mutex<State>,
    settings: watch::Sender<Settings>,
    playback: watch::Sender<Playback>,
    configured: Settings,
    composite: Outlet,
    pair: Outlet,
    environment: watch::Sender<Option<Arc<Picture>>>,
    askers: AtomicU32,
    recorder: OnceLock<Arc<dyn RecordingControl>>,
    calibrator: OnceLock<Arc<dyn CalibrationControl>>,
    objects: OnceLock<Arc<dyn ObjectControl>>,
    scenes: OnceLock<Arc<dyn SceneControl>>,
    /// Entries of the program's log that wait to be added.
    forwarded: Mutex<Vec<(Level, String)>>,
    /// The sheet of a webcam's rig, a PDF.
    sheet: OnceLock<Arc<[u8]>>,
}

/// Maximum number of entries of the program's log that wait.
const MAX_FORWARDED: usize = 100;

#[derive(Default)]
struct State {
    snapshot: Snapshot,
    last_composed_at: Option<MonotonicTime>,
    log: Log,
}

impl SharedStatus {
    /// Creates a status with `settings` as requested and active settings.
    #[must_use]
    pub fn new(settings: Settings) -> Arc<Self> {
        Self::with_clock(settings, Box::new(SystemClock))
    }

    /// As [`Self::new`], with a given clock.
    #[must_use]
    pub fn with_clock(settings: Settings, clock: Box<dyn Clock>) -> Arc<Self> {
        let snapshot = Snapshot {
            settings: settings.clone(),
            ..Snapshot::default()
        };
        let state = State {
            snapshot,
            ..State::default()
        };
        Arc::new(Self {
            started: clock.now(),
            clock,
            state: Mutex::new(state),
            configured: settings.clone(),
            playback: watch::Sender::new(Playback::default()),
            settings: watch::Sender::new(settings),
            composite: Outlet::default(),
            pair: Outlet::default(),
            environment: watch::Sender::new(None),
            askers: AtomicU32::new(0),
            recorder: OnceLock::new(),
            calibrator: OnceLock::new(),
            objects: OnceLock::new(),
            scenes: OnceLock::new(),
            forwarded: Mutex::default(),
            sheet: OnceLock::new(),
        })
    }

    /// Changes the snapshot in place, without allocation of its own. `/healthz` counts an increase
    /// of `frames.composed` as a frame.
    pub fn update(&self, change: impl FnOnce(&mut Snapshot)) {
        let now = self.clock.now();
        let mut state = self.lock();
        let composed_before = state.snapshot.frames.composed;
        change(&mut state.snapshot);
        if state.snapshot.frames.composed != composed_before {
            state.last_composed_at = Some(now);
        }
        let State { snapshot, log, .. } = &mut *state;
        log.compare(snapshot);
        self.add_forwarded(&mut state);
    }

    /// Replaces the snapshot, except for the fields that the server fills in.
    pub fn publish_snapshot(&self, snapshot: Snapshot) {
        self.update(|current| {
            let stream = current.stream;
            let preview_revision = current.lighting.preview_revision;
            *current = snapshot;
            current.stream = stream;
            current.lighting.preview_revision = preview_revision;
        });
    }

    /// Returns a copy of the snapshot with current ages.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let now = self.clock.now();
        let (mut snapshot, last) = {
            let mut state = self.lock();
            self.add_forwarded(&mut state);
            let mut snapshot = state.snapshot.clone();
            snapshot.log.newest = state.log.newest();
            (snapshot, state.last_composed_at)
        };
        snapshot.program.uptime_seconds = now.seconds_since(self.started);
        snapshot.program.memory = Memory::now();
        if let Some(warning) = snapshot.program.memory.warning() {
            snapshot.warn(warning);
        }
        snapshot.frames.last_age_ms = last.map(|at| now.seconds_since(at) * 1e3);
        let viewers = [&self.composite, &self.pair].map(|outlet| *outlet.watchers.borrow());
        snapshot.stream.viewers = viewers.iter().sum();
        let playback = *self.playback.borrow();
        snapshot.playback.paused = playback.paused;
        snapshot.playback.repeat = playback.repeat;
        snapshot.playback.jumps_requested = playback.jumps;
        snapshot.settings_requested = self.settings.borrow().clone();
        snapshot.settings_configured = self.configured.clone();
        if let Some(guide) = snapshot.guide.take() {
            let steps = super::guide::steps(&guide, &snapshot);
            snapshot.guide = Some(GuideStatus { steps, ..guide });
        }
        snapshot
    }

    /// Returns the entries of the log after number `after`, oldest first.
    #[must_use]
    pub fn log_since(&self, after: u64) -> Vec<LogEntry> {
        let mut state = self.lock();
        self.add_forwarded(&mut state);
        state.log.since(after)
    }

    /// Publishes the newest composited picture. Needed only while [`Self::wants_picture`], and once
    /// at the end of a recording, so that the last picture remains.
    pub fn publish_picture(&self, picture: Arc<Picture>) {
        self.composite.pictures.send_replace(Some(picture));
    }

    /// Publishes the newest composited picture with the camera's picture of the same frame below it.
    /// Needed only while [`Self::wants_pair`].
    pub fn publish_pair(&self, pair: Arc<Picture>) {
        self.pair.pictures.send_replace(Some(pair));
    }

    /// Publishes the environment map as an equirectangular preview with the dome lights marked.
    pub fn publish_environment_preview(&self, preview: Arc<Picture>) {
        self.environment.send_replace(Some(preview));
        self.update(|s| s.lighting.preview_revision += 1);
    }

    /// Whether a viewer needs the picture to be read back.
    #[must_use]
    pub fn wants_picture(&self) -> bool {
        self.composite.is_watched() || self.askers.load(Ordering::Relaxed) > 0
    }

    /// Whether a viewer compares the picture with the camera's.
    #[must_use]
    pub fn wants_pair(&self) -> bool {
        self.pair.is_watched()
    }

    /// A stream needs no pictures until the guard is dropped.
    #[must_use]
    pub fn pause_pictures(self: &Arc<Self>, view: View) -> Pausing {
        self.outlet(view).is_paused.store(true, Ordering::Relaxed);
        Pausing(Arc::clone(self), view)
    }

    const fn outlet(&self, view: View) -> &Outlet {
        match view {
            View::Composite => &self.composite,
            View::Pair => &self.pair,
        }
    }

    /// Returns the requested settings; the newest request wins.
    #[must_use]
    pub fn settings_receiver(&self) -> watch::Receiver<Settings> {
        self.settings.subscribe()
    }

    /// Applies a change of settings and returns all requested settings.
    ///
    /// # Errors
    /// A value is invalid; then nothing changes.
    pub fn request_settings(&self, change: &SettingsChange) -> Result<Settings, SettingsError> {
        let mut answer = Ok(());
        let mut before = None;
        self.settings.send_if_modified(|requested| {
            let changed = change.apply_to(requested);
            answer = changed.as_ref().map(|_| ()).map_err(Clone::clone);
            let Some(new) = changed.ok().filter(|new| new != requested) else {
                return false;
            };
            before = Some(std::mem::replace(requested, new));
            true
        });
        let after = answer.map(|()| self.settings.borrow().clone())?;
        if let Some(before) = before {
            let text = after.changes_from(&before);
            self.lock().log.add(Level::Info, &text);
        }
        Ok(after)
    }

    /// Opens the playback to requests, or states why it is closed to them.
    pub fn open_playback(&self, repeat: bool, duration_s: Option<f64>, closed: Option<&str>) {
        self.playback
            .send_modify(|playback| playback.repeat = repeat);
        self.update(|s| {
            s.playback.closed = closed.map(str::to_owned);
            s.playback.duration_s = duration_s;
        });
    }

    /// Pauses, repeats or jumps, and returns the status of the playback.
    ///
    /// # Errors
    /// The playback cannot be controlled.
    pub fn play(&self, change: &PlaybackChange) -> Result<PlaybackStatus, PlaybackRefusal> {
        if let Some(reason) = self.lock().snapshot.playback.closed.clone() {
            return Err(PlaybackRefusal::Closed { reason });
        }
        self.playback
            .send_modify(|playback| change.apply_to(playback));
        Ok(self.snapshot().playback)
    }

    /// Pauses at the end of a recording that is no longer repeated.
    pub fn pause(&self) {
        self.playback.send_modify(|playback| playback.paused = true);
    }

    /// Returns the requested playback; the newest request wins.
    #[must_use]
    pub fn playback_receiver(&self) -> watch::Receiver<Playback> {
        self.playback.subscribe()
    }

    /// Sets the recorder that handles requests to record. Only the first call has an effect.
    pub fn set_recorder(&self, recorder: Arc<dyn RecordingControl>) {
        let _ = self.recorder.set(recorder);
    }

    /// Starts or stops a recording.
    ///
    /// # Errors
    /// There is no recorder, or it refuses the request.
    pub fn record(&self, request: &RecordingRequest) -> Result<Recording, RecordingRefusal> {
        let recorder = self.recorder.get().ok_or(RecordingRefusal::Unavailable)?;
        recorder.carry_out(request)
    }

    /// Sets what handles requests to move objects. Only the first call has an effect.
    pub fn set_object_control(&self, objects: Arc<dyn ObjectControl>) {
        let _ = self.objects.set(objects);
    }

    /// Answers what is at a place in the picture, or changes an object.
    ///
    /// # Errors
    /// The request cannot be met.
    pub fn change_object(&self, request: &ObjectRequest) -> Result<ObjectAnswer, ObjectRefusal> {
        let objects = self
            .objects
            .get()
            .ok_or_else(|| ObjectRefusal::Unavailable {
                reason: "the rig shows no virtual objects yet".to_owned(),
            })?;
        objects.carry_out(request)
    }

    /// Sets what handles requests to show other scenes. Only the first call has an effect.
    pub fn set_scene_control(&self, scenes: Arc<dyn SceneControl>) {
        let _ = self.scenes.set(scenes);
    }

    /// Returns what handles requests to show other scenes; `None` before the first scene is shown.
    #[must_use]
    pub fn scenes(&self) -> Option<Arc<dyn SceneControl>> {
        self.scenes.get().cloned()
    }

    /// Adds a warning or error of the program's log on standard error to the log. It may be called from
    /// anywhere: the entry waits until the status is used next.
    pub fn forward(&self, level: Level, text: &str) {
        let mut waiting = self
            .forwarded
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if waiting.len() < MAX_FORWARDED {
            waiting.push((level, text.to_owned()));
        }
    }

    /// Adds the entries that wait.
    fn add_forwarded(&self, state: &mut State) {
        let mut waiting = self
            .forwarded
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        for (level, text) in waiting.drain(..) {
            state.log.forward(level, &text);
        }
    }

    /// Adds an entry to the log.
    pub fn note(&self, level: Level, text: &str) {
        self.lock().log.add(level, text);
    }

    /// Sets the printed sheet of a webcam's rig, a PDF. Only the first call has an effect.
    pub fn set_sheet(&self, pdf: Vec<u8>) {
        let _ = self.sheet.set(pdf.into());
    }

    /// Returns that sheet; `None` for other rigs.
    #[must_use]
    pub fn sheet(&self) -> Option<Arc<[u8]>> {
        self.sheet.get().cloned()
    }

    /// Sets the calibrator that handles requests to calibrate. Only the first call has an effect.
    pub fn set_calibrator(&self, calibrator: Arc<dyn CalibrationControl>) {
        let _ = self.calibrator.set(calibrator);
    }

    /// Returns the calibrator; `None` while a recording plays.
    #[must_use]
    pub fn calibrator(&self) -> Option<Arc<dyn CalibrationControl>> {
        self.calibrator.get().cloned()
    }

    /// Subscribes to the pictures of a view; the newest wins.
    #[must_use]
    pub fn pictures(&self, view: View) -> watch::Receiver<Option<Arc<Picture>>> {
        self.outlet(view).pictures.subscribe()
    }

    /// Returns the newest preview of the environment.
    #[must_use]
    pub fn environment_preview(&self) -> Option<Arc<Picture>> {
        self.environment.borrow().clone()
    }

    /// Subscribes to the number of viewers of a stream.
    #[must_use]
    pub fn viewers(&self, view: View) -> watch::Receiver<u32> {
        self.outlet(view).watchers.subscribe()
    }

    /// Counts a viewer of a stream until the guard is dropped.
    #[must_use]
    pub fn count_viewer(self: &Arc<Self>, view: View) -> Watching {
        self.outlet(view).watchers.send_modify(|n| *n += 1);
        Watching(Arc::clone(self), view)
    }

    /// Counts a request for a single picture until the guard is dropped.
    #[must_use]
    pub fn ask(self: &Arc<Self>) -> Asking {
        self.askers.fetch_add(1, Ordering::Relaxed);
        Asking(Arc::clone(self))
    }

    /// Locks the state. A poisoned lock is still used: a panic elsewhere must not stop the status.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a stream shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// The composited picture.
    Composite,
    /// The same, with the camera's picture of the same frame below it.
    Pair,
}

/// The pictures of a view and the number of its viewers.
struct Outlet {
    pictures: watch::Sender<Option<Arc<Picture>>>,
    watchers: watch::Sender<u32>,
    /// The viewers have the last picture for a while.
    is_paused: AtomicBool,
}

impl Outlet {
    fn is_watched(&self) -> bool {
        *self.watchers.borrow() > 0 && !self.is_paused.load(Ordering::Relaxed)
    }
}

impl Default for Outlet {
    fn default() -> Self {
        Self {
            pictures: watch::Sender::new(None),
            watchers: watch::Sender::new(0),
            is_paused: AtomicBool::new(false),
        }
    }
}

/// Guard of a viewer of a stream.
pub struct Watching(Arc<SharedStatus>, View);

impl Drop for Watching {
    fn drop(&mut self) {
        let watchers = &self.0.outlet(self.1).watchers;
        watchers.send_modify(|n| *n = n.saturating_sub(1));
    }
}

/// Guard of a time in which a stream needs no pictures.
pub struct Pausing(Arc<SharedStatus>, View);

impl Drop for Pausing {
    fn drop(&mut self) {
        let paused = &self.0.outlet(self.1).is_paused;
        paused.store(false, Ordering::Relaxed);
    }
}

/// Guard of a request for one picture.
pub struct Asking(Arc<SharedStatus>);

impl Drop for Asking {
    fn drop(&mut self) {
        self.0.askers.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_interface::ManualClock;

    fn shared() -> (Arc<SharedStatus>, ManualClock) {
        let clock = ManualClock::default();
        (
            SharedStatus::with_clock(Settings::default(), Box::new(clock.clone())),
            clock,
        )
    }

    fn change(json: &str) -> SettingsChange {
        SettingsChange::from_json(json.as_bytes()).unwrap()
    }

    #[test]
    fn ages_are_computed_when_the_snapshot_is_read() {
        let (shared, clock) = shared();
        assert_eq!(shared.snapshot().frames.last_age_ms, None);
        clock.set(MonotonicTime::from_nanos(1_000_000_000));
        shared.update(|s| s.frames.composed += 1);
        clock.set(MonotonicTime::from_nanos(1_250_000_000));
        shared.update(|s| s.frames.arrived += 1);
        let snapshot = shared.snapshot();
        assert_eq!(snapshot.frames.last_age_ms, Some(250.0));
        assert_eq!(snapshot.program.uptime_seconds, 1.25);
    }

    #[test]
    fn published_snapshot_keeps_the_counts_of_the_server() {
        let (shared, _) = shared();
        let picture = Arc::new(Picture {
            width: 1,
            height: 1,
            rgba: vec![0; 4],
        });
        shared.publish_environment_preview(Arc::clone(&picture));
        shared.update(|s| s.stream.encoded = 7);
        shared.publish_snapshot(Snapshot::default());
        let snapshot = shared.snapshot();
        assert_eq!(
            (snapshot.stream.encoded, snapshot.lighting.preview_revision),
            (7, 1)
        );
    }

    #[test]
    fn pictures_are_requested_while_there_are_viewers() {
        let (shared, _) = shared();
        assert!(!shared.wants_picture());
        let viewer = || shared.count_viewer(View::Composite);
        let (first, second) = (viewer(), viewer());
        drop(first);
        assert!(shared.wants_picture());
        assert_eq!(shared.snapshot().stream.viewers, 1);
        drop(second);
        assert!(!shared.wants_picture());
        let comparing = shared.count_viewer(View::Pair);
        assert!(shared.wants_pair() && !shared.wants_picture());
        drop(comparing);
        assert!(!shared.wants_pair());
        let asking = shared.ask();
        assert!(shared.wants_picture());
        drop(asking);
        assert!(!shared.wants_picture());
    }

    #[test]
    fn changes_accumulate_and_refused_ones_have_no_effect() {
        let (shared, _) = shared();
        let mut requested = shared.settings_receiver();
        shared
            .request_settings(&change(r#"{"light_count": 8}"#))
            .unwrap();
        assert!(requested.has_changed().unwrap());
        assert_eq!(requested.borrow_and_update().light_count, 8);
        shared
            .request_settings(&change(r#"{"light_count": 24, "shadow_strength": 2}"#))
            .unwrap_err();
        shared
            .request_settings(&change(r#"{"light_count": 8}"#))
            .unwrap();
        assert!(
            !requested.has_changed().unwrap(),
            "nothing new was requested"
        );
        let both = shared
            .request_settings(&change(r#"{"shadow_strength": 0.5}"#))
            .unwrap();
        assert_eq!((both.light_count, both.shadow_strength), (8, 0.5));
        let snapshot = shared.snapshot();
        assert_eq!(
            snapshot.settings,
            Settings::default(),
            "only the rig sets the active settings"
        );
        assert_eq!(snapshot.settings_requested, both);
        assert_eq!(snapshot.settings_configured, Settings::default());
    }

    #[test]
    fn warnings_on_standard_error_are_in_the_log_once() {
        let (shared, _) = shared();
        let texts = || -> Vec<_> {
            let entries = shared.log_since(0).into_iter();
            entries.map(|e| (e.text, e.count)).collect()
        };
        // From anywhere, even while the status is being written.
        shared.update(|s| {
            shared.forward(Level::Warning, "the cache is read-only");
            s.stream.encoded += 1;
        });
        assert_eq!(texts(), [("the cache is read-only".to_owned(), 1)]);
        // In either order, what the status reports, too, is one event.
        shared.forward(Level::Warning, "no signal");
        shared.update(|s| s.warn("no signal"));
        shared.update(|s| s.warn("s.toml:2: no"));
        shared.forward(Level::Warning, "s.toml:2: no; the previous scene is kept");
        assert_eq!(
            texts()[1..],
            [("no signal".to_owned(), 1), ("s.toml:2: no".to_owned(), 1)]
        );
        (0..1000).for_each(|i| shared.forward(Level::Warning, &format!("{i} times")));
        assert_eq!(texts().len(), 3 + MAX_FORWARDED);
    }

    #[test]
    fn status_survives_a_panic_in_a_writer() {
        let (shared, _) = shared();
        let writer = Arc::clone(&shared);
        let job = move || writer.update(|_| panic!("on purpose"));
        let thread = penumbra_interface::threads::spawn("panics", job).unwrap();
        thread.join().unwrap_err();
        shared.update(|s| s.frames.composed = 3);
        assert_eq!(shared.snapshot().frames.composed, 3);
    }
}
