//! Runs calibration steps on request beside the frames of a running rig: one step at a time, on a
//! background thread that yields to the threads of the frames.

use super::definition::RigContext;
use super::devices::{device_problem, missing_device, provenance};
use super::files::{calibration_folder, prepare, write_calibration};
use super::live::{EndReason, LiveFeed, StepRequest};
use super::monitor::CalibrationMonitor;
use super::steps::{PreparedStep, calibration_file_name, forms, make_step};
use crate::error::RigError;
use crate::source::DeviceObserver;
use crate::source::Live;
use bytes::Bytes;
use penumbra_calibration::step::Step;
use penumbra_capture::{Devices, Hub};
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_status::calibration::{
    Calibration, CalibrationControl, CalibrationRefusal, CalibrationRequest,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Creates the requested step for a rig.
pub type StepMaker = dyn Fn(&CalibrationRequest, &RigContext) -> Result<PreparedStep, CalibrationRefusal>
    + Send
    + Sync;

/// Runs calibration steps beside the frames.
pub struct Calibrator {
    hub: Arc<Hub>,
    devices: Arc<Devices>,
    observer: DeviceObserver,
    config: Arc<Config>,
    monitor: Arc<CalibrationMonitor>,
    make: Box<StepMaker>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Calibrator {
    /// Creates the calibrator of a live rig.
    #[must_use]
    pub fn new(live: &Live, config: &Config) -> Arc<Self> {
        let make = |request: &CalibrationRequest, rig: &RigContext| {
            let step = make_step(&request.step, &request.parameters, rig);
            step.map_err(|error| CalibrationRefusal::Parameter {
                reason: error.to_string(),
            })
        };
        Self::with_steps(live, config, Box::new(make))
    }

    /// Creates a calibrator with other steps.
    #[must_use]
    pub fn with_steps(live: &Live, config: &Config, make: Box<StepMaker>) -> Arc<Self> {
        Arc::new(Self {
            hub: Arc::clone(&live.hub),
            devices: Arc::clone(&live.devices),
            observer: live.observer(),
            config: Arc::new(config.clone()),
            monitor: CalibrationMonitor::new(forms()),
            make,
            thread: Mutex::default(),
        })
    }

    /// Prepares a step; reports all errors that can be found before the first picture.
    fn job(&self, request: &CalibrationRequest) -> Result<(Job, PreparedStep), RigError> {
        let refused = |refusal: CalibrationRefusal| RigError::Calibration { refusal };
        // Read again for each step, which may build on the result of the previous one.
        let rig = RigContext::read(&self.config)?;
        let prepared = (self.make)(request, &rig).map_err(refused)?;
        if let Some(reason) = missing_device(&prepared.step.inputs(), &self.devices) {
            return Err(refused(CalibrationRefusal::Failed { reason }));
        }
        let folder = calibration_folder(&self.config)?.to_owned();
        let name = calibration_file_name(&*prepared.step);
        prepare(&folder, &name)?;
        let tracker = rig.document.calibration.tracker;
        let job = Job {
            hub: Arc::clone(&self.hub),
            observer: self.observer.clone(),
            config: Arc::clone(&self.config),
            monitor: Arc::clone(&self.monitor),
            metres_per_unit: tracker.map(|t| t.metres_per_unit),
            time_limit: request.longest(),
            folder,
            name,
        };
        Ok((job, prepared))
    }
}

impl CalibrationControl for Calibrator {
    fn view(&self) -> Calibration {
        self.monitor.view()
    }

    fn start(&self, request: &CalibrationRequest) -> Result<(), CalibrationRefusal> {
        let mut thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if thread.as_ref().is_some_and(|t| !t.is_finished()) {
            let step = self.monitor.view().step;
            return Err(CalibrationRefusal::Busy { step });
        }
        let (job, prepared) = self.job(request).map_err(refusal)?;
        let PreparedStep {
            step,
            title,
            parameters,
        } = prepared;
        self.monitor.begin(step.name(), title, parameters.to_map());
        let started = threads::spawn_background("calibrate", move || job.run(step));
        *thread = Some(started.map_err(|source| {
            let error = RigError::Thread { source }.to_string();
            self.monitor.set_failed(&error);
            CalibrationRefusal::Failed { reason: error }
        })?);
        Ok(())
    }

    fn finish(&self) -> Result<(), CalibrationRefusal> {
        self.monitor.request(StepRequest::Finish)
    }

    fn abort(&self) -> Result<(), CalibrationRefusal> {
        self.monitor.request(StepRequest::Abort)
    }

    fn picture(&self, revision: Option<u64>) -> Option<Bytes> {
        self.monitor.picture(revision)
    }

    fn report(&self) -> Option<String> {
        self.monitor.report()
    }
}

fn refusal(error: RigError) -> CalibrationRefusal {
    match error {
        RigError::Calibration { refusal } => refusal,
        error => CalibrationRefusal::Failed {
            reason: error.to_string(),
        },
    }
}

impl Drop for Calibrator {
    fn drop(&mut self) {
        let _ = self.monitor.request(StepRequest::Abort);
        let thread = self
            .thread
            .get_mut()
            .unwrap_or_else(PoisonError::into_inner);
        let _ = thread.take().map(JoinHandle::join);
    }
}

/// A step that is to run on the background thread.
struct Job {
    hub: Arc<Hub>,
    observer: DeviceObserver,
    config: Arc<Config>,
    monitor: Arc<CalibrationMonitor>,
    metres_per_unit: Option<f64>,
    time_limit: Option<Duration>,
    folder: PathBuf,
    name: String,
}

impl Job {
    /// Runs the step; a panic of the step becomes a failed calibration.
    fn run(self, mut step: Box<dyn Step>) {
        let outcome = catch_unwind(AssertUnwindSafe(|| self.run_step(&mut *step)));
        if outcome.is_err() {
            self.hub.set_tap(None);
            let name = step.name();
            let reason = format!(
                "there is a bug in the step `{name}`, which was stopped; record the same input \
                 (`penumbra record`) and report the bug with the recording"
            );
            tracing::error!("{reason}");
            self.monitor.set_failed(&reason);
        }
    }

    fn run_step(&self, step: &mut dyn Step) {
        let wants = step.inputs();
        let feed = LiveFeed {
            hub: &self.hub,
            config: &self.config,
            metres_per_unit: self.metres_per_unit,
            time_limit: self.time_limit,
        };
        let reason = feed.run(step, &mut |update| {
            let trouble = device_problem(&wants, &self.observer.devices());
            self.monitor.update(update, trouble)
        });
        // When the rig is closed, no result is wanted.
        if matches!(reason, EndReason::Aborted | EndReason::DevicesClosed) {
            return self.monitor.set_aborted();
        }
        self.monitor.set_evaluating();
        let found = step.finish(&provenance(&wants, &self.observer.devices()));
        // The abort may have been requested during the evaluation.
        if self.monitor.current_request() == StepRequest::Abort {
            return self.monitor.set_aborted();
        }
        let written = write_calibration(&self.folder, &self.name, &found);
        self.monitor
            .set_result(&found, written.map_err(|error| error.to_string()));
    }
}

#[cfg(test)]
mod tests;
