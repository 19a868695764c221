//! Bracketing with a camera: [`Bracketing`] decides, this sets exposures and labels frames.

use crate::bracketing::{self, Bracketing};
use crate::brightness::BrightnessMeter;
use crate::controls::{CameraControls, EXPOSURE_TIME};
use crate::device::{ControlDescription, Controls, is_disconnected};
use crate::error::{self, refused};
use crate::stream::{FrameLayout, StreamFrame};
use penumbra_interface::{CameraSettings, ControlsInForce, DeviceError, Exposure};
use rustix::io::{Errno, Result};
use std::sync::Arc;

/// A camera's exposure time, which is cycled.
pub(super) struct BracketedExposure {
    bracketing: Bracketing,
    control: ControlDescription,
    brightness: BrightnessMeter,
    /// The active controls of each step, as of `revision` of the camera's controls.
    in_force: Vec<ControlsInForce>,
    revision: u64,
}

impl BracketedExposure {
    /// Tries all exposures of the cycle that the settings ask for, because frames are labelled
    /// with the values that the camera accepts. `None` if they ask for no bracketing.
    pub(super) fn prepare(
        device: &mut impl Controls,
        controls: &mut CameraControls,
        settings: &CameraSettings,
        path: &str,
    ) -> std::result::Result<Option<Self>, DeviceError> {
        let Some(wanted) = &settings.bracket else {
            return Ok(None);
        };
        let control = controls.exposure_control();
        let control = control.filter(|_| controls.exposure_is_fixed());
        let (Some(control), Some(base)) = (control, controls.value(EXPOSURE_TIME)) else {
            let reason = "bracketing needs the control exposure_time_absolute, and \
                          auto_exposure = 1 among the locked controls";
            return Err(refused(path, reason));
        };
        let mut accepted = Vec::new();
        for value in bracketing::exposures(wanted, base)
            .into_iter()
            .chain([base])
        {
            let value = value.clamp(control.min, control.max.max(control.min));
            let tried = set_exposure(device, &control, value);
            accepted.push(tried.map_err(|e| error::setup_failed(path, "trying exposures", e))?);
        }
        let steps = bracketing::steps(&accepted, base);
        let listed: Vec<i64> = steps.iter().map(|step| step.exposure).collect();
        let bracketing = Bracketing::new(wanted, steps).ok_or_else(|| {
            let ControlDescription { min, max, .. } = control;
            let stops = &wanted.stops;
            let reason = format!(
                "bracketing: of the stops {stops:?} the camera makes the exposures {listed:?} \
                 (range {min} to {max}); two different ones are needed"
            );
            refused(path, reason)
        })?;
        controls.exposure_is_bracketed = true;
        Ok(Some(Self {
            bracketing,
            control,
            brightness: BrightnessMeter::default(),
            in_force: Vec::new(),
            revision: u64::MAX,
        }))
    }

    /// Sets the base exposure again after the stream has started, because some cameras reset
    /// it then.
    pub(super) fn set_base(&self, device: &mut impl Controls) -> Result<()> {
        let base = self.bracketing.base().exposure;
        set_exposure(device, &self.control, base).map(|_| ())
    }

    /// The exposure of a frame, its stops relative to the base, and the active controls;
    /// `None` if the exposure is not certain. Sets the next exposure when it is due.
    pub(super) fn label(
        &mut self,
        frame: &StreamFrame,
        layout: &FrameLayout,
        controls: &CameraControls,
        device: &mut impl Controls,
    ) -> Result<Option<(Exposure, f64, ControlsInForce)>> {
        let brightness = if self.bracketing.needs_brightness() {
            self.brightness.measure(layout, &frame.data)
        } else {
            None
        };
        let decision = self.bracketing.on_frame(frame.sequence, brightness);
        if let Some(step) = decision.set {
            let exposure = self.bracketing.steps()[step].exposure;
            match device.write_control(self.control.id, self.control.kind, exposure) {
                Ok(()) => self.bracketing.on_set(frame.sequence, step),
                Err(error) if is_disconnected(error) => return Err(error),
                // Repeated after the next frame.
                Err(_) => {}
            }
        }
        let Some(step) = decision.step else {
            return Ok(None);
        };
        let label = self.bracketing.steps()[step];
        let exposure = controls.exposure_of(label.exposure);
        Ok(Some((exposure, label.ev, self.in_force(controls, step))))
    }

    /// What was found out about the camera's timing, for the user.
    pub(super) fn timing_note(&self) -> Option<String> {
        self.bracketing.timing_note.clone()
    }

    fn in_force(&mut self, controls: &CameraControls, step: usize) -> ControlsInForce {
        if self.revision != controls.revision {
            self.revision = controls.revision;
            let steps = self.bracketing.steps().iter();
            self.in_force = steps
                .map(|step| controls.in_force_with_exposure(step.exposure))
                .collect();
        }
        Arc::clone(&self.in_force[step])
    }
}

/// Sets an exposure and returns the one that the camera accepted.
fn set_exposure(
    device: &mut impl Controls,
    control: &ControlDescription,
    value: i64,
) -> Result<i64> {
    match device.write_control(control.id, control.kind, value) {
        Ok(()) | Err(Errno::RANGE) => device.read_control(control.id, control.kind),
        Err(error) => Err(error),
    }
}
