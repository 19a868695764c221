//! Calibrates a running rig when it is asked to: a step at a time, on a thread of its own that
//! leaves the processors to the frames.

use super::devices::{lacking, made, trouble};
use super::files::{calibration_folder, prepare, write_calibration};
use super::live::{EndedBy, LiveShow, Wish};
use super::showcase::Showcase;
use super::steps::{Known, Made, file_of, forms, step_of};
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

/// Makes a step from its name and parameters.
pub type StepMaker =
    dyn Fn(&CalibrationRequest, &Known) -> Result<Made, CalibrationRefusal> + Send + Sync;

/// Carries out steps of calibration beside the frames.
pub struct Calibrator {
    hub: Arc<Hub>,
    devices: Arc<Devices>,
    onlooker: DeviceObserver,
    config: Arc<Config>,
    showcase: Arc<Showcase>,
    make: Box<StepMaker>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Calibrator {
    /// Ready to calibrate a live rig.
    #[must_use]
    pub fn new(live: &Live, config: &Config) -> Arc<Self> {
        let make = |wish: &CalibrationRequest, known: &Known| {
            let step = step_of(&wish.step, &wish.parameters, known);
            step.map_err(|error| CalibrationRefusal::Parameter {
                reason: error.to_string(),
            })
        };
        Self::with_steps(live, config, Box::new(make))
    }

    /// With steps of one's own.
    #[must_use]
    pub fn with_steps(live: &Live, config: &Config, make: Box<StepMaker>) -> Arc<Self> {
        Arc::new(Self {
            hub: Arc::clone(&live.hub),
            devices: Arc::clone(&live.devices),
            onlooker: live.onlooker(),
            config: Arc::new(config.clone()),
            showcase: Showcase::new(forms()),
            make,
            thread: Mutex::default(),
        })
    }

    /// Everything that can be found wrong before the first picture.
    fn job(&self, wish: &CalibrationRequest) -> Result<(Job, Made), RigError> {
        let refused = |refusal: CalibrationRefusal| RigError::Calibration { refusal };
        // Anew each time: the step before may have written what this one builds upon.
        let known = Known::read(&self.config)?;
        let made = (self.make)(wish, &known).map_err(refused)?;
        if let Some(reason) = lacking(&made.step.wants(), &self.devices) {
            return Err(refused(CalibrationRefusal::Failed { reason }));
        }
        let folder = calibration_folder(&self.config)?.to_owned();
        let name = file_of(&*made.step);
        prepare(&folder, &name)?;
        let tracker = known.document.calibration.tracker;
        let job = Job {
            hub: Arc::clone(&self.hub),
            onlooker: self.onlooker.clone(),
            config: Arc::clone(&self.config),
            showcase: Arc::clone(&self.showcase),
            metres_per_unit: tracker.map(|t| t.metres_per_unit),
            longest: wish.longest(),
            folder,
            name,
        };
        Ok((job, made))
    }
}

impl CalibrationControl for Calibrator {
    fn view(&self) -> Calibration {
        self.showcase.view()
    }

    fn start(&self, wish: &CalibrationRequest) -> Result<(), CalibrationRefusal> {
        let mut thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if thread.as_ref().is_some_and(|t| !t.is_finished()) {
            let step = self.showcase.view().step;
            return Err(CalibrationRefusal::Busy { step });
        }
        let (job, made) = self.job(wish).map_err(refusal)?;
        let Made {
            step,
            title,
            parameters,
        } = made;
        self.showcase.begin(step.name(), title, parameters.to_map());
        let started = threads::spawn_background("calibrate", move || job.run(step));
        *thread = Some(started.map_err(|source| {
            let error = RigError::Thread { source }.to_string();
            self.showcase.fail(&error);
            CalibrationRefusal::Failed { reason: error }
        })?);
        Ok(())
    }

    fn finish(&self) -> Result<(), CalibrationRefusal> {
        self.showcase.wish_for(Wish::Finish)
    }

    fn abort(&self) -> Result<(), CalibrationRefusal> {
        self.showcase.wish_for(Wish::Abort)
    }

    fn picture(&self, revision: Option<u64>) -> Option<Bytes> {
        self.showcase.picture(revision)
    }

    fn report(&self) -> Option<String> {
        self.showcase.report()
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
        let _ = self.showcase.wish_for(Wish::Abort);
        let thread = self
            .thread
            .get_mut()
            .unwrap_or_else(PoisonError::into_inner);
        let _ = thread.take().map(JoinHandle::join);
    }
}

/// One step on its way.
struct Job {
    hub: Arc<Hub>,
    onlooker: DeviceObserver,
    config: Arc<Config>,
    showcase: Arc<Showcase>,
    metres_per_unit: Option<f64>,
    longest: Option<Duration>,
    folder: PathBuf,
    name: String,
}

impl Job {
    /// Whatever becomes of it is told.
    fn run(self, mut step: Box<dyn Step>) {
        let carried_out = catch_unwind(AssertUnwindSafe(|| self.carry_out(&mut *step)));
        if carried_out.is_err() {
            self.hub.set_tap(None);
            let name = step.name();
            let reason = format!(
                "there is a bug in the step `{name}`, which has ended; record what it was shown \
                 (`penumbra record`), and report it with that"
            );
            tracing::error!("{reason}");
            self.showcase.fail(&reason);
        }
    }

    fn carry_out(&self, step: &mut dyn Step) {
        let wants = step.wants();
        let show = LiveShow {
            hub: &self.hub,
            config: &self.config,
            metres_per_unit: self.metres_per_unit,
            longest: self.longest,
        };
        let ended = show.show(step, &mut |moment| {
            let trouble = trouble(&wants, &self.onlooker.devices());
            self.showcase.tell(moment, trouble)
        });
        // The rig is being closed: nobody has asked for a result.
        if matches!(ended, EndedBy::Aborted | EndedBy::DevicesClosed) {
            return self.showcase.aborted();
        }
        self.showcase.evaluate();
        let found = step.finish(&made(&wants, &self.onlooker.devices()));
        // It may have been wished while it was being worked out.
        if self.showcase.wish() == Wish::Abort {
            return self.showcase.aborted();
        }
        let written = write_calibration(&self.folder, &self.name, &found);
        self.showcase
            .conclude(&found, written.map_err(|error| error.to_string()));
    }
}

#[cfg(test)]
mod tests;
