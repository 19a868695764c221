//! Locks a camera's controls: sets the wanted values, reads them back, and detects and reverts
//! changes by other programs.

mod control;
pub(crate) mod names;

use crate::device::{ControlDescription, Controls};
use control::TrackedControl;
use penumbra_interface::{
    CameraSettings, ControlReport, ControlsInForce, Exposure, MonotonicTime, OnChange,
};
use rustix::io::Result;
use std::sync::Arc;

/// Controls are not restored more often than this, so that two programs that both restore do
/// not keep a processor busy.
const RESTORE_INTERVAL_NANOS: i64 = 1_000_000_000;
/// How often controls without events are read back.
const READ_BACK_INTERVAL_NANOS: i64 = 2_000_000_000;
/// The unit of `exposure_time_absolute` in microseconds (kernel documentation, Camera Control
/// Reference, `V4L2_CID_EXPOSURE_ABSOLUTE`).
const EXPOSURE_UNIT_MICROS: f64 = 100.0;

pub(crate) const EXPOSURE_TIME: &str = "exposure_time_absolute";
const AUTO_EXPOSURE: &str = "auto_exposure";
/// Controls that are recorded with every frame, locked or not.
const OBSERVED: [&str; 5] = [
    AUTO_EXPOSURE,
    EXPOSURE_TIME,
    "gain",
    "white_balance_automatic",
    "white_balance_temperature",
];

/// The controls of one camera that are locked or observed.
pub(crate) struct CameraControls {
    /// In the order in which they are set.
    controls: Vec<TrackedControl>,
    on_change: OnChange,
    gain_per_unit: Option<f64>,
    report: Arc<[ControlReport]>,
    in_force: ControlsInForce,
    /// Increased with every change of `in_force`.
    pub(crate) revision: u64,
    /// How often other programs have changed locked controls.
    pub(crate) changes: u64,
    /// The controls that other programs have changed.
    changed_names: Vec<Arc<str>>,
    /// The exposure time is bracketed. It is then neither set nor watched here.
    pub(crate) exposure_is_bracketed: bool,
    restored_at: Option<MonotonicTime>,
    restore_is_due: bool,
    read_back_at: MonotonicTime,
}

impl CameraControls {
    /// Finds the controls that the settings name. Nothing is written yet.
    pub(crate) fn new(device: &impl Controls, settings: &CameraSettings) -> Self {
        let mut controls = Self {
            controls: tracked(&device.describe_controls(), &settings.controls),
            on_change: settings.on_change,
            gain_per_unit: settings.gain_per_unit,
            report: Arc::default(),
            in_force: Arc::from([]),
            revision: 0,
            changes: 0,
            changed_names: Vec::new(),
            exposure_is_bracketed: false,
            restored_at: None,
            restore_is_due: false,
            read_back_at: MonotonicTime::default(),
        };
        controls.publish();
        controls
    }

    /// Sets all locked controls in order and reads all controls back.
    ///
    /// # Errors
    /// The device is disconnected. Values that it refuses are in the report.
    pub(crate) fn apply(&mut self, device: &mut impl Controls) -> Result<()> {
        for n in 0..self.controls.len() {
            if self.is_bracketed(&self.controls[n]) {
                continue;
            }
            let advice = self.advice(&self.controls[n].name);
            self.controls[n].apply(device, advice.as_deref())?;
        }
        self.publish();
        Ok(())
    }

    /// Asks the driver to report changes of all controls.
    pub(crate) fn subscribe(&mut self, device: &mut impl Controls) {
        for control in &mut self.controls {
            control.subscribe(device);
        }
    }

    /// Handles all pending control events.
    pub(crate) fn on_events(
        &mut self,
        device: &mut impl Controls,
        now: MonotonicTime,
    ) -> Result<()> {
        while let Some(event) = device.next_event()? {
            let found = self.controls.iter().position(|c| c.has_id(event.id));
            if let (Some(n), true) = (found, event.value_changed) {
                self.refresh(n, device)?;
            }
        }
        self.publish();
        self.restore_if_due(device, now)
    }

    /// Does what is due: reads back controls without events, and restores values after the
    /// minimum interval.
    pub(crate) fn tick(&mut self, device: &mut impl Controls, now: MonotonicTime) -> Result<()> {
        if now.nanos_since(self.read_back_at) >= READ_BACK_INTERVAL_NANOS {
            self.read_back_at = now;
            for n in 0..self.controls.len() {
                if !self.controls[n].has_events {
                    self.refresh(n, device)?;
                }
            }
            self.publish();
        }
        self.restore_if_due(device, now)
    }

    /// Reads a control. If a locked one has changed, another program has changed it.
    fn refresh(&mut self, n: usize, device: &impl Controls) -> Result<()> {
        if self.is_bracketed(&self.controls[n]) {
            return Ok(());
        }
        let control = &mut self.controls[n];
        if control.refresh(device)? {
            self.changes += 1;
            if !self.changed_names.contains(&control.name) {
                self.changed_names.push(Arc::clone(&control.name));
            }
            self.restore_is_due |= self.on_change == OnChange::Restore;
        }
        Ok(())
    }

