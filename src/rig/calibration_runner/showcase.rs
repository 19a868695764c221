//! What a calibration shows of itself while it is at work on another thread.

use super::live::{Moment, Wish};
use super::preview::{Previews, preview_of};
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

/// Nobody has asked for so long: pictures need not be kept for anybody, seconds.
const UNWATCHED: f64 = 3.0;
/// Marks that are passed on of one picture; more cannot be told apart.
const MOST_MARKS: usize = 4096;
/// No report is longer, bytes.
const LONGEST_REPORT: usize = 64 << 20;

/// The state of a calibration: written by whoever carries it out, read by whoever asks.
#[derive(Default)]
pub struct Showcase(Mutex<State>);

#[derive(Default)]
struct State {
    view: Calibration,
    wish: Wish,
    previews: Previews,
    asked_at: Option<MonotonicTime>,
    report: Option<Arc<str>>,
}

/// Where a calibration went.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// The calibration; none if it was refused.
    pub file: Option<PathBuf>,
    /// The one before it.
    pub backup: Option<PathBuf>,
    /// The page about it.
    pub report: Option<PathBuf>,
}

impl Showcase {
    /// Nothing is being done; `steps` can be asked for.
    #[must_use]
    pub fn new(steps: Vec<penumbra_status::calibration::StepForm>) -> Arc<Self> {
        let view = Calibration {
            state: CalibrationState::Idle,
            description: "Nothing is being calibrated.".to_owned(),
            steps,
            ..Calibration::default()
        };
        Arc::new(Self(Mutex::new(State {
            view,
            ..State::default()
        })))
    }

    /// A step begins.
    pub fn begin(&self, step: &str, title: &str, parameters: BTreeMap<String, String>) {
        let mut state = self.lock();
        state.wish = Wish::GoOn;
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

    /// How it goes, and a device that is waited for; answers what is wished.
    pub fn tell(&self, moment: &Moment, trouble: Option<String>) -> Wish {
        let preview = moment.picture.filter(|_| self.is_watched());
        let preview = preview.map(|(eye, picture)| (eye, preview_of(picture), picture));
        let mut state = self.lock();
        let state = &mut *state;
        if let Some((eye, preview, picture)) = preview {
            let revision = state.previews.push(preview);
            state.view.picture = Some(ShownPicture {
                revision,
                width: picture.width,
                height: picture.height,
                camera: eye.name().to_owned(),
                points: marks_of(moment.progress),
            });
        }
        let view = &mut state.view;
        if moment.counts.pictures > 0 || !moment.progress.message.is_empty() {
            "Collecting data.".clone_into(&mut view.description);
        }
        view.share = moment.progress.share.clamp(0.0, 1.0);
        view.message.clone_from(&moment.progress.message);
        view.hint.clone_from(&moment.progress.hint);
        view.device_error = trouble;
        view.seconds = moment.seconds;
        view.pictures = moment.counts.pictures;
        view.damaged = moment.counts.damaged;
        view.skipped = moment.counts.skipped;
        view.readings_lost = moment.counts.readings_lost;
        state.wish
    }

    /// Enough was seen.
    pub fn evaluate(&self) {
        let view = &mut self.lock().view;
        view.state = CalibrationState::Evaluating;
        "Evaluating.".clone_into(&mut view.description);
        view.device_error = None;
    }

    /// It has come to its end, and is on the disk or is not.
    pub fn conclude(&self, found: &Finished, written: Result<Written, String>) {
        let mut state = self.lock();
        let (written, trouble) = match written {
            Ok(written) => (written, None),
            Err(trouble) => (Written::default(), Some(trouble)),
        };
        state.report = (found.page.len() <= LONGEST_REPORT).then(|| Arc::from(&*found.page));
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
            (None, Some(_)) => "Written. It is used when the rig is started again.".to_owned(),
            (None, None) => "Refused: no calibration was written.".to_owned(),
        };
        view.result = Some(result(found, &written, report));
    }

    /// It could not come to its end.
    pub fn fail(&self, reason: &str) {
        let view = &mut self.lock().view;
        view.state = CalibrationState::Failed;
        reason.clone_into(&mut view.description);
        view.device_error = None;
    }

    /// Nothing came of it, as was wished.
    pub fn aborted(&self) {
        let view = &mut self.lock().view;
        view.state = CalibrationState::Idle;
        "Aborted; nothing was written.".clone_into(&mut view.description);
        view.device_error = None;
        view.result = None;
    }

    /// What is wished of the step under way.
    #[must_use]
    pub fn wish(&self) -> Wish {
        self.lock().wish
    }

    /// Wishes something of the step under way.
    ///
    /// # Errors
    /// There is none, or it has seen all that it will.
    pub fn wish_for(&self, wish: Wish) -> Result<(), CalibrationRefusal> {
        let mut state = self.lock();
        if !state.view.state.is_busy() {
            return Err(CalibrationRefusal::NotRunning);
        }
        // Who has wished for an end without result does not get one.
        if state.wish != Wish::Abort {
            state.wish = wish;
        }
        if wish == Wish::Abort {
            "Aborting.".clone_into(&mut state.view.description);
        }
        Ok(())
    }

    fn is_watched(&self) -> bool {
        let asked_at = self.lock().asked_at;
        asked_at.is_some_and(|at| SystemClock.now().seconds_since(at) < UNWATCHED)
    }

    /// A panic elsewhere must not take the state away, so a poisoned lock is used on.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What the program carries out was said when it was started, so no other step can be.
impl CalibrationControl for Showcase {
    fn view(&self) -> Calibration {
        let mut state = self.lock();
        state.asked_at = Some(SystemClock.now());
        state.view.clone()
    }

    fn start(&self, _: &CalibrationRequest) -> Result<(), CalibrationRefusal> {
        Err(CalibrationRefusal::OneStep)
    }

    fn finish(&self) -> Result<(), CalibrationRefusal> {
        self.wish_for(Wish::Finish)
    }

    fn abort(&self) -> Result<(), CalibrationRefusal> {
        self.wish_for(Wish::Abort)
    }

    fn picture(&self, revision: Option<u64>) -> Option<Bytes> {
        let preview = self.lock().previews.get(revision)?;
        // Encoded without the lock: the step goes on meanwhile.
        preview.jpeg()
    }

    fn report(&self) -> Option<String> {
        self.lock().report.as_deref().map(str::to_owned)
    }
}

fn marks_of(progress: &Progress) -> Vec<[f32; 2]> {
    let finite = progress.marks.iter().filter(|mark| mark.is_finite());
    let marks = finite.map(|mark| mark.as_vec2().to_array());
    marks.take(MOST_MARKS).collect()
}

fn result(found: &Finished, written: &Written, report: bool) -> CalibrationResult {
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
