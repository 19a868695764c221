//! The contract about controls: what is locked, what is in force, who changed it.

mod entry;
pub(crate) mod names;

use crate::video::Controls;
use entry::Entry;
use penumbra_interface::{
    CameraSettings, ControlReport, ControlsInForce, Exposure, MonotonicTime, OnChange,
};
use rustix::io::Result;
use std::sync::Arc;

/// Seconds between two restorations: two programs that both restore must not chase each
/// other.
const RESTORE_PAUSE_NANOS: i64 = 1_000_000_000;
/// How often controls are read back of which the driver sends no events.
const READ_BACK_NANOS: i64 = 2_000_000_000;
/// Unit of `exposure_time_absolute`: 100 µs (kernel documentation, Camera Control
/// Reference, `V4L2_CID_EXPOSURE_ABSOLUTE`).
const EXPOSURE_UNIT_MICROS: f64 = 100.0;

pub(crate) const EXPOSURE: &str = "exposure_time_absolute";
const AUTO_EXPOSURE: &str = "auto_exposure";
/// What frames tell beside what is locked.
const OBSERVED: [&str; 5] = [
    AUTO_EXPOSURE,
    EXPOSURE,
    "gain",
    "white_balance_automatic",
    "white_balance_temperature",
];

/// All that is kept of one camera's controls.
pub(crate) struct Contract {
    /// In the order in which they are set.
    entries: Vec<Entry>,
    on_change: OnChange,
    gain_per_unit: Option<f64>,
    report: Arc<[ControlReport]>,
    in_force: ControlsInForce,
    /// Grows with every change of `in_force`.
    pub(crate) revision: u64,
    /// Times that somebody else changed a locked control.
    pub(crate) changed: u64,
    /// The controls that were.
    tampered: Vec<Arc<str>>,
    /// The exposure is cycled, so it is neither set nor watched here.
    pub(crate) exposure_is_cycled: bool,
    restored_at: Option<MonotonicTime>,
    restore_due: bool,
    read_back_at: MonotonicTime,
}

impl Contract {
    /// Finds the settings' controls among those of the camera.
    pub(crate) fn new(video: &impl Controls, settings: &CameraSettings) -> Self {
        let described = video.describe_controls();
        let find = |name: &str| {
            let named = |d: &&_| entry::name(d) == names::canonical(name);
            described.iter().find(named).cloned()
        };
        let locked = settings.controls.iter();
        let mut entries: Vec<Entry> = locked
            .map(|(name, wanted)| Entry::new(name, Some(*wanted), find(name)))
            .collect();
        for name in OBSERVED {
            let known = entries.iter().any(|entry| entry.is(name));
            if let (false, Some(found)) = (known, find(name)) {
                entries.push(Entry::new(name, None, Some(found)));
            }
        }
        entries.sort_by_key(|entry| names::rank(&entry.name));
        let mut contract = Self {
            entries,
            on_change: settings.on_change,
            gain_per_unit: settings.gain_per_unit,
            report: Arc::default(),
            in_force: Arc::from([]),
            revision: 0,
            changed: 0,
            tampered: Vec::new(),
            exposure_is_cycled: false,
            restored_at: None,
            restore_due: false,
            read_back_at: MonotonicTime::default(),
        };
        contract.publish();
        contract
    }

    /// Sets all that is locked, in order, and reads everything back.
    ///
    /// # Errors
    /// Only that the device is gone; what it refuses is in the report.
    pub(crate) fn apply(&mut self, video: &mut impl Controls) -> Result<()> {
        for place in 0..self.entries.len() {
            if self.exposure_is_cycled && self.entries[place].is(EXPOSURE) {
                continue;
            }
            let owner = self.owner(place);
            self.entries[place].set(video, owner.as_deref())?;
        }
        self.publish();
        Ok(())
    }

    /// Asks for events about everything that is locked or observed.
    pub(crate) fn watch(&mut self, video: &mut impl Controls) {
        for entry in &mut self.entries {
            entry.watch(video);
        }
    }

    /// Takes the events that wait.
    pub(crate) fn on_events(
        &mut self,
        video: &mut impl Controls,
        now: MonotonicTime,
    ) -> Result<()> {
        while let Some(event) = video.next_event()? {
            let found = self.entries.iter().position(|entry| entry.has_id(event.id));
            if let (Some(place), true) = (found, event.value_changed) {
                self.look_at(place, video)?;
            }
        }
        self.publish();
        self.restore(video, now)
    }

    /// What is due now: a restoration that had to wait, controls without events.
    pub(crate) fn tick(&mut self, video: &mut impl Controls, now: MonotonicTime) -> Result<()> {
        if now.nanos_since(self.read_back_at) >= READ_BACK_NANOS {
            self.read_back_at = now;
            for place in 0..self.entries.len() {
                if !self.entries[place].watched {
                    self.look_at(place, video)?;
                }
            }
            self.publish();
        }
        self.restore(video, now)
    }