    fn is_bracketed(&self, control: &TrackedControl) -> bool {
        self.exposure_is_bracketed && control.is(EXPOSURE_TIME)
    }

    /// A note for the user about the controls that other programs have changed.
    pub(crate) fn changes_note(&self) -> Option<String> {
        let reaction = match self.on_change {
            OnChange::Restore => "restored",
            OnChange::Report => "not restored",
        };
        let names = self.changed_names.join(" and ");
        (!names.is_empty()).then(|| format!("another program changed {names}; {reaction}"))
    }

    fn restore_if_due(&mut self, device: &mut impl Controls, now: MonotonicTime) -> Result<()> {
        let is_old = |at: MonotonicTime| now.nanos_since(at) >= RESTORE_INTERVAL_NANOS;
        if !self.restore_is_due || !self.restored_at.is_none_or(is_old) {
            return Ok(());
        }
        self.restore_is_due = false;
        self.restored_at = Some(now);
        // All controls: an automatic mode that was switched on has changed those it governs.
        self.apply(device)
    }

    /// How to end the automatic mode that governs a control now, if one does.
    fn advice(&self, name: &str) -> Option<String> {
        let modes = names::automatic_modes(name);
        modes.iter().find_map(|(mode, manual)| {
            let now = self.value(mode).filter(|now| now != manual)?;
            Some(format!(
                "{mode} = {now} governs it; lock {mode} = {manual}, too"
            ))
        })
    }

    /// Makes the present state the one that readers share, if it has changed.
    fn publish(&mut self) {
        let controls = self.controls.iter();
        let report: Vec<_> = controls.filter_map(TrackedControl::report).collect();
        if *report != *self.report {
            self.report = report.into();
        }
        let controls = self.controls.iter();
        let in_force: Vec<_> = controls
            .filter_map(|control| Some((Arc::clone(&control.name), control.in_force?)))
            .collect();
        if *in_force != *self.in_force {
            self.in_force = in_force.into();
            self.revision += 1;
        }
    }

    pub(crate) fn report(&self) -> Arc<[ControlReport]> {
        Arc::clone(&self.report)
    }

    /// The values of all controls that can be read.
    pub(crate) fn in_force(&self) -> ControlsInForce {
        Arc::clone(&self.in_force)
    }

    /// The same with another exposure time.
    pub(crate) fn in_force_with_exposure(&self, exposure: i64) -> ControlsInForce {
        let replaced = self.in_force.iter().map(|(name, value)| {
            let is_exposure = names::present_name(name) == EXPOSURE_TIME;
            let value = if is_exposure { exposure } else { *value };
            (Arc::clone(name), value)
        });
        replaced.collect()
    }

    /// The active value of the control with this name.
    pub(crate) fn value(&self, name: &str) -> Option<i64> {
        let control = self.controls.iter().find(|control| control.is(name))?;
        control.in_force
    }

    /// Whether the exposure time stays as it is set: in manual mode (1) and with shutter
    /// priority (2), or where there is no automatic mode.
    pub(crate) fn exposure_is_fixed(&self) -> bool {
        let mode = self.value(AUTO_EXPOSURE);
        mode.is_none_or(|mode| mode == 1 || mode == 2)
    }

    /// The exposure of a frame whose exposure time is `exposure` units of the control.
    pub(crate) fn exposure_of(&self, exposure: i64) -> Exposure {
        let gain_units = self.value("gain").unwrap_or(0).max(0) as f64;
        let gain = self.gain_per_unit.map(|per_unit| gain_units * per_unit);
        Exposure {
            exposure_micros: exposure.max(0) as f64 * EXPOSURE_UNIT_MICROS,
            gain: gain.filter(|gain| *gain > 0.0).unwrap_or(1.0),
        }
    }

    /// The present exposure. `None` while an automatic mode chooses it: the control then
    /// reports it late, if at all.
    pub(crate) fn exposure(&self) -> Option<Exposure> {
        let exposure = self.value(EXPOSURE_TIME)?;
        self.exposure_is_fixed().then(|| self.exposure_of(exposure))
    }

    /// The control of the exposure time, for bracketing.
    pub(crate) fn exposure_control(&self) -> Option<ControlDescription> {
        let control = self.controls.iter().find(|c| c.is(EXPOSURE_TIME))?;
        control.description.clone()
    }
}

/// The locked and the observed controls, in the order in which they are set.
fn tracked(described: &[ControlDescription], locked: &[(String, i64)]) -> Vec<TrackedControl> {
    let find = |name: &str| {
        let is_named = |d: &&_| control::name(d) == names::present_name(name);
        described.iter().find(is_named).cloned()
    };
    let mut controls: Vec<TrackedControl> = locked
        .iter()
        .map(|(name, wanted)| TrackedControl::new(name, Some(*wanted), find(name)))
        .collect();
    for name in OBSERVED {
        let is_locked = controls.iter().any(|control| control.is(name));
        if let (false, Some(found)) = (is_locked, find(name)) {
            controls.push(TrackedControl::new(name, None, Some(found)));
        }
    }
    controls.sort_by_key(|control| names::set_order(&control.name));
    controls
}

#[cfg(test)]
mod tests;
