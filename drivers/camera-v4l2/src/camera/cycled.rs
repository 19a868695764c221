//! Cycling a camera's exposures: the pure [`Bracketing`] with a camera to command.

use super::refused;
use crate::bracket::{self, Bracketing};
use crate::brightness::Brightness;
use crate::contract::{Contract, EXPOSURE};
use crate::stream::{Layout, Taken};
use crate::trouble;
use crate::video::{ControlDescription, Video, is_gone};
use penumbra_interface::{CameraSettings, ControlsInForce, DeviceError, Exposure};
use rustix::io::{Errno, Result};
use std::sync::Arc;

/// A camera's exposures are cycled.
pub(super) struct Cycled {
    bracketing: Bracketing,
    control: ControlDescription,
    brightness: Brightness,
    /// The controls in force with each step, as of a revision of the contract.
    in_force: Vec<ControlsInForce>,
    revision: u64,
}

impl Cycled {
    /// Tries the exposures of the settings' cycle: what the camera makes of each is what
    /// its frames are labelled with.
    pub(super) fn prepare(
        video: &mut impl Video,
        contract: &mut Contract,
        settings: &CameraSettings,
        device: &str,
    ) -> std::result::Result<Option<Self>, DeviceError> {
        let Some(wanted) = &settings.bracket else {
            return Ok(None);
        };
        let control = contract
            .exposure_control()
            .filter(|_| contract.exposure_is_fixed());
        let base = contract.value(EXPOSURE);
        let (Some(control), Some(base)) = (control, base) else {
            let reason = "bracketing needs the control exposure_time_absolute, and \
                          auto_exposure = 1 among the locked ones";
            return Err(refused(device, reason.to_owned()));
        };
        let mut taken = Vec::new();
        let mut values = bracket::exposures(wanted, base);
        values.push(base);
        for value in values {
            let value = value.clamp(control.min, control.max.max(control.min));
            let tried = set_exposure(video, &control, value);
            taken.push(tried.map_err(|e| trouble::on_setup(device, "trying exposures", e))?);
        }
        let steps = bracket::steps(&taken, base);
        let listed: Vec<i64> = steps.iter().map(|step| step.exposure).collect();
        let bracketing = Bracketing::new(wanted, steps).ok_or_else(|| {
            let range = (control.min, control.max);
            refused(device, format!(
                "bracketing: of the stops {:?} the camera makes the exposures {listed:?} (range \
                 {} to {}); two different ones are needed",
                wanted.stops, range.0, range.1
            ))
        })?;
        contract.exposure_is_cycled = true;
        Ok(Some(Self {
            bracketing,
            control,
            brightness: Brightness::default(),
            in_force: Vec::new(),
            revision: u64::MAX,
        }))
    }

    /// Sets the base exposure anew: some cameras forget it when their stream starts.
    pub(super) fn restart(&self, video: &mut impl Video) -> Result<()> {
        let base = self.bracketing.base().exposure;
        set_exposure(video, &self.control, base).map(|_| ())
    }

    /// What a picture was exposed with; sets the next exposure when its time has come.
    pub(super) fn label(
        &mut self,
        taken: &Taken,
        layout: &Layout,
        contract: &Contract,
        video: &mut impl Video,
    ) -> Result<Option<(Exposure, f64, ControlsInForce)>> {
        let stops = self
            .bracketing
            .wants_brightness()
            .then(|| self.brightness.stops(layout, &taken.data))
            .flatten();
        let answer = self.bracketing.take(taken.sequence, stops);
        if let Some(step) = answer.set {
            let exposure = self.bracketing.steps()[step].exposure;
            match video.set_control(self.control.id, self.control.kind, exposure) {
                Ok(()) => self.bracketing.was_set(taken.sequence, step),
                Err(error) if is_gone(error) => return Err(error),
                // A transfer that failed is due again with the next frame.
                Err(_) => {}
            }
        }
        let Some(step) = answer.step else {
            return Ok(None);
        };
        let label = self.bracketing.steps()[step];
        let controls = self.controls(contract, step);
        Ok(Some((
            contract.exposure_at(label.exposure),
            label.ev,
            controls,
        )))
    }

    /// What was found out about the camera's timing.
    pub(super) fn finding(&self) -> Option<String> {
        self.bracketing.finding.clone()
    }

    fn controls(&mut self, contract: &Contract, step: usize) -> ControlsInForce {
        if self.revision != contract.revision {
            self.revision = contract.revision;
            let steps = self.bracketing.steps().iter();
            self.in_force = steps
                .map(|step| contract.in_force_at(step.exposure))
                .collect();
        }
        Arc::clone(&self.in_force[step])
    }
}

/// Sets an exposure and says which one the camera took.
fn set_exposure(video: &mut impl Video, control: &ControlDescription, value: i64) -> Result<i64> {
    match video.set_control(control.id, control.kind, value) {
        Ok(()) | Err(Errno::RANGE) => video.control(control.id, control.kind),
        Err(error) => Err(error),
    }
}
