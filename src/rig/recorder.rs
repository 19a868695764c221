//! Records the events of a live rig into a session file, on its own thread, on request with the
//! composited pictures. No other thread waits for it: events that arrive while its queue is full are
//! dropped and counted.

use crate::composites::{CompositeQueue, EncodedComposite};
use crate::error::RigError;
use crate::source::RecordingContents;
use crate::synced_file::{SyncedFile, sync_folder_of};
use crate::viewed::{FoundLens, pinhole};
use crate::wall_date::utc_now;
use penumbra_capture::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use penumbra_capture::sync::channel::{Receiver, RecvTimeoutError, bounded};
use penumbra_capture::sync::{JoinHandle, Mutex, limit, threads};
use penumbra_capture::{Hub, RecorderQueue};
use penumbra_config::RecordingConfig;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_session::{Camera, RigViews, SessionError, SessionEvent, SessionWriter, new_file};
use penumbra_status::SharedStatus;
use penumbra_status::recording::{
    Recording, RecordingControl, RecordingRefusal, RecordingRequest, RecordingState,
};
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

/// Capacity of the queue, events: several seconds of all streams. Its bytes are limited separately.
const QUEUE_CAPACITY: usize = limit(16_384, 4);
/// Time between flushes, each of which waits for the disk. A power cut loses this and the time of
/// two flushes. Where one takes longer than this, the next one does not wait.
const FLUSH_EVERY: Duration = Duration::from_millis(250);
/// A write that takes longer means that the disk is slow.
const SLOW_WRITE: Duration = Duration::from_millis(250);
/// With longer flushes a power cut loses more than a second.
const SLOW_FLUSH: Duration = Duration::from_millis(750);

/// A file that a recording is written to. Its `flush` returns when its bytes are on the disk.
pub trait RecordingFile: Write + Seek + Send {}

impl<T: Write + Seek + Send> RecordingFile for T {}

/// Returns what is written to in place of a new file, e.g. a disk with faults in tests.
pub type WrapFile = Box<dyn Fn(File) -> Box<dyn RecordingFile> + Send + Sync>;

/// Records the events of a [`Hub`] on request.
pub struct Recorder {
    hub: Arc<Hub>,
    contents: RecordingContents,
    config: RecordingConfig,
    status: Arc<SharedStatus>,
    wrap: WrapFile,
    running: Mutex<Option<Running>>,
}

struct Running {
    path: PathBuf,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Recording>,
}

impl Recorder {
    /// Creates an idle recorder of the events of `hub` and of `contents`.
    #[must_use]
    pub fn new(
        hub: Arc<Hub>,
        contents: RecordingContents,
        config: RecordingConfig,
        status: Arc<SharedStatus>,
    ) -> Arc<Self> {
        Self::on_disk(
            hub,
            contents,
            config,
            status,
            Box::new(|file| Box::new(SyncedFile::new(file))),
        )
    }

    /// As [`Self::new`], and writes to what `wrap` makes of each new file.
    #[must_use]
    pub fn on_disk(
        hub: Arc<Hub>,
        contents: RecordingContents,
        config: RecordingConfig,
        status: Arc<SharedStatus>,
        wrap: WrapFile,
    ) -> Arc<Self> {
        status.update(|s| {
            s.recording.state = RecordingState::Idle;
            s.recording.composite = config.composite;
            "No recording is running.".clone_into(&mut s.recording.description);
        });
        Arc::new(Self {
            hub,
            contents,
            config,
            status,
            wrap,
            running: Mutex::new(None),
        })
    }

    /// Starts a recording into a new file at `path`, which ends after `max_duration`; `composite`: with
    /// the composited pictures.
    ///
    /// # Errors
    /// Another recording is running, the file exists or cannot be written, or the system cannot
    /// start a thread.
    pub fn start(
        &self,
        path: &Path,
        max_duration: Option<Duration>,
        composite: bool,
    ) -> Result<(), RigError> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(busy) = running.as_ref().filter(|r| !r.thread.is_finished()) {
            return Err(RigError::Recording {
                path: busy.path.clone(),
            });
        }
        let (events, queue) = bounded(QUEUE_CAPACITY);
        let mut job = self.job(path, max_duration, queue, composite)?;
        let stop = Arc::clone(&job.stop);
        let recorder_queue =
            RecorderQueue::new(events, job.queued_bytes.clone(), job.dropped.clone());
        // Before this function returns, so that the status never shows the previous recording
        // after a successful start.
        job.publish();
        self.hub.set_recorder(Some(recorder_queue));
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

