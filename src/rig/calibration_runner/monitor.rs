//! The state of a calibration that runs on another thread: progress, preview, result and requests.

use super::files::WrittenFiles;
use super::live::{StepRequest, StepUpdate};
use super::preview::{Previews, downscale};
use bytes::Bytes;
use penumbra_calibration::step::{Finished, Progress};
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_status::calibration::{
    Calibration, CalibrationControl, CalibrationFinding, CalibrationRefusal, CalibrationRequest,
    CalibrationResult, CalibrationState, ShownPicture,
};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Previews are made only if the state was read within this time, seconds.
const VIEWER_TIMEOUT_SECONDS: f64 = 3.0;
/// Maximum number of overlay points of a picture; more cannot be distinguished.
const MAX_OVERLAY_POINTS: usize = 4096;
/// Maximum size of a report that is served, bytes.
const MAX_REPORT_BYTES: usize = 64 << 20;

/// The state of a calibration: written by the thread that runs the step, read by status clients.
#[derive(Default)]
pub struct CalibrationMonitor(Mutex<State>);

#[derive(Default)]
struct State {
    view: Calibration,
    request: StepRequest,
    previews: Previews,
    viewed_at: Option<MonotonicTime>,
    report: Option<Arc<str>>,
}

impl CalibrationMonitor {
    /// Creates an idle monitor; `steps` are the forms of the available steps.
    #[must_use]
    pub fn new(steps: Vec<penumbra_status::calibration::StepForm>) -> Arc<Self> {
        let view = Calibration {
            state: CalibrationState::Idle,
            description: "No calibration is running.".to_owned(),
            steps,
            ..Calibration::default()
        };
        Arc::new(Self(Mutex::new(State {
            view,
            ..State::default()
        })))
    }

    /// Enters the state of a step that has started.
    pub fn begin(&self, step: &str, title: &str, parameters: BTreeMap<String, String>) {
        let mut state = self.lock();
        state.request = StepRequest::Continue;
        state.previews.clear();
        let steps = std::mem::take(&mut state.view.steps);
        state.view = Calibration {
            state: CalibrationState::Running,
            description: "Waiting for data from the devices.".to_owned(),
            step: step.to_owned(),
            title: title.to_owned(),
            parameters,
            steps,
            ..Calibration::default()
        };
    }

    /// Updates the progress. `trouble` is the problem of a device whose data are awaited. Returns
    /// the current request.
    pub fn update(&self, update: &StepUpdate, trouble: Option<String>) -> StepRequest {
        let preview = update.picture.filter(|_| self.has_viewer());
        let preview = preview.map(|(camera, picture)| (camera, downscale(picture), picture));
        let mut state = self.lock();
        let state = &mut *state;
        if let Some((camera, preview, picture)) = preview {
            let revision = state.previews.push(preview);
            state.view.picture = Some(ShownPicture {
                revision,
                width: picture.width,
                height: picture.height,
                camera: camera.name().to_owned(),
                points: overlay_points(update.progress),
            });
        }
        let view = &mut state.view;
        if update.counts.pictures > 0 || !update.progress.message.is_empty() {
            "Observing.".clone_into(&mut view.description);
        }
        view.share = update.progress.share.clamp(0.0, 1.0);
        view.message.clone_from(&update.progress.message);
        view.hint.clone_from(&update.progress.hint);
        view.device_error = trouble;
        view.seconds = update.seconds;
        view.pictures = update.counts.pictures;
        view.damaged = update.counts.damaged;
        view.skipped = update.counts.passed_over;
        view.readings_lost = update.counts.readings_lost;
        state.request
    }

    /// Enters the state of evaluation, after the last input.
    pub fn set_evaluating(&self) {
        let view = &mut self.lock().view;
        view.state = CalibrationState::Evaluating;
        "Evaluating.".clone_into(&mut view.description);
        view.device_error = None;
    }

