//! One control: what is wanted of it, and what became of it.

use super::names;
use crate::video::{ControlDescription, ControlKind, Controls, is_gone};
use penumbra_interface::{ControlReport, ControlStanding};
use rustix::io::{Errno, Result};
use std::sync::Arc;
use v4l::control::Flags;

pub(super) struct Entry {
    /// As the settings spell it.
    pub name: Arc<str>,
    /// `None`: only looked at.
    wanted: Option<i64>,
    pub control: Option<ControlDescription>,
    pub in_force: Option<i64>,
    standing: ControlStanding,
    /// The driver tells when it changes.
    pub watched: bool,
}

/// Present name of a control as the driver describes it.
pub(super) fn name(control: &ControlDescription) -> String {
    names::canonical(&names::of_title(&control.title)).to_owned()
}

impl Entry {
    pub fn new(name: &str, wanted: Option<i64>, control: Option<ControlDescription>) -> Self {
        Self {
            name: name.into(),
            wanted,
            control,
            in_force: None,
            standing: ControlStanding::Missing,
            watched: false,
        }
    }

    pub fn is(&self, name: &str) -> bool {
        names::canonical(&self.name) == name
    }

    pub fn has_id(&self, id: u32) -> bool {
        self.control
            .as_ref()
            .is_some_and(|control| control.id == id)
    }

    /// Sets what is wanted and reads it back; `owner` is advice should an automatic mode
    /// be in the way.
    pub fn set(&mut self, video: &mut impl Controls, owner: Option<&str>) -> Result<()> {
        let Some(control) = self.control.clone() else {
            return Ok(());
        };
        let Some(wanted) = self.wanted else {
            self.in_force = read(video, &control)?;
            return Ok(());
        };
        let outcome = write(video, &control, wanted);
        self.in_force = read(video, &control)?;
        self.standing = match outcome {
            Err(error) if is_gone(error) => return Err(error),
            Err(error) => ControlStanding::Refused(reason(error, &control, owner)),
            Ok(()) => self.compared(video, &control, wanted, owner)?,
        };
        Ok(())
    }

    /// What reading back says of a value that the driver took.
    fn compared(
        &self,
        video: &impl Controls,
        control: &ControlDescription,
        wanted: i64,
        owner: Option<&str>,
    ) -> Result<ControlStanding> {
        // Some drivers take a value that they ignore, because an automatic mode is on.
        let flags = passing(video.control_flags(control.id))?.unwrap_or(Flags::empty());
        if flags.contains(Flags::INACTIVE) && owner.is_some() {
            return Ok(ControlStanding::Refused(reason(
                Errno::ACCESS,
                control,
                owner,
            )));
        }
        Ok(match self.in_force {
            Some(now) if now != wanted => ControlStanding::Adjusted,
            _ => ControlStanding::Held,
        })
    }

    pub fn watch(&mut self, video: &mut impl Controls) {
        if let Some(control) = &self.control {
            self.watched = video.watch_control(control.id).is_ok();
        }
    }

    /// Reads it anew; whether somebody has changed what is locked.
    pub fn look(&mut self, video: &impl Controls) -> Result<bool> {
        let Some(control) = &self.control else {
            return Ok(false);
        };
        let now = read(video, control)?;
        if now == self.in_force {
            return Ok(false);
        }
        self.in_force = now;
        let Some(wanted) = self.wanted else {
            return Ok(false);
        };
        let back = now == Some(wanted);
        self.standing = if back {
            ControlStanding::Held
        } else {
            ControlStanding::Changed
        };
        Ok(!back)
    }

    pub fn report(&self) -> Option<ControlReport> {
        Some(ControlReport {
            name: Arc::clone(&self.name),
            wanted: self.wanted?,
            in_force: self.in_force,
            standing: self.standing.clone(),
        })
    }
}

/// An error that only says "not now" is no value; that the device is gone is an error.
fn passing<T>(outcome: Result<T>) -> Result<Option<T>> {
    match outcome {
        Ok(value) => Ok(Some(value)),
        Err(error) if is_gone(error) => Err(error),
        Err(_) => Ok(None),
    }
}

fn read(video: &impl Controls, control: &ControlDescription) -> Result<Option<i64>> {
    if control.flags.contains(Flags::WRITE_ONLY) || control.kind == ControlKind::Other {
        return Ok(None);
    }
    passing(video.control(control.id, control.kind))
}

/// Sets a value. Out of range is set to the nearest in range, as most drivers do
/// themselves; a USB transfer that fails (EIO, EPIPE: a stalled endpoint) is tried twice.
fn write(video: &mut impl Controls, control: &ControlDescription, wanted: i64) -> Result<()> {
    let (id, kind) = (control.id, control.kind);
    match video.set_control(id, kind, wanted) {
        Err(Errno::RANGE) if control.min <= control.max => {
            let nearest = wanted.clamp(control.min, control.max);
            let steps = (nearest - control.min) / control.step.max(1);
            video.set_control(id, kind, control.min + steps * control.step.max(1))
        }
        Err(Errno::IO | Errno::PIPE | Errno::TIMEDOUT) => video.set_control(id, kind, wanted),
        other => other,
    }
}

fn reason(error: Errno, control: &ControlDescription, owner: Option<&str>) -> String {
    let flags = control.flags;
    match (error, owner) {
        _ if flags.contains(Flags::READ_ONLY) => "it can only be read".to_owned(),
        (Errno::ACCESS | Errno::INVAL, Some(owner)) => owner.to_owned(),
        (Errno::ACCESS, None) => "an automatic mode owns it".to_owned(),
        (Errno::BUSY, _) => "the driver has it in use, or another program does".to_owned(),
        (Errno::INVAL | Errno::RANGE, None) => format!(
            "not one of its values, which are {} to {} in steps of {}",
            control.min, control.max, control.step
        ),
        (other, _) => other.to_string(),
    }
}
