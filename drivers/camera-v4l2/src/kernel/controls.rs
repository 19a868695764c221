//! The controls of an open device.
//!
//! They are accessed by raw commands, because calls of the crate `v4l` 0.14 have defects:
//! - `query_controls` and `control` panic on control types that the crate does not know and on
//!   names that are not UTF-8. `query_controls` also panics on a menu with a step of 0, and
//!   reads menus of any length.
//! - `control` does not read integer menus, bit masks and buttons.
//! - `set_control` fails with old drivers that have no extended controls. It passes 32-bit
//!   values as 64-bit ones, which are cut without an error, and wrong on big-endian machines.

use super::ioctl::{self, Argument, Command};
use super::{V4l2Device, text};
use crate::device::{ControlDescription, ControlEvent, ControlKind, Controls};
use rustix::io::{Errno, Result};
use v4l::control::{Flags, Type};
use v4l::v4l_sys as sys;

/// More controls than any camera has: a driver's list may never end.
const MAX_CONTROLS: usize = 1024;
/// More items than any menu has: a driver may report any range.
const MAX_MENU_ITEMS: i64 = 256;

impl V4l2Device {
    /// The values of a menu and their meanings. Drivers may leave values out.
    pub(crate) fn menu(&self, control: &ControlDescription) -> Vec<(i64, String)> {
        if !matches!(control.kind, ControlKind::Menu | ControlKind::IntegerMenu) {
            return Vec::new();
        }
        let first = control.min.max(0);
        let last = control.max.min(first.saturating_add(MAX_MENU_ITEMS - 1));
        let item = |index| Some((index, self.menu_item(control, index)?));
        (first..=last).filter_map(item).collect()
    }

    fn menu_item(&self, control: &ControlDescription, index: i64) -> Option<String> {
        let mut item = sys::v4l2_querymenu {
            id: control.id,
            index: u32::try_from(index).ok()?,
            ..sys::v4l2_querymenu::zeroed()
        };
        self.send(&ioctl::QUERYMENU, &mut item).ok()?;
        let meaning = item.__bindgen_anon_1;
        // SAFETY: every bit pattern is a valid value of both members.
        Some(match control.kind {
            ControlKind::IntegerMenu => unsafe { meaning.value }.to_string(),
            _ => text(unsafe { meaning.name }),
        })
    }

    fn query_control(&self, id: u32) -> Result<sys::v4l2_query_ext_ctrl> {
        let mut query = sys::v4l2_query_ext_ctrl {
            id,
            ..sys::v4l2_query_ext_ctrl::zeroed()
        };
        self.send(&ioctl::QUERY_EXT_CTRL, &mut query)?;
        Ok(query)
    }

    /// Reads or writes a 64-bit control.
    fn extended_control(
        &self,
        command: &Command<sys::v4l2_ext_controls>,
        id: u32,
        value: i64,
    ) -> Result<i64> {
        let mut control = sys::v4l2_ext_control {
            id,
            ..sys::v4l2_ext_control::zeroed()
        };
        control.__bindgen_anon_1.value64 = value;
        let mut list = sys::v4l2_ext_controls {
            count: 1,
            controls: &raw mut control,
            ..sys::v4l2_ext_controls::zeroed()
        };
        self.send(command, &mut list)?;
        // SAFETY: every bit pattern is a valid integer.
        Ok(unsafe { control.__bindgen_anon_1.value64 })
    }
}

impl Controls for V4l2Device {
    fn describe_controls(&self) -> Vec<ControlDescription> {
        let mut found = Vec::new();
        let mut last_id = 0;
        while let Ok(query) = self.query_control(last_id | sys::V4L2_CTRL_FLAG_NEXT_CTRL) {
            if query.id <= last_id || found.len() >= MAX_CONTROLS {
                break;
            }
            last_id = query.id;
            // The list has headings, which are called classes.
            let is_heading = query.type_ == sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_CTRL_CLASS;
            if !is_heading && query.flags & sys::V4L2_CTRL_FLAG_DISABLED == 0 {
                found.push(describe(&query));
            }
        }
        found
    }

    fn control_flags(&self, id: u32) -> Result<Flags> {
        Ok(Flags::from(self.query_control(id)?.flags))
    }

    fn read_control(&self, id: u32, kind: ControlKind) -> Result<i64> {
        if kind == ControlKind::Integer64 {
            return self.extended_control(&ioctl::G_EXT_CTRLS, id, 0);
        }
        let mut control = sys::v4l2_control { id, value: 0 };
        self.send(&ioctl::G_CTRL, &mut control)?;
        Ok(widen(kind, control.value))
    }

    fn write_control(&mut self, id: u32, kind: ControlKind, value: i64) -> Result<()> {
        if kind == ControlKind::Integer64 {
            self.extended_control(&ioctl::S_EXT_CTRLS, id, value)?;
            return Ok(());
        }
        let value = match kind {
            ControlKind::Bitmask => u32::try_from(value).map(u32::cast_signed),
            _ => i32::try_from(value),
        };
        let value = value.map_err(|_| Errno::RANGE)?;
        self.send(&ioctl::S_CTRL, &mut sys::v4l2_control { id, value })
    }

    fn subscribe_control(&mut self, id: u32) -> Result<()> {
        let mut subscription = sys::v4l2_event_subscription {
            type_: sys::V4L2_EVENT_CTRL,
            id,
            ..sys::v4l2_event_subscription::zeroed()
        };
        self.send(&ioctl::SUBSCRIBE_EVENT, &mut subscription)
    }

    fn next_event(&mut self) -> Result<Option<ControlEvent>> {
        let mut event = sys::v4l2_event::zeroed();
        match self.send(&ioctl::DQEVENT, &mut event) {
            Ok(()) => Ok(Some(control_event(&event))),
            Err(Errno::NOENT | Errno::AGAIN) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

fn describe(query: &sys::v4l2_query_ext_ctrl) -> ControlDescription {
    ControlDescription {
        id: query.id,
        title: text(query.name.map(|letter| letter as u8)),
        kind: kind(query.type_),
        min: query.minimum,
        max: query.maximum,
        step: i64::try_from(query.step).unwrap_or(i64::MAX),
        default: query.default_value,
        flags: Flags::from(query.flags),
    }
}

fn kind(number: u32) -> ControlKind {
    match Type::try_from(number) {
        Ok(Type::Integer) => ControlKind::Integer,
        Ok(Type::Boolean) => ControlKind::Boolean,
        Ok(Type::Menu) => ControlKind::Menu,
        Ok(Type::Button) => ControlKind::Button,
        Ok(Type::Integer64) => ControlKind::Integer64,
        Ok(Type::Bitmask) => ControlKind::Bitmask,
        Ok(Type::IntegerMenu) => ControlKind::IntegerMenu,
        _ => ControlKind::Other,
    }
}

/// A 32-bit value as a 64-bit one. The highest bit of a bit mask is not a sign.
const fn widen(kind: ControlKind, value: i32) -> i64 {
    match kind {
        ControlKind::Bitmask => value.cast_unsigned() as i64,
        _ => value as i64,
    }
}

pub(super) fn control_event(event: &sys::v4l2_event) -> ControlEvent {
    // SAFETY: every bit pattern is a valid value of this member. Control events have it.
    let changes = unsafe { event.u.ctrl }.changes;
    let value_changed = changes & sys::V4L2_EVENT_CTRL_CH_VALUE != 0;
    ControlEvent {
        id: event.id,
        value_changed: event.type_ == sys::V4L2_EVENT_CTRL && value_changed,
    }
}
