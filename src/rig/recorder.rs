//! Writes what arrives into a session, on a thread of its own. Nobody ever waits for it:
//! what it cannot take in time is dropped and counted.

use crate::error::RigError;
use crate::source::RigFiles;
use crate::wall_date::utc_now;
use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use penumbra_capture::{Hub, RecorderQueue};
use penumbra_config::RecordingConfig;
use penumbra_interface::threads;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_session::{SessionError, SessionEvent, SessionWriter};
use penumbra_status::SharedStatus;
use penumbra_status::recording::{
    Recording, RecordingControl, RecordingRefusal, RecordingRequest, RecordingState,
};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Events that may wait: several seconds of everything. Bytes have a limit of their own.
const WAITING: usize = 16_384;
/// What a killed recorder loses is younger than this and a little.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// Records what goes through a [`Hub`] when it is asked to.
pub struct Recorder {
    hub: Arc<Hub>,
    files: Arc<RigFiles>,
    config: RecordingConfig,
    status: Arc<SharedStatus>,
    running: Mutex<Option<Running>>,
}

struct Running {
    path: PathBuf,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Recording>,
}

impl Recorder {
    /// Ready to record what goes through `hub`, with `files` as attachments.
    #[must_use]
    pub fn new(
        hub: Arc<Hub>,
        files: Arc<RigFiles>,
        config: RecordingConfig,
        status: Arc<SharedStatus>,
    ) -> Arc<Self> {
        status.update(|s| {
            s.recording.state = RecordingState::Idle;
            "Nothing is being recorded.".clone_into(&mut s.recording.description);
        });
        Arc::new(Self {
            hub,
            files,
            config,
            status,
            running: Mutex::new(None),
        })
    }

    /// Begins a new file at `path`, to end after `longest`.
    ///
    /// # Errors
    /// One is being recorded; the file exists or cannot be made; the disk is as good as
    /// full.
    pub fn start(&self, path: &Path, longest: Option<Duration>) -> Result<(), RigError> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(busy) = running.as_ref().filter(|r| !r.thread.is_finished()) {
            return Err(RigError::Recording {
                path: busy.path.clone(),
            });
        }
        let configured = self.config.max_duration_nanos;
        let configured = configured.map(|nanos| Duration::from_nanos(nanos.unsigned_abs()));
        let writer = SessionWriter::create(path)?;
        let (events, waiting) = bounded(WAITING);
        let mut job = Job {
            writer,
            waiting,
            waiting_bytes: Arc::default(),
            dropped: Arc::default(),
            hub: Arc::clone(&self.hub),
            files: Arc::clone(&self.files),
            status: Arc::clone(&self.status),
            stop: Arc::default(),
            path: path.to_owned(),
            reserve_bytes: self.config.reserve_bytes,
            longest: [configured, longest].into_iter().flatten().min(),
            began: SystemClock.now(),
            flushed: SystemClock.now(),
            recording: Recording {
                file: Some(path.display().to_string()),
                ..Recording::default()
            },
        };
        let stop = Arc::clone(&job.stop);
        let queue = RecorderQueue::new(events, job.waiting_bytes.clone(), job.dropped.clone());
        // Before anybody is told that it has begun: who asks then is not to hear of the one
        // before.
        job.publish();
        self.hub.set_recorder(Some(queue));
        let thread = threads::spawn("record", move || job.run()).map_err(|source| {
            self.hub.set_recorder(None);
            let error = RigError::Thread { source };
            self.status.update(|s| {
                s.recording.state = RecordingState::Failed;
                s.recording.description = error.to_string();
            });
            error
        })?;
        *running = Some(Running {
            path: path.to_owned(),
            stop,
            thread,
        });
        Ok(())
    }

    /// Ends the recording, if there is one, in order, and says what became of it.
    pub fn stop(&self) -> Option<Recording> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        let running = running.take()?;
        running.stop.store(true, Ordering::Relaxed);
        running.thread.join().ok()
    }

    /// Whether a recording is under way.
    #[must_use]
    pub fn is_recording(&self) -> bool {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.as_ref().is_some_and(|r| !r.thread.is_finished())
    }

    /// A file in the recordings' folder, which is made if it is missing.
    fn place(&self, name: Option<&str>) -> Result<PathBuf, RecordingRefusal> {
        let folder = &self.config.folder;
        std::fs::create_dir_all(folder).map_err(|error| RecordingRefusal::Failed {
            reason: format!("{}: {error}", folder.display()),
        })?;
        let name = name.map_or_else(name_by_date, str::to_owned);
        Ok(folder.join(name))
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.stop();
    }
}

impl RecordingControl for Recorder {
    fn carry_out(&self, wish: &RecordingRequest) -> Result<Recording, RecordingRefusal> {
        if !wish.record {
            self.stop();
            return Ok(self.status.snapshot().recording);
        }
        let path = self.place(wish.file.as_deref())?;
        let longest = wish.seconds.map(Duration::from_secs_f64);
        match self.start(&path, longest) {
            Ok(()) => Ok(Recording {
                state: RecordingState::Recording,
                file: Some(path.display().to_string()),
                ..Recording::default()
            }),
            Err(RigError::Recording { path }) => Err(RecordingRefusal::Busy {
                file: path.display().to_string(),
            }),
            Err(error) => Err(RecordingRefusal::Failed {
                reason: error.to_string(),
            }),
        }
    }
}