    /// Creates the file and what a recording needs.
    fn job(
        &self,
        path: &Path,
        max_duration: Option<Duration>,
        queue: Receiver<SessionEvent>,
        composite: bool,
    ) -> Result<Job, RigError> {
        let configured = self.config.max_duration_nanos;
        let configured = configured.map(|nanos| Duration::from_nanos(nanos.unsigned_abs()));
        let file = BufWriter::new((self.wrap)(new_file(path)?));
        let writer = SessionWriter::new(file, path)?;
        let composites = composite
            .then(|| self.contents.composites.start())
            .transpose();
        let composites = composites.map_err(|source| RigError::Thread { source })?;
        let lens = self.contents.refined_lens.newest();
        Ok(Job {
            writer,
            views: RigViews::new(self.contents.viewed_with(lens.as_deref())),
            lens,
            queue,
            composites,
            queued_bytes: Arc::default(),
            dropped: Arc::default(),
            hub: Arc::clone(&self.hub),
            contents: self.contents.clone(),
            status: Arc::clone(&self.status),
            stop: Arc::default(),
            path: path.to_owned(),
            reserve_bytes: self.config.reserve_bytes,
            max_duration: [configured, max_duration].into_iter().flatten().min(),
            started: SystemClock.now(),
            flushed: SystemClock.now(),
            last_flush: Duration::ZERO,
            unflushed: 0,
            slowest: Duration::ZERO,
            slowest_flush: Duration::ZERO,
            recording: Recording {
                file: Some(path.display().to_string()),
                composite,
                ..Recording::default()
            },
        })
    }

