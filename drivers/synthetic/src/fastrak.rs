//! A simulated FASTRAK (manual OPM00PI002 Rev G).

use crate::receivers::{in_hemisphere, receiver_pose};
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;

/// Longest command line, bytes; the rest is ignored.
const LINE_LIMIT: usize = 300;
const CENTIMETRES_PER_METRE: f64 = 100.0;
const INCHES_PER_METRE: f64 = 1.0 / 0.0254;
/// Time that a real device takes to re-initialise, seconds.
const RESET_SECONDS: f64 = 10.0;

/// The state of the device.
#[derive(Clone, Debug)]
pub(crate) struct Fastrak {
    binary: bool,
    centimetres: bool,
    continuous: bool,
    stations: [Station; 4],
    /// The beginning of a command line.
    line: Vec<u8>,
    /// Duration of a requested re-initialisation, seconds.
    reset: Option<f64>,
}

#[derive(Clone, Debug)]
struct Station {
    on: bool,
    items: Vec<u8>,
    hemisphere: DVec3,
}

impl Default for Station {
    fn default() -> Self {
        Self {
            on: false,
            items: vec![2, 4, 1],
            hemisphere: DVec3::X,
        }
    }
}

impl Default for Fastrak {
    /// Factory settings, with one receiver.
    fn default() -> Self {
        let mut stations: [Station; 4] = Default::default();
        stations[0].on = true;
        Self {
            binary: false,
            centimetres: false,
            continuous: false,
            stations,
            line: Vec::new(),
            reset: None,
        }
    }
}

impl Fastrak {
    /// Sets the mode of a protocol name.
    pub(crate) fn configure_for(&mut self, protocol: &str) {
        self.binary = protocol.contains("binary");
        let extended = if protocol.contains("extended") { 50 } else { 0 };
        let orientation = if protocol.ends_with("quaternion") {
            11
        } else {
            4
        };
        let ending = u8::from(!self.binary);
        for station in &mut self.stations {
            station.items = vec![2 + extended, orientation + extended, ending];
        }
    }

    pub(crate) fn is_streaming(&self) -> bool {
        self.continuous
    }

    pub(crate) fn take_reset(&mut self) -> Option<f64> {
        self.reset.take()
    }

    /// Executes commands and appends the answers. `pose` is the present pose of the body.
    pub(crate) fn receive(&mut self, bytes: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        for &byte in bytes {
            if self.line.is_empty() {
                self.first_byte(byte, pose, out);
            } else if matches!(byte, b'\r' | b'\n') {
                let line = std::mem::take(&mut self.line);
                self.execute(&line, out);
            } else if self.line.len() < LINE_LIMIT {
                self.line.push(byte);
            }
        }
    }

    /// Handles the first byte of a command. Most single letters need no carriage return.
    fn first_byte(&mut self, byte: u8, pose: RigidTransform, out: &mut Vec<u8>) {
        match byte {
            b'C' => self.continuous = true,
            b'c' => self.continuous = false,
            b'F' => self.binary = false,
            b'f' => self.binary = true,
            b'U' => self.centimetres = false,
            b'u' => self.centimetres = true,
            b'P' => self.records(pose, out),
            b'S' => self.status(out),
            // ^Y: re-initialise with the saved settings, here the factory settings.
            0x19 => {
                *self = Self::default();
                self.reset = Some(RESET_SECONDS);
            }
            // ^K saves, W restores the factory settings at the next ^Y, T clears errors.
            0x0b | b'W' | b'T' | b'\r' | b'\n' => {}
            _ => self.line.push(byte),
        }
    }

    fn execute(&mut self, line: &[u8], out: &mut Vec<u8>) {
        let text = String::from_utf8_lossy(line);
        let Some((command, arguments)) = text.split_at_checked(1) else {
            return;
        };
        let mut arguments = arguments.split(',').map(str::trim);
        let number = arguments.next().and_then(|n| n.parse::<usize>().ok());
        let Some(index) = number.and_then(|n| n.checked_sub(1)).filter(|n| *n < 4) else {
            return;
        };
        let rest: Vec<&str> = arguments.collect();
        match command {
            "l" => self.switch(index, &rest, out),
            "O" => self.choose_items(index, &rest, out),
            "H" => self.choose_hemisphere(index, &rest, out),
            // Alignment, boresight, filters: accepted without effect.
            _ => {}
        }
    }

