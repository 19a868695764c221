//! What the rig writes and the server reads.

use super::settings::{Settings, SettingsChange, SettingsError};
use super::snapshot::Snapshot;
use crate::picture::Picture;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// The one thing that the rig and the server have in common. Every call is short: the
/// lock is held for a copy at most, never while something is encoded or sent, so the
/// frame's way is not held up by a browser.
pub struct SharedStatus {
    clock: Box<dyn Clock>,
    started: MonotonicTime,
    state: Mutex<State>,
    settings: watch::Sender<Settings>,
    picture: watch::Sender<Option<Arc<Picture>>>,
    environment: watch::Sender<Option<Arc<Picture>>>,
    watchers: watch::Sender<u32>,
    askers: AtomicU32,
}

#[derive(Default)]
struct State {
    snapshot: Snapshot,
    last_composed_at: Option<MonotonicTime>,
}

impl SharedStatus {
    /// A status whose settings, wished and in force, are `settings`.
    #[must_use]
    pub fn new(settings: Settings) -> Arc<Self> {
        Self::with_clock(settings, Box::new(SystemClock::start()))
    }

    /// The same with a time of one's own.
    #[must_use]
    pub fn with_clock(settings: Settings, clock: Box<dyn Clock>) -> Arc<Self> {
        let snapshot = Snapshot {
            settings: settings.clone(),
            ..Snapshot::default()
        };
        let state = State {
            snapshot,
            last_composed_at: None,
        };
        Arc::new(Self {
            started: clock.now(),
            clock,
            state: Mutex::new(state),
            settings: watch::Sender::new(settings),
            picture: watch::Sender::new(None),
            environment: watch::Sender::new(None),
            watchers: watch::Sender::new(0),
            askers: AtomicU32::new(0),
        })
    }

    /// Changes the snapshot in place, which allocates nothing where the change does not.
    /// A rise of `frames.composed` is what `/healthz` calls a frame.
    pub fn update(&self, change: impl FnOnce(&mut Snapshot)) {
        let now = self.clock.now();
        let mut state = self.lock();
        let composed_before = state.snapshot.frames.composed;
        change(&mut state.snapshot);
        if state.snapshot.frames.composed != composed_before {
            state.last_composed_at = Some(now);
        }
    }

    /// Replaces the whole snapshot, except for what the server itself fills in.
    pub fn publish_snapshot(&self, snapshot: Snapshot) {
        self.update(|current| {
            let stream = current.stream;
            let preview_revision = current.lighting.preview_revision;
            *current = snapshot;
            current.stream = stream;
            current.lighting.preview_revision = preview_revision;
        });
    }

    /// A copy of the snapshot, with the ages of now.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let now = self.clock.now();
        let (mut snapshot, last) = {
            let state = self.lock();
            (state.snapshot.clone(), state.last_composed_at)
        };
        snapshot.program.uptime_seconds = now.seconds_since(self.started);
        snapshot.frames.last_age_ms = last.map(|at| now.seconds_since(at) * 1e3);
        snapshot.stream.viewers = *self.watchers.borrow();
        snapshot
    }

    /// The newest composited picture. Needed only while [`Self::wants_picture`], and once
    /// more at the end of a recording, so that the last picture stays.
    pub fn publish_picture(&self, picture: Arc<Picture>) {
        self.picture.send_replace(Some(picture));
    }

    /// The environment map as an equirectangular preview with the dome lights drawn on it.
    pub fn publish_environment_preview(&self, preview: Arc<Picture>) {
        self.environment.send_replace(Some(preview));
        self.update(|s| s.lighting.preview_revision += 1);
    }

    /// Whether somebody looks at the picture, so that reading it back is worth it.
    #[must_use]
    pub fn wants_picture(&self) -> bool {
        *self.watchers.borrow() > 0 || self.askers.load(Ordering::Relaxed) > 0
    }

    /// The settings wished for; the newest wins.
    #[must_use]
    pub fn settings_receiver(&self) -> watch::Receiver<Settings> {
        self.settings.subscribe()
    }

    /// Grants a wish for settings, or says why not; answers all that is wished for now.
    ///
    /// # Errors
    /// A value that cannot be had; nothing changes then.
    pub fn wish(&self, change: &SettingsChange) -> Result<Settings, SettingsError> {
        let mut answer = Ok(());
        self.settings.send_if_modified(|wished| {
            let granted = change.apply_to(wished);
            answer = granted.as_ref().map(|_| ()).map_err(Clone::clone);
            granted.is_ok_and(|new| std::mem::replace(wished, new.clone()) != new)
        });
        answer.map(|()| self.settings.borrow().clone())
    }

    /// The composited pictures as they come; the newest wins.
    #[must_use]
    pub fn pictures(&self) -> watch::Receiver<Option<Arc<Picture>>> {
        self.picture.subscribe()
    }

    /// The newest preview of the environment.
    #[must_use]
    pub fn environment_preview(&self) -> Option<Arc<Picture>> {
        self.environment.borrow().clone()
    }

    /// How many watch the stream, as it changes.
    #[must_use]
    pub fn watchers(&self) -> watch::Receiver<u32> {
        self.watchers.subscribe()
    }

    /// Counts one more who watches the stream, until the guard is dropped.
    #[must_use]
    pub fn watch(self: &Arc<Self>) -> Watching {
        self.watchers.send_modify(|n| *n += 1);
        Watching(Arc::clone(self))
    }

    /// Counts one more who asks for a single picture, until the guard is dropped.
    #[must_use]
    pub fn ask(self: &Arc<Self>) -> Asking {
        self.askers.fetch_add(1, Ordering::Relaxed);
        Asking(Arc::clone(self))
    }

    /// A panic elsewhere must not take the status away, so a poisoned lock is used on.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Somebody watches the stream.
pub struct Watching(Arc<SharedStatus>);

impl Drop for Watching {
    fn drop(&mut self) {
        self.0.watchers.send_modify(|n| *n = n.saturating_sub(1));
    }
}

/// Somebody asks for one picture.
pub struct Asking(Arc<SharedStatus>);

impl Drop for Asking {
    fn drop(&mut self) {
        self.0.askers.fetch_sub(1, Ordering::Relaxed);
    }
}