    /// Finishes the running recording and returns its final status; `None` if there is none.
    pub fn stop(&self) -> Option<Recording> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        let running = running.take()?;
        running.stop.store(true, Ordering::Relaxed);
        running.thread.join().ok()
    }

    /// Returns whether a recording is running.
    #[must_use]
    pub fn is_recording(&self) -> bool {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.as_ref().is_some_and(|r| !r.thread.is_finished())
    }

    /// Returns the path of a recording in the recordings' folder, and creates a missing folder.
    fn recording_path(&self, name: Option<&str>) -> Result<PathBuf, RecordingRefusal> {
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
    fn carry_out(&self, request: &RecordingRequest) -> Result<Recording, RecordingRefusal> {
        if !request.record {
            self.stop();
            return Ok(self.status.snapshot().recording);
        }
        let path = self.recording_path(request.file.as_deref())?;
        let max_duration = request.seconds.map(Duration::from_secs_f64);
        let composite = request.composite.unwrap_or(self.config.composite);
        match self.start(&path, max_duration, composite) {
            Ok(()) => Ok(Recording {
                state: RecordingState::Recording,
                file: Some(path.display().to_string()),
                composite,
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

/// Why a recording ended.
enum End {
    /// By request or at its maximum duration; the description for the status.
    Regular(&'static str),
    /// The free space on the disk fell below the reserve; the file is complete up to there.
    Reserve,
    /// The file cannot be written.
    WriteFailed(SessionError),
}

/// A running recording.
struct Job {
    writer: SessionWriter<BufWriter<Box<dyn RecordingFile>>>,
    views: RigViews,
    /// The refined lens that was written last.
    lens: Option<Arc<FoundLens>>,
    queue: Receiver<SessionEvent>,
    composites: Option<CompositeQueue>,
    queued_bytes: Arc<AtomicU64>,
    dropped: Arc<AtomicU64>,
    hub: Arc<Hub>,
    contents: RecordingContents,
    status: Arc<SharedStatus>,
    stop: Arc<AtomicBool>,
    path: PathBuf,
    reserve_bytes: u64,
    max_duration: Option<Duration>,
    started: MonotonicTime,
    flushed: MonotonicTime,
    /// Duration of the last flush, and events written since then.
    last_flush: Duration,
    unflushed: u64,
    /// Duration of the longest write.
    slowest: Duration,
    /// Duration of the longest flush.
    slowest_flush: Duration,
    recording: Recording,
}

impl Job {
    fn run(mut self) -> Recording {
        let end = self.record().unwrap_or_else(End::WriteFailed);
        self.hub.set_recorder(None);
        let end = match end {
            End::WriteFailed(error) => End::WriteFailed(error),
            end => match self.drain() {
                Ok(()) => end,
                Err(error) => End::WriteFailed(error),
            },
        };
        self.finish(end)
    }

    fn record(&mut self) -> Result<End, SessionError> {
        for file in self.contents.files_with(self.lens.as_deref()) {
            self.writer.attach(&file.name, &file.data)?;
        }
        sync_folder_of(&self.path);
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(End::Regular("Finished."));
            }
            let is_written = match self.queue.recv_timeout(self.patience()) {
                Ok(event) => {
                    self.timed_write(|job| job.write(&event))?;
                    self.unflushed += 1;
                    false
                }
                Err(RecvTimeoutError::Timeout) => self.unflushed > 0,
                Err(RecvTimeoutError::Disconnected) => return Ok(End::Regular("Finished.")),
            };
            self.timed_write(Self::write_composites)?;
            let now = SystemClock.now();
            if now >= self.flushed + FLUSH_EVERY || is_written && self.flushes_are_long() {
                self.flush()?;
                if self.free().is_some_and(|free| free < self.reserve_bytes) {
                    return Ok(End::Reserve);
                }
            }
            if self
                .max_duration
                .is_some_and(|duration| now >= self.started + duration)
            {
                return Ok(End::Regular("Finished: the maximum duration is reached."));
            }
        }
    }

    /// Whether a flush takes so long that what arrived during it is flushed as soon as it is written.
    fn flushes_are_long(&self) -> bool {
        self.last_flush > FLUSH_EVERY
    }

    /// How long to wait for the next event.
    fn patience(&self) -> Duration {
        if self.flushes_are_long() && self.unflushed > 0 {
            Duration::ZERO
        } else {
            FLUSH_EVERY / 2
        }
    }

    /// Waits until all that is written is on the disk.
    fn flush(&mut self) -> Result<(), SessionError> {
        self.last_flush = self.timed(|job| job.writer.flush())?;
        // From its end: after a flush longer than the interval only one event would be written
        // before the next one, and the queue would grow.
        self.flushed = SystemClock.now();
        self.unflushed = 0;
        self.slowest_flush = self.slowest_flush.max(self.last_flush);
        self.publish();
        Ok(())
    }

    /// Writes, and notes how long that takes.
    fn timed_write(
        &mut self,
        write: impl FnOnce(&mut Self) -> Result<(), SessionError>,
    ) -> Result<(), SessionError> {
        let took = self.timed(write)?;
        self.slowest = self.slowest.max(took);
        Ok(())
    }

    /// Returns how long a write takes.
    fn timed(
        &mut self,
        write: impl FnOnce(&mut Self) -> Result<(), SessionError>,
    ) -> Result<Duration, SessionError> {
        let begun = SystemClock.now();
        write(self)?;
        let nanos = SystemClock.now().nanos_since(begun).max(0);
        Ok(Duration::from_nanos(nanos.unsigned_abs()))
    }

    /// Writes an event. An event that cannot be encoded is dropped and counted; an error of the
    /// disk ends the recording.
    fn write(&mut self, event: &SessionEvent) -> Result<(), SessionError> {
        self.queued_bytes
            .fetch_sub(event.bytes() as u64, Ordering::Relaxed);
        match self.writer.event(event) {
            Ok(()) => self.recording.events += 1,
            Err(SessionError::Unrecordable { .. }) => {
                self.dropped.fetch_add(1, Ordering::Relaxed);
            }
            Err(error) => return Err(error),
        }
        match self.write_views(event) {
            // Only viewers miss it: the event itself is written or counted.
            Err(SessionError::Unrecordable { .. }) => Ok(()),
            written => written,
        }
    }

    /// Writes what viewers need beside an event: lenses and frame tree at the first one, the tracker's
    /// poses, and a lens that was refined since the previous event.
    fn write_views(&mut self, event: &SessionEvent) -> Result<(), SessionError> {
        self.views.event(&mut self.writer, event)?;
        let newest = self.contents.refined_lens.newest();
        let same = |a: &Arc<_>| self.lens.as_ref().is_some_and(|b| Arc::ptr_eq(a, b));
        let Some(lens) = newest.filter(|lens| !same(lens)) else {
            return Ok(());
        };
        let viewed = pinhole(Camera::Scene, &lens.camera);
        self.lens = Some(lens);
        self.views
            .lens(&mut self.writer, &viewed, event.arrived_at())
    }

    /// Writes the composited pictures that are encoded.
    fn write_composites(&mut self) -> Result<(), SessionError> {
        let next = |job: &Self| job.composites.as_ref()?.encoded.try_recv().ok();
        while let Some(composite) = next(self) {
            self.write_composite(composite)?;
        }
        Ok(())
    }

    fn write_composite(&mut self, composite: EncodedComposite) -> Result<(), SessionError> {
        let EncodedComposite {
            jpeg,
            captured_at,
            composed_at,
        } = composite;
        match self.writer.composite(jpeg, captured_at, composed_at) {
            Ok(()) => self.recording.composites += 1,
            Err(SessionError::Unrecordable { .. }) => {
                self.composites.iter().for_each(CompositeQueue::drop_one);
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Writes the events that are still queued, of which there will be no more, and the composited
    /// pictures that are still being encoded.
    fn drain(&mut self) -> Result<(), SessionError> {
        while let Ok(event) = self.queue.try_recv() {
            self.write(&event)?;
        }
        self.composites.iter().for_each(CompositeQueue::close);
        // Without a time limit: the encoder closes the channel after the last picture, and one that
        // comes later would be neither written nor counted.
        let next = |job: &Self| job.composites.as_ref()?.encoded.recv().ok();
        while let Some(composite) = next(self) {
            self.write_composite(composite)?;
        }
        Ok(())
    }

    fn finish(mut self, end: End) -> Recording {
        self.measure();
        let can_finish = !matches!(end, End::WriteFailed(_));
        let (mut state, mut description) = match end {
            End::Regular(text) => (RecordingState::Finished, text.to_owned()),
            End::Reserve => (RecordingState::Failed, self.disk_full_message()),
            End::WriteFailed(error) => (RecordingState::Failed, write_error_message(&error)),
        };
        if can_finish && let Err(error) = self.writer.finish() {
            (state, description) = (RecordingState::Failed, write_error_message(&error));
        }
        if state == RecordingState::Failed {
            tracing::warn!("{description}");
        }
        let mut recording = self.recording;
        recording.bytes = size_of_file(&self.path);
        recording.seconds_left = None;
        (recording.state, recording.description) = (state, description);
        self.status.update(|s| s.recording = recording.clone());
        recording
    }

    fn disk_full_message(&self) -> String {
        format!(
            "{}: recording ended, because less than {} MB is free on the disk ([recording] \
             reserve_mb); the file is complete up to here",
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
        recording.seconds = SystemClock.now().seconds_since(self.started);
        recording.dropped = self.dropped.load(Ordering::Relaxed);
        recording.composites_dropped = self.composites.as_ref().map_or(0, CompositeQueue::dropped);
        recording.free_bytes = free_bytes(&self.path);
        recording.bytes_per_second = bytes_per_second(recording);
        recording.seconds_left = seconds_left(recording, self.reserve_bytes, self.max_duration);
    }

    fn publish(&mut self) {
        self.measure();
        let recording = &mut self.recording;
        recording.state = RecordingState::Recording;
        recording.description = if self.slowest > SLOW_WRITE {
            let seconds = self.slowest.as_secs_f64();
            format!("Recording; the disk is slow: a write took {seconds:.1} s.")
        } else if self.slowest_flush > SLOW_FLUSH {
            let seconds = self.slowest_flush.as_secs_f64();
            format!(
                "Recording; the disk is slow: it took {seconds:.1} s to confirm what was written, and \
                 a power cut loses that time, too."
            )
        } else {
            "Recording.".to_owned()
        };
        self.status.update(|s| s.recording.clone_from(recording));
    }
}

/// Maximum time that is stated until the disk is full, seconds: 30 days. A longer one means that hardly
/// anything arrives, such as without a camera, and would end with its first picture.
const MAX_SECONDS_LEFT: f64 = 30.0 * 86_400.0;

/// Returns the time until the recording ends, seconds: the smaller of the time until the disk is
/// full at the mean data rate and the time until the maximum duration. `None` if neither is known.
fn seconds_left(
    recording: &Recording,
    reserve: u64,
    max_duration: Option<Duration>,
) -> Option<f64> {
    let free = recording.free_bytes?.saturating_sub(reserve) as f64;
    let rate = bytes_per_second(recording).filter(|rate| *rate > 0.0);
    let until_full = rate.map(|rate| free / rate);
    let until_full = until_full.filter(|seconds| *seconds <= MAX_SECONDS_LEFT);
    let until_end = max_duration.map(|max| (max.as_secs_f64() - recording.seconds).max(0.0));
    [until_full, until_end]
        .into_iter()
        .flatten()
        .reduce(f64::min)
}

/// Returns the mean data rate; `None` in the first second.
fn bytes_per_second(recording: &Recording) -> Option<f64> {
    let seconds = recording.seconds;
    (seconds > 1.0).then(|| recording.bytes as f64 / seconds)
}

fn write_error_message(error: &SessionError) -> String {
    let is_disk_full = matches!(error, SessionError::Io { source, .. }
        if source.kind() == std::io::ErrorKind::StorageFull);
    if is_disk_full {
        format!("{error}; the recording has ended and is readable up to about here; free space")
    } else {
        format!("{error}; the recording has ended and is readable up to about here")
    }
}

fn size_of_file(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |metadata| metadata.len())
}

/// Returns the free space available to this user on the disk of an existing file, bytes.
#[cfg(unix)]
fn free_bytes(path: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(path).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(not(unix))]
const fn free_bytes(_: &Path) -> Option<u64> {
    None
}

/// Returns a file name with the UTC date, e.g. `penumbra-20261121-120203.mcap`.
fn name_by_date() -> String {
    let [year, month, day, hour, minute, second] = utc_now();
    format!("penumbra-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.mcap")
}

#[cfg(test)]
mod tests;
