//! A camera's controls and their automatic modes.
//!
//! Source: USB Device Class Definition for Video Devices 1.5: 4.2.2 (the controls), 4.1.2
//! (GET_INFO), 2.4.4 (a manual control is disabled while its automatic mode is on) and
//! 4.2.1.2 (request error code).

use crate::Stall;
use crate::picture::Settings;
use crate::usbip::Setup;

pub(crate) const SET_CUR: u8 = 0x01;
pub(crate) const GET_CUR: u8 = 0x81;
pub(crate) const GET_MIN: u8 = 0x82;
pub(crate) const GET_MAX: u8 = 0x83;
pub(crate) const GET_RES: u8 = 0x84;
pub(crate) const GET_LEN: u8 = 0x85;
pub(crate) const GET_INFO: u8 = 0x86;
pub(crate) const GET_DEF: u8 = 0x87;

/// Unit and selector.
type Key = (u8, u8);
const ERROR_CODE: Key = (0, 0x02);
const EXPOSURE_MODE: Key = (1, 0x02);
const EXPOSURE_PRIORITY: Key = (1, 0x03);
const EXPOSURE: Key = (1, 0x04);
const FOCUS: Key = (1, 0x06);
const FOCUS_MODE: Key = (1, 0x08);
const BRIGHTNESS: Key = (2, 0x02);
const CONTRAST: Key = (2, 0x03);
const GAIN: Key = (2, 0x04);
const POWER_LINE: Key = (2, 0x05);
const SHARPNESS: Key = (2, 0x08);
const TEMPERATURE: Key = (2, 0x0a);
const WHITE_BALANCE_MODE: Key = (2, 0x0b);

/// Exposure mode "manual"; "aperture priority", 8, is the automatic one.
const MANUAL: i32 = 1;
/// Request error codes.
const WRONG_STATE: u8 = 0x02;
const OUT_OF_RANGE: u8 = 0x04;

#[derive(Clone, Copy)]
struct Control {
    key: Key,
    size: usize,
    range: [i32; 2],
    /// For the exposure mode: the supported modes, as bits.
    step: i32,
    default: i32,
    current: i32,
}

const fn control(key: Key, size: usize, range: [i32; 2], step: i32, default: i32) -> Control {
    Control {
        key,
        size,
        range,
        step,
        default,
        current: default,
    }
}

const TABLE: [Control; 12] = [
    control(EXPOSURE_MODE, 1, [0, 255], 0x09, 8),
    control(EXPOSURE_PRIORITY, 1, [0, 1], 1, 1),
    control(EXPOSURE, 4, [3, 2047], 1, 157),
    control(FOCUS, 2, [0, 250], 5, 0),
    control(FOCUS_MODE, 1, [0, 1], 1, 1),
    control(BRIGHTNESS, 2, [-64, 64], 1, 0),
    control(CONTRAST, 2, [0, 64], 1, 32),
    control(GAIN, 2, [0, 255], 1, 32),
    control(POWER_LINE, 1, [0, 2], 1, 2),
    control(SHARPNESS, 2, [0, 7], 1, 3),
    control(TEMPERATURE, 2, [2800, 6500], 10, 4600),
    control(WHITE_BALANCE_MODE, 1, [0, 1], 1, 1),
];

/// Every control of one camera.
pub struct Controls {
    controls: [Control; 12],
    last_error: u8,
    /// Number of pictures made so far, from which automatic modes derive their values.
    frames: u32,
    changed: bool,
}

impl Default for Controls {
    fn default() -> Self {
        Self {
            controls: TABLE,
            last_error: 0,
            frames: 0,
            changed: false,
        }
    }
}

impl Controls {
    /// Answers a class request to the control interface: data, or nothing for a SET.
    ///
    /// # Errors
    /// There is no such control or request, or the control is disabled. The request error code,
    /// which the kernel asks for next, tells which.
    pub fn request(&mut self, setup: &Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        let key = ((setup.index >> 8) as u8, (setup.value >> 8) as u8);
        if key == ERROR_CODE && setup.request == GET_CUR {
            return Ok(vec![std::mem::take(&mut self.last_error)]);
        }
        let disabled = self.is_automatic(key);
        let automatic = self.automatic(key);
        let control = self
            .controls
            .iter_mut()
            .find(|control| control.key == key)
            .ok_or(Stall)?;
        let value = match setup.request {
            SET_CUR => return self.set(key, disabled, data).map(|()| Vec::new()),
            GET_CUR if disabled => automatic.unwrap_or(control.current),
            GET_CUR => control.current,
            GET_MIN => control.range[0],
            GET_MAX => control.range[1],
            GET_RES => control.step,
            GET_DEF => control.default,
            GET_LEN => return Ok(vec![control.size as u8, 0]),
            // Bits: GET, SET, disabled by an automatic mode.
            GET_INFO => return Ok(vec![if disabled { 0x07 } else { 0x03 }]),
            _ => return Err(Stall),
        };
        Ok(value.to_le_bytes()[..control.size].to_vec())
    }