    /// Enters the final state with the result, and the written files or why they could not be
    /// written.
    pub fn set_result(&self, found: &Finished, written: Result<WrittenFiles, String>) {
        let mut state = self.lock();
        let (written, trouble) = match written {
            Ok(written) => (written, None),
            Err(trouble) => (WrittenFiles::default(), Some(trouble)),
        };
        state.report = (found.report.len() <= MAX_REPORT_BYTES).then(|| Arc::from(&*found.report));
        let report = state.report.is_some();
        let view = &mut state.view;
        view.share = 1.0;
        view.hint.clear();
        view.state = match &trouble {
            Some(_) => CalibrationState::Failed,
            None => CalibrationState::Finished,
        };
        view.description = match (trouble, &written.file) {
            (Some(trouble), _) => format!("The calibration could not be written: {trouble}"),
            (None, Some(_)) => "Written. It takes effect when the rig is restarted.".to_owned(),
            (None, None) => "Refused: no calibration was written.".to_owned(),
        };
        view.result = Some(result(found, &written, report));
    }

    /// Enters the state of failure for `reason`.
    pub fn set_failed(&self, reason: &str) {
        let view = &mut self.lock().view;
        view.state = CalibrationState::Failed;
        reason.clone_into(&mut view.description);
        view.device_error = None;
    }

    /// Returns to the idle state after a requested abort.
    pub fn set_aborted(&self) {
        let view = &mut self.lock().view;
        view.state = CalibrationState::Idle;
        "Aborted; nothing was written.".clone_into(&mut view.description);
        view.device_error = None;
        view.result = None;
    }

    /// Returns the current request to the running step.
    #[must_use]
    pub fn current_request(&self) -> StepRequest {
        self.lock().request
    }

    /// Sends a request to the running step.
    ///
    /// # Errors
    /// No step is running.
    pub fn request(&self, request: StepRequest) -> Result<(), CalibrationRefusal> {
        let mut state = self.lock();
        if !state.view.state.is_busy() {
            return Err(CalibrationRefusal::NotRunning);
        }
        // An abort cannot be revoked.
        if state.request != StepRequest::Abort {
            state.request = request;
        }
        if request == StepRequest::Abort {
            "Aborting.".clone_into(&mut state.view.description);
        }
        Ok(())
    }

    /// Returns whether a client has read the state recently.
    fn has_viewer(&self) -> bool {
        let viewed_at = self.lock().viewed_at;
        let is_recent = |at| SystemClock.now().seconds_since(at) < VIEWER_TIMEOUT_SECONDS;
        viewed_at.is_some_and(is_recent)
    }

    /// Locks the state, also after a panic of another thread: the state must remain readable.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Control of the single step that the command line has started: no other step can be started.
impl CalibrationControl for CalibrationMonitor {
    fn view(&self) -> Calibration {
        let mut state = self.lock();
        state.viewed_at = Some(SystemClock.now());
        state.view.clone()
    }

    fn start(&self, _: &CalibrationRequest) -> Result<(), CalibrationRefusal> {
        Err(CalibrationRefusal::OneStep)
    }

    fn finish(&self) -> Result<(), CalibrationRefusal> {
        self.request(StepRequest::Finish)
    }

    fn abort(&self) -> Result<(), CalibrationRefusal> {
        self.request(StepRequest::Abort)
    }

    fn picture(&self, revision: Option<u64>) -> Option<Bytes> {
        let preview = self.lock().previews.get(revision)?;
        // Encoded without the lock, so that the step is not blocked.
        preview.jpeg()
    }

    fn report(&self) -> Option<String> {
        self.lock().report.as_deref().map(str::to_owned)
    }
}

/// Returns the finite overlay points, pixels.
fn overlay_points(progress: &Progress) -> Vec<[f32; 2]> {
    let finite = progress
        .overlay_points
        .iter()
        .filter(|point| point.is_finite());
    let points = finite.map(|point| point.as_vec2().to_array());
    points.take(MAX_OVERLAY_POINTS).collect()
}

fn result(found: &Finished, written: &WrittenFiles, report: bool) -> CalibrationResult {
    let name = |path: &PathBuf| path.display().to_string();
    let findings = found
        .findings
        .iter()
        .map(|(grade, text)| CalibrationFinding {
            grade: grade.name().to_owned(),
            text: text.clone(),
        });
    CalibrationResult {
        grade: found.grade.name().to_owned(),
        lines: found.lines.clone(),
        findings: findings.collect(),
        hints: found.hints.clone(),
        file: written.file.as_ref().map(name),
        backup: written.backup.as_ref().map(name),
        report,
    }
}