    /// Reads one control; a locked one that is not as it was is somebody's doing.
    fn look_at(&mut self, place: usize, video: &impl Controls) -> Result<()> {
        let entry = &mut self.entries[place];
        if self.exposure_is_cycled && entry.is(EXPOSURE) {
            return Ok(());
        }
        if entry.look(video)? {
            self.changed += 1;
            if !self.tampered.contains(&entry.name) {
                self.tampered.push(Arc::clone(&entry.name));
            }
            self.restore_due |= self.on_change == OnChange::Restore;
        }
        Ok(())
    }

    /// What others did, in a sentence; `None` if nobody did anything.
    pub(crate) fn tampering(&self) -> Option<String> {
        let end = match self.on_change {
            OnChange::Restore => "set back",
            OnChange::Report => "left so",
        };
        let names = self.tampered.join(" and ");
        (!names.is_empty()).then(|| format!("another program changed {names}; {end}"))
    }

    fn restore(&mut self, video: &mut impl Controls, now: MonotonicTime) -> Result<()> {
        let waited = |at: MonotonicTime| now.nanos_since(at) >= RESTORE_PAUSE_NANOS;
        if !self.restore_due || !self.restored_at.is_none_or(waited) {
            return Ok(());
        }
        self.restore_due = false;
        self.restored_at = Some(now);
        // All of them: whoever switched an automatic mode on has changed what it owns, too.
        self.apply(video)
    }

    /// The automatic mode that has a control now, as advice to the user.
    fn owner(&self, place: usize) -> Option<String> {
        let owners = names::owners(&self.entries[place].name);
        owners.iter().find_map(|(owner, free)| {
            let entry = self.entries.iter().find(|entry| entry.is(owner))?;
            let now = entry.in_force.filter(|now| now != free)?;
            Some(format!(
                "{owner} = {now} owns it; lock {owner} = {free}, too"
            ))
        })
    }

    fn publish(&mut self) {
        let report: Vec<_> = self.entries.iter().filter_map(Entry::report).collect();
        if *report != *self.report {
            self.report = report.into();
        }
        let known = self.entries.iter();
        let in_force: Vec<_> = known
            .filter_map(|entry| Some((Arc::clone(&entry.name), entry.in_force?)))
            .collect();
        if *in_force != *self.in_force {
            self.in_force = in_force.into();
            self.revision += 1;
        }
    }

    pub(crate) fn report(&self) -> Arc<[ControlReport]> {
        Arc::clone(&self.report)
    }

    pub(crate) fn in_force(&self) -> ControlsInForce {
        Arc::clone(&self.in_force)
    }

    /// The same with another exposure.
    pub(crate) fn in_force_at(&self, exposure: i64) -> ControlsInForce {
        let replaced = self.in_force.iter().map(|(name, value)| {
            let value = if names::canonical(name) == EXPOSURE {
                exposure
            } else {
                *value
            };
            (Arc::clone(name), value)
        });
        replaced.collect()
    }

    /// Value in force of a control by its present name.
    pub(crate) fn value(&self, name: &str) -> Option<i64> {
        self.entries.iter().find(|entry| entry.is(name))?.in_force
    }

    /// Whether the exposure time stays as it is set: manual, or shutter priority.
    pub(crate) fn exposure_is_fixed(&self) -> bool {
        self.value(AUTO_EXPOSURE)
            .is_none_or(|mode| mode == 1 || mode == 2)
    }

    /// What the controls say of a frame that is exposed for `exposure` units.
    pub(crate) fn exposure_at(&self, exposure: i64) -> Exposure {
        let units = self.value("gain").unwrap_or(0).max(0) as f64;
        let gain = self.gain_per_unit.map(|per_unit| units * per_unit);
        Exposure {
            exposure_micros: exposure.max(0) as f64 * EXPOSURE_UNIT_MICROS,
            gain: gain.filter(|gain| *gain > 0.0).unwrap_or(1.0),
        }
    }

    /// What the controls say of a frame now; `None` while an automatic mode chooses the
    /// exposure, because what can be read then lags behind.
    pub(crate) fn exposure(&self) -> Option<Exposure> {
        let exposure = self.value(EXPOSURE)?;
        self.exposure_is_fixed().then(|| self.exposure_at(exposure))
    }

    /// The exposure control, for the one who cycles it.
    pub(crate) fn exposure_control(&self) -> Option<crate::video::ControlDescription> {
        let entry = self.entries.iter().find(|entry| entry.is(EXPOSURE))?;
        entry.control.clone()
    }
}

#[cfg(test)]
mod tests;
