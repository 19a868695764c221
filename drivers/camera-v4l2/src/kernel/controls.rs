//! Controls of an open device.

use super::abi::{
    CTRL_FLAG_NEXT_CTRL, Control, EVENT_CTRL, EVENT_CTRL_CH_VALUE, Event, EventSubscription,
    ExtControl, ExtControls, QueryExtCtrl, QueryMenu,
};
use super::{Node, command, text};
use crate::video::{ControlDescription, ControlEvent, ControlKind, Controls};
use bytemuck::Zeroable;
use rustix::io::{Errno, Result};

/// No camera has so many; a driver whose list goes round would be asked for ever.
const MAX_CONTROLS: usize = 1024;

impl Node {
    /// What the values of a menu mean; drivers leave some out.
    pub(crate) fn menu(&self, control: &ControlDescription) -> Vec<(i64, String)> {
        let is_number = match control.kind {
            ControlKind::Menu => false,
            ControlKind::IntegerMenu => true,
            _ => return Vec::new(),
        };
        // Menus are short; a damaged range must not be walked to its end.
        let last = control.max.min(control.min.saturating_add(255));
        (control.min.max(0)..=last)
            .filter_map(|index| {
                let mut item = QueryMenu {
                    id: control.id,
                    index: u32::try_from(index).ok()?,
                    ..QueryMenu::zeroed()
                };
                command::QUERYMENU.call(&self.fd, &mut item).ok()?;
                let mut number = [0; 8];
                number.copy_from_slice(&item.name[..8]);
                let meaning = if is_number {
                    i64::from_ne_bytes(number).to_string()
                } else {
                    text(&item.name)
                };
                Some((index, meaning))
            })
            .collect()
    }

    fn query(&self, id: u32) -> Result<QueryExtCtrl> {
        let mut query = QueryExtCtrl {
            id,
            ..QueryExtCtrl::zeroed()
        };
        command::QUERY_EXT_CTRL.call(&self.fd, &mut query)?;
        Ok(query)
    }

    fn extended(
        &self,
        command: &command::Command<ExtControls>,
        id: u32,
        value: i64,
    ) -> Result<i64> {
        let mut control = ExtControl {
            id,
            size: 0,
            reserved: 0,
            value,
        };
        let mut list = ExtControls {
            count: 1,
            controls: &raw mut control,
            ..ExtControls::zeroed()
        };
        command.call(&self.fd, &mut list)?;
        Ok(control.value)
    }
}

impl Controls for Node {
    fn describe_controls(&self) -> Vec<ControlDescription> {
        let mut found = Vec::new();
        let mut last = 0;
        while let Ok(query) = self.query(last | CTRL_FLAG_NEXT_CTRL) {
            if query.id <= last || found.len() >= MAX_CONTROLS {
                break;
            }
            last = query.id;
            // Headings of the list, and what the driver has switched off.
            let heading = query.kind == 6;
            if !heading && query.flags & ControlDescription::DISABLED == 0 {
                found.push(describe(&query));
            }
        }
        found
    }

    fn control_flags(&self, id: u32) -> Result<u32> {
        Ok(self.query(id)?.flags)
    }

    fn control(&self, id: u32, kind: ControlKind) -> Result<i64> {
        if kind == ControlKind::Integer64 {
            return self.extended(&command::G_EXT_CTRLS, id, 0);
        }
        let mut control = Control { id, value: 0 };
        command::G_CTRL.call(&self.fd, &mut control)?;
        Ok(widened(kind, control.value))
    }

    fn set_control(&mut self, id: u32, kind: ControlKind, value: i64) -> Result<()> {
        if kind == ControlKind::Integer64 {
            return self.extended(&command::S_EXT_CTRLS, id, value).map(|_| ());
        }
        let value = match kind {
            ControlKind::Bitmask => u32::try_from(value).map(|bits| bits as i32),
            _ => i32::try_from(value),
        };
        let value = value.map_err(|_| Errno::RANGE)?;
        command::S_CTRL.call(&self.fd, &mut Control { id, value })
    }

    fn watch_control(&mut self, id: u32) -> Result<()> {
        let mut subscription = EventSubscription {
            kind: EVENT_CTRL,
            id,
            ..EventSubscription::zeroed()
        };
        command::SUBSCRIBE_EVENT.call(&self.fd, &mut subscription)
    }

    fn next_event(&mut self) -> Result<Option<ControlEvent>> {
        let mut event = Event::zeroed();
        match command::DQEVENT.call(&self.fd, &mut event) {
            Ok(()) => Ok(Some(ControlEvent {
                id: event.id,
                value_changed: event.kind == EVENT_CTRL && event.changes & EVENT_CTRL_CH_VALUE != 0,
                value: event_value(&event),
            })),
            Err(Errno::NOENT | Errno::AGAIN) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

fn describe(query: &QueryExtCtrl) -> ControlDescription {
    ControlDescription {
        id: query.id,
        title: text(&query.name),
        kind: kind(query.kind),
        min: query.minimum,
        max: query.maximum,
        step: i64::try_from(query.step).unwrap_or(i64::MAX),
        default: query.default_value,
        flags: query.flags,
    }
}

/// `enum v4l2_ctrl_type`.
const fn kind(number: u32) -> ControlKind {
    match number {
        1 => ControlKind::Integer,
        2 => ControlKind::Boolean,
        3 => ControlKind::Menu,
        4 => ControlKind::Button,
        5 => ControlKind::Integer64,
        8 => ControlKind::Bitmask,
        9 => ControlKind::IntegerMenu,
        _ => ControlKind::Other,
    }
}

/// A bit mask's highest bit is no sign.
const fn widened(kind: ControlKind, value: i32) -> i64 {
    match kind {
        ControlKind::Bitmask => value as u32 as i64,
        _ => value as i64,
    }
}

/// The union holds 64 bits for 64-bit controls alone; otherwise the first four bytes.
fn event_value(event: &Event) -> i64 {
    match kind(event.control_kind) {
        ControlKind::Integer64 => event.value,
        other => {
            let bytes = event.value.to_ne_bytes();
            widened(
                other,
                i32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            )
        }
    }
}