    fn set(&mut self, key: Key, disabled: bool, data: &[u8]) -> Result<(), Stall> {
        let control = self
            .controls
            .iter_mut()
            .find(|control| control.key == key)
            .ok_or(Stall)?;
        let value = match *data {
            [a] => i32::from(a),
            [a, b] => i32::from(i16::from_le_bytes([a, b])),
            [a, b, c, d] => i32::from_le_bytes([a, b, c, d]),
            _ => return Err(Stall),
        };
        if disabled {
            self.last_error = WRONG_STATE;
            return Err(Stall);
        }
        if value < control.range[0] || value > control.range[1] {
            self.last_error = OUT_OF_RANGE;
            return Err(Stall);
        }
        control.current = value;
        self.changed = true;
        Ok(())
    }

    /// Whether an automatic mode disables this control.
    fn is_automatic(&self, key: Key) -> bool {
        match key {
            EXPOSURE => self.value(EXPOSURE_MODE) != MANUAL,
            TEMPERATURE => self.value(WHITE_BALANCE_MODE) != 0,
            FOCUS => self.value(FOCUS_MODE) != 0,
            _ => false,
        }
    }

    /// The value that an automatic mode chooses. It varies continuously, by half a stop or 900 K,
    /// so that a camera whose controls are not locked shows it within a second.
    fn automatic(&self, key: Key) -> Option<i32> {
        let swing = (f64::from(self.frames) / 5.0).sin();
        match key {
            EXPOSURE => Some((157.0 * (0.5 * swing).exp2()) as i32),
            TEMPERATURE => Some(4600 + (900.0 * swing) as i32),
            _ => None,
        }
    }

    fn value(&self, key: Key) -> i32 {
        let control = self.controls.iter().find(|control| control.key == key);
        control.map_or(0, |control| control.current)
    }

    fn in_force(&self, key: Key) -> i32 {
        let automatic = self.automatic(key).filter(|_| self.is_automatic(key));
        automatic.unwrap_or_else(|| self.value(key))
    }

    /// The settings of the sensor for the next picture.
    pub fn settings(&mut self) -> Settings {
        self.frames = self.frames.wrapping_add(1);
        Settings {
            exposure: self.in_force(EXPOSURE),
            gain: self.value(GAIN),
            temperature: self.in_force(TEMPERATURE),
            brightness: self.value(BRIGHTNESS),
            contrast: self.value(CONTRAST),
        }
    }

    /// Whether any control was set.
    #[must_use]
    pub fn is_changed(&self) -> bool {
        self.changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setup(request: u8, key: Key) -> Setup {
        Setup {
            kind: if request == SET_CUR { 0x21 } else { 0xa1 },
            request,
            value: u16::from(key.1) << 8,
            index: u16::from(key.0) << 8,
            length: 4,
        }
    }

    #[test]
    fn automatic_mode_disables_its_control_and_reports_it() {
        let mut controls = Controls::default();
        let exposure = 300_i32.to_le_bytes();
        assert_eq!(
            controls.request(&setup(GET_INFO, EXPOSURE), &[]),
            Ok(vec![0x07])
        );
        assert_eq!(
            controls.request(&setup(SET_CUR, EXPOSURE), &exposure),
            Err(Stall)
        );
        assert_eq!(
            controls.request(&setup(GET_CUR, ERROR_CODE), &[]),
            Ok(vec![WRONG_STATE])
        );
        controls
            .request(&setup(SET_CUR, EXPOSURE_MODE), &[1])
            .unwrap();
        controls
            .request(&setup(SET_CUR, EXPOSURE), &exposure)
            .unwrap();
        assert_eq!(
            controls.request(&setup(GET_CUR, EXPOSURE), &[]),
            Ok(exposure.to_vec())
        );
        assert_eq!(controls.settings().exposure, 300);
    }

    #[test]
    fn automatic_modes_keep_changing_their_values() {
        let mut controls = Controls::default();
        let seen: Vec<_> = (0..30).map(|_| controls.settings()).collect();
        let spread = |of: fn(&Settings) -> i32| {
            let values = seen.iter().map(of);
            values.clone().max().unwrap() - values.min().unwrap()
        };
        assert!(spread(|s| s.exposure) > 50 && spread(|s| s.temperature) > 1000);
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let mut controls = Controls::default();
        let gain = 999_i16.to_le_bytes();
        assert_eq!(controls.request(&setup(SET_CUR, GAIN), &gain), Err(Stall));
        assert_eq!(
            controls.request(&setup(GET_CUR, ERROR_CODE), &[]),
            Ok(vec![OUT_OF_RANGE])
        );
    }
}