/// How a recording ended.
enum End {
    /// As it was meant to.
    Asked(&'static str),
    /// Not enough room is left on the disk; the file was finished.
    Reserve,
    /// It cannot be written any more.
    Broken(SessionError),
}

/// One recording.
struct Job {
    writer: SessionWriter<BufWriter<File>>,
    waiting: Receiver<SessionEvent>,
    waiting_bytes: Arc<AtomicU64>,
    dropped: Arc<AtomicU64>,
    hub: Arc<Hub>,
    files: Arc<RigFiles>,
    status: Arc<SharedStatus>,
    stop: Arc<AtomicBool>,
    path: PathBuf,
    reserve_bytes: u64,
    longest: Option<Duration>,
    began: MonotonicTime,
    flushed: MonotonicTime,
    recording: Recording,
}

impl Job {
    fn run(mut self) -> Recording {
        let end = self.record().unwrap_or_else(End::Broken);
        self.hub.set_recorder(None);
        let end = match end {
            End::Broken(error) => End::Broken(error),
            end => match self.drain() {
                Ok(()) => end,
                Err(error) => End::Broken(error),
            },
        };
        self.finish(end)
    }

    fn record(&mut self) -> Result<End, SessionError> {
        for file in self.files.all() {
            self.writer.attach(&file.name, &file.data)?;
        }
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(End::Asked("Finished."));
            }
            match self.waiting.recv_timeout(FLUSH_EVERY / 4) {
                Ok(event) => self.write(&event)?,
                Err(RecvTimeoutError::Timeout) => (),
                Err(RecvTimeoutError::Disconnected) => return Ok(End::Asked("Finished.")),
            }
            let now = SystemClock.now();
            if now >= self.flushed + FLUSH_EVERY {
                self.flushed = now;
                self.writer.flush()?;
                self.publish();
                if self.free().is_some_and(|free| free < self.reserve_bytes) {
                    return Ok(End::Reserve);
                }
            }
            if self
                .longest
                .is_some_and(|longest| now >= self.began + longest)
            {
                return Ok(End::Asked("Finished: as long as it was meant to be."));
            }
        }
    }

    /// What cannot be written down is counted; what cannot be written to the disk ends it.
    fn write(&mut self, event: &SessionEvent) -> Result<(), SessionError> {
        self.waiting_bytes
            .fetch_sub(event.bytes() as u64, Ordering::Relaxed);
        match self.writer.event(event) {
            Ok(()) => self.recording.events += 1,
            Err(SessionError::Unrecordable { .. }) => {
                self.dropped.fetch_add(1, Ordering::Relaxed);
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// What still waits, now that nothing more comes.
    fn drain(&mut self) -> Result<(), SessionError> {
        while let Ok(event) = self.waiting.try_recv() {
            self.write(&event)?;
        }
        Ok(())
    }

    fn finish(mut self, end: End) -> Recording {
        self.measure();
        let (mut state, mut sentence) = match end {
            End::Asked(sentence) => (RecordingState::Finished, sentence.to_owned()),
            End::Reserve => (RecordingState::Failed, self.full()),
            End::Broken(error) => (RecordingState::Failed, broken(&error)),
        };
        let whole = state == RecordingState::Finished || sentence == self.full();
        if whole && let Err(error) = self.writer.finish() {
            (state, sentence) = (RecordingState::Failed, broken(&error));
        }
        if state == RecordingState::Failed {
            tracing::warn!("{sentence}");
        }
        let mut recording = self.recording;
        recording.bytes = size_of_file(&self.path);
        recording.seconds_left = None;
        (recording.state, recording.description) = (state, sentence);
        self.status.update(|s| s.recording = recording.clone());
        recording
    }

    fn full(&self) -> String {
        format!(
            "{}: ended, because less than {} MB is free on the disk ([recording] reserve_mb); \
             it is whole up to here",
            self.path.display(),
            self.reserve_bytes / 1_000_000
        )
    }

    fn free(&self) -> Option<u64> {
        free_bytes(&self.path)
    }

    fn measure(&mut self) {
        let recording = &mut self.recording;
        recording.bytes = size_of_file(&self.path);
        recording.seconds = SystemClock.now().seconds_since(self.began);
        recording.dropped = self.dropped.load(Ordering::Relaxed);
        recording.free_bytes = free_bytes(&self.path);
        recording.seconds_left = seconds_left(recording, self.reserve_bytes, self.longest);
    }

    fn publish(&mut self) {
        self.measure();
        let recording = &mut self.recording;
        recording.state = RecordingState::Recording;
        "Recording.".clone_into(&mut recording.description);
        self.status.update(|s| s.recording.clone_from(recording));
    }
}

/// By the room on the disk at the rate so far, and by the length that was asked for.
fn seconds_left(recording: &Recording, reserve: u64, longest: Option<Duration>) -> Option<f64> {
    let rate = recording.bytes as f64 / recording.seconds;
    let room = recording.free_bytes?.saturating_sub(reserve) as f64;
    let by_room = (recording.seconds > 1.0 && rate > 0.0).then(|| room / rate);
    let by_length = longest.map(|longest| (longest.as_secs_f64() - recording.seconds).max(0.0));
    [by_room, by_length].into_iter().flatten().reduce(f64::min)
}

fn broken(error: &SessionError) -> String {
    let full = matches!(error, SessionError::Io { source, .. }
        if source.kind() == std::io::ErrorKind::StorageFull);
    if full {
        format!("{error}; the recording has ended, and is readable up to about here; free space")
    } else {
        format!("{error}; the recording has ended, and is readable up to about here")
    }
}

fn size_of_file(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |metadata| metadata.len())
}

/// Room for us on the disk of an existing file.
#[cfg(unix)]
fn free_bytes(path: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(path).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(not(unix))]
const fn free_bytes(_: &Path) -> Option<u64> {
    None
}

/// `penumbra-20261121-120203.mcap`, UTC.
fn name_by_date() -> String {
    let [year, month, day, hour, minute, second] = utc_now();
    format!("penumbra-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.mcap")
}

#[cfg(test)]
mod tests;