    fn switch(&mut self, index: usize, rest: &[&str], out: &mut Vec<u8>) {
        match rest {
            ["0" | "1"] => self.stations[index].on = rest == ["1"],
            _ => {
                let states = self.stations.iter().map(|s| if s.on { '1' } else { '0' });
                let states: String = states.collect();
                out.extend(format!("2{}l{states}\r\n", index + 1).bytes());
            }
        }
    }

    fn choose_items(&mut self, index: usize, rest: &[&str], out: &mut Vec<u8>) {
        let items: Option<Vec<u8>> = rest.iter().map(|item| item.parse().ok()).collect();
        match items {
            Some(items) if !items.is_empty() && items.len() <= 32 => {
                self.stations[index].items = items;
            }
            _ => {
                let items = self.stations[index].items.iter();
                let items: String = items.map(|item| format!("{item:2}")).collect();
                out.extend(format!("2{}O{items}\r\n", index + 1).bytes());
            }
        }
    }

    fn choose_hemisphere(&mut self, index: usize, rest: &[&str], out: &mut Vec<u8>) {
        let axis: Vec<f64> = rest.iter().filter_map(|value| value.parse().ok()).collect();
        let station = &mut self.stations[index];
        match *axis.as_slice() {
            [x, y, z] => station.hemisphere = DVec3::new(x, y, z),
            _ => {
                let DVec3 { x, y, z } = station.hemisphere;
                out.extend(format!("2{}H{x:7.2}{y:7.2}{z:7.2}\r\n", index + 1).bytes());
            }
        }
    }

    /// 55 bytes (p. 69): flags, built-in test, IDs, software version, system identification.
    fn status(&self, out: &mut Vec<u8>) {
        let flags = 0x3f0
            | u16::from(self.binary)
            | u16::from(self.centimetres) << 1
            | u16::from(self.continuous) << 3;
        out.extend(
            format!(
                "21S{flags:03X}000  01  {:<6}{:<32}\r\n",
                "3.18", "simulated FASTRAK"
            )
            .bytes(),
        );
    }

    /// Number of stations that are on, at least one: they share 120 records a second.
    pub(crate) fn active(&self) -> usize {
        self.stations.iter().filter(|s| s.on).count().max(1)
    }

    /// Appends one record of every active station.
    pub(crate) fn records(&self, pose: RigidTransform, out: &mut Vec<u8>) {
        for (i, station) in self.stations.iter().enumerate().filter(|(_, s)| s.on) {
            let pose = in_hemisphere(receiver_pose(pose, i), station.hemisphere);
            out.extend([b'0', b'1' + i as u8, b' ']);
            for item in &station.items {
                self.item(*item, pose, out);
            }
        }
    }

    fn item(&self, item: u8, pose: RigidTransform, out: &mut Vec<u8>) {
        let extended = item >= 50;
        match item % 50 {
            0 => out.push(b' '),
            1 => out.extend(b"\r\n"),
            2 => {
                let units = if self.centimetres {
                    CENTIMETRES_PER_METRE
                } else {
                    INCHES_PER_METRE
                };
                self.numbers(&(pose.translation * units).to_array(), 2, extended, out);
            }
            4 => {
                let (a, e, r) = pose.rotation.to_euler(EulerRot::ZYX);
                let degrees = [a, e, r].map(f64::to_degrees);
                self.numbers(&degrees, 2, extended, out);
            }
            column @ 5..=7 => {
                let axis = DVec3::AXES[usize::from(column) - 5];
                self.numbers(&(pose.rotation * axis).to_array(), 4, extended, out);
            }
            11 => {
                let DQuat { x, y, z, w } = pose.rotation;
                self.numbers(&[w, x, y, z], 4, extended, out);
            }
            // The switch of the stylus: not pressed.
            16 => out.extend(b" 0"),
            _ => {}
        }
    }

    fn numbers(&self, values: &[f64], decimals: usize, extended: bool, out: &mut Vec<u8>) {
        for value in values {
            if self.binary {
                out.extend((*value as f32).to_le_bytes());
            } else if extended {
                out.extend(scientific(*value).bytes());
            } else {
                out.extend(format!("{value:7.decimals$}").bytes());
            }
        }
    }
}

/// `Sx.xxxxxESxx` and a blank.
fn scientific(value: f64) -> String {
    let text = format!("{value:.5e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    format!("{mantissa:>8}E{exponent:+03} ")
}
