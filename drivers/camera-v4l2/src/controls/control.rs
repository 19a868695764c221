//! One control: the wanted value, the actual value, and how they compare.

use super::names;
use crate::device::{ControlDescription, ControlKind, Controls, is_disconnected};
use penumbra_interface::{ControlReport, ControlStanding};
use rustix::io::{Errno, Result};
use std::sync::Arc;
use v4l::control::Flags;

/// A control that is locked or observed.
pub(super) struct TrackedControl {
    /// As the settings spell it.
    pub name: Arc<str>,
    /// `None`: observed only.
    wanted: Option<i64>,
    /// `None`: the camera has no such control.
    pub description: Option<ControlDescription>,
    pub in_force: Option<i64>,
    standing: ControlStanding,
    /// Whether the driver reports changes. If not, the control must be read now and then.
    pub has_events: bool,
}

/// The present name of a control.
pub(super) fn name(control: &ControlDescription) -> String {
    names::present_name(&names::from_title(&control.title)).to_owned()
}

impl TrackedControl {
    pub fn new(name: &str, wanted: Option<i64>, description: Option<ControlDescription>) -> Self {
        Self {
            name: name.into(),
            wanted,
            description,
            in_force: None,
            standing: ControlStanding::Missing,
            has_events: false,
        }
    }

    /// Whether this is the control with the present name `name`.
    pub fn is(&self, name: &str) -> bool {
        names::present_name(&self.name) == name
    }

    pub fn has_id(&self, id: u32) -> bool {
        let id_of = |control: &ControlDescription| control.id;
        self.description.as_ref().map(id_of) == Some(id)
    }

    /// Writes the wanted value, if there is one, and reads the control back. `advice` tells
    /// the user how to end an automatic mode that governs the control now.
    pub fn apply(&mut self, device: &mut impl Controls, advice: Option<&str>) -> Result<()> {
        let Some(control) = self.description.clone() else {
            return Ok(());
        };
        let Some(wanted) = self.wanted else {
            self.in_force = read(device, &control)?;
            return Ok(());
        };
        let written = write(device, &control, wanted);
        self.in_force = read(device, &control)?;
        self.standing = match written {
            Err(error) if is_disconnected(error) => return Err(error),
            Err(error) => ControlStanding::Refused(reason(error, &control, advice)),
            Ok(()) => self.standing_after_write(device, &control, wanted, advice)?,
        };
        Ok(())
    }

    /// The standing of a control whose driver has accepted the wanted value.
    fn standing_after_write(
        &self,
        device: &impl Controls,
        control: &ControlDescription,
        wanted: i64,
        advice: Option<&str>,
    ) -> Result<ControlStanding> {
        // Some drivers accept and ignore a value while an automatic mode governs the control.
        let flags = unless_disconnected(device.control_flags(control.id))?;
        if flags.is_some_and(|flags| flags.contains(Flags::INACTIVE)) && advice.is_some() {
            let reason = reason(Errno::ACCESS, control, advice);
            return Ok(ControlStanding::Refused(reason));
        }
        Ok(match self.in_force {
            Some(now) if now != wanted => ControlStanding::Adjusted,
            _ => ControlStanding::Held,
        })
    }

    /// Asks the driver to report changes.
    pub fn subscribe(&mut self, device: &mut impl Controls) {
        if let Some(control) = &self.description {
            self.has_events = device.subscribe_control(control.id).is_ok();
        }
    }

    /// Reads the control. Returns whether another program has changed a locked value.
    pub fn refresh(&mut self, device: &impl Controls) -> Result<bool> {
        let Some(control) = &self.description else {
            return Ok(false);
        };
        let now = read(device, control)?;
        if now == self.in_force {
            return Ok(false);
        }
        self.in_force = now;
        let Some(wanted) = self.wanted else {
            return Ok(false);
        };
        let is_wanted = now == Some(wanted);
        self.standing = if is_wanted {
            ControlStanding::Held
        } else {
            ControlStanding::Changed
        };
        Ok(!is_wanted)
    }

    /// The report on a locked control; `None` for one that is only observed.
    pub fn report(&self) -> Option<ControlReport> {
        Some(ControlReport {
            name: Arc::clone(&self.name),
            wanted: self.wanted?,
            in_force: self.in_force,
            standing: self.standing.clone(),
        })
    }
}

/// Turns errors into `None`, except those of a disconnected device.
fn unless_disconnected<T>(result: Result<T>) -> Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(error) if is_disconnected(error) => Err(error),
        Err(_) => Ok(None),
    }
}

fn read(device: &impl Controls, control: &ControlDescription) -> Result<Option<i64>> {
    if control.flags.contains(Flags::WRITE_ONLY) || control.kind == ControlKind::Other {
        return Ok(None);
    }
    unless_disconnected(device.read_control(control.id, control.kind))
}

/// Writes a value. If the driver refuses it as out of range, the nearest valid value is
/// written, as most drivers do themselves. A USB transfer that fails (EIO, ETIMEDOUT, and EPIPE
/// for a stalled endpoint) is repeated once.
fn write(device: &mut impl Controls, control: &ControlDescription, wanted: i64) -> Result<()> {
    let (id, kind) = (control.id, control.kind);
    match device.write_control(id, kind, wanted) {
        Err(Errno::RANGE) if control.min <= control.max => {
            device.write_control(id, kind, nearest_valid(control, wanted))
        }
        Err(Errno::IO | Errno::PIPE | Errno::TIMEDOUT) => device.write_control(id, kind, wanted),
        other => other,
    }
}

/// The valid value at or below `wanted`. The range must not be empty, but may be any: drivers
/// report the full range of 64 bits.
fn nearest_valid(control: &ControlDescription, wanted: i64) -> i64 {
    let nearest = wanted.clamp(control.min, control.max);
    let above_min = nearest.abs_diff(control.min);
    let excess = above_min % control.step.max(1).unsigned_abs();
    nearest.saturating_sub_unsigned(excess)
}

/// Why a value was refused.
fn reason(error: Errno, control: &ControlDescription, advice: Option<&str>) -> String {
    match (error, advice) {
        _ if control.flags.contains(Flags::READ_ONLY) => "it can only be read".to_owned(),
        (Errno::ACCESS | Errno::INVAL, Some(advice)) => advice.to_owned(),
        (Errno::ACCESS, None) => "an automatic mode governs it".to_owned(),
        (Errno::BUSY, _) => "the driver or another program is using it".to_owned(),
        (Errno::INVAL | Errno::RANGE, None) => format!(
            "not one of its values, which are {} to {} in steps of {}",
            control.min, control.max, control.step
        ),
        (other, _) => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_valid_value_is_found_in_any_range() {
        let nearest = |min, max, step, wanted| {
            let control = ControlDescription {
                id: 1,
                title: String::new(),
                kind: ControlKind::Integer64,
                min,
                max,
                step,
                default: min,
                flags: Flags::empty(),
            };
            nearest_valid(&control, wanted)
        };
        assert_eq!(nearest(0, 250, 5, 13), 10);
        assert_eq!(nearest(3, 2047, 4, 5000), 2047);
        assert_eq!(nearest(-64, 64, 1, -100), -64);
        assert_eq!(nearest(0, 10, 0, 7), 7);
        assert_eq!(nearest(i64::MIN, i64::MAX, 1, 12), 12);
    }
}
