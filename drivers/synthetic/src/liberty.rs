//! A simulated Liberty or Patriot.

use crate::receivers::{in_hemisphere, receiver_pose};
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;

/// Longest command line, bytes; the rest is ignored.
const LINE_LIMIT: usize = 300;

/// Number of plugged-in receivers: the maximum of a Patriot.
const RECEIVERS: usize = 2;

/// The state of the device.
#[derive(Clone, Debug)]
pub(crate) struct Liberty {
    binary: bool,
    centimetres: bool,
    continuous: bool,
    items: Vec<u8>,
    hemisphere: DVec3,
    /// Which receivers are on; after power-up, all that are plugged in.
    on: [bool; RECEIVERS],
    line: Vec<u8>,
    patriot: bool,
    records_sent: u32,
}

impl Liberty {
    pub(crate) fn new(patriot: bool) -> Self {
        Self {
            binary: false,
            centimetres: false,
            continuous: false,
            items: vec![2, 4, 1],
            hemisphere: DVec3::X,
            on: [true; RECEIVERS],
            line: Vec::new(),
            patriot,
            records_sent: 0,
        }
    }

    /// Sets the mode of a protocol name.
    pub(crate) fn configure_for(&mut self, protocol: &str) {
        self.binary = true;
        self.items = vec![2, if protocol.ends_with("euler") { 4 } else { 7 }];
    }

    pub(crate) fn is_streaming(&self) -> bool {
        self.continuous
    }

    /// Executes commands, each ended by a carriage return, and appends the answers.
    pub(crate) fn receive(&mut self, bytes: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        for &byte in bytes {
            if byte == b'\r' {
                let line = std::mem::take(&mut self.line);
                self.execute(&line, pose, out);
            } else if self.line.len() < LINE_LIMIT {
                self.line.push(byte);
            }
        }
    }

    fn execute(&mut self, line: &[u8], pose: RigidTransform, out: &mut Vec<u8>) {
        match line {
            b"P" => {
                self.continuous = false;
                self.records(b'P', pose, out);
            }
            b"C" => self.continuous = true,
            b"F0" => self.binary = false,
            b"F1" => self.binary = true,
            b"U0" => self.centimetres = false,
            b"U1" => self.centimetres = true,
            [0x16] => self.identify(out),
            [0x15, state @ ..] => self.switch(state, out),
            [b'O', b'*' | b'1', b',', items @ ..] => {
                self.items = numbers(items).map(|value: f64| value as u8).collect();
            }
            [b'H', b'*' | b'1', b',', axis @ ..] => {
                let axis: Vec<f64> = numbers(axis).collect();
                if let [x, y, z] = *axis.as_slice() {
                    self.hemisphere = DVec3::new(x, y, z);
                }
            }
            _ => {}
        }
    }

    fn identify(&self, out: &mut Vec<u8>) {
        let name = if self.patriot { "Patriot" } else { "Liberty" };
        let text = format!("Polhemus Inc., simulated {name}, version 1.07\r\n");
        self.answer(0x16, &text, out);
    }

    /// `^U`: switches a receiver on or off; with receiver 0, answers which are plugged in and
    /// which are on.
    fn switch(&mut self, state: &[u8], out: &mut Vec<u8>) {
        let state: Vec<f64> = numbers(state).collect();
        match *state.as_slice() {
            [0.0] => {
                let bits = |on: [bool; RECEIVERS]| u16::from(on[0]) | u16::from(on[1]) << 1;
                let text = format!("{:04X}{:04X}\r\n", bits([true; RECEIVERS]), bits(self.on));
                self.answer(0x15, &text, out);
            }
            [station, state] => match self.on.get_mut((station as usize).wrapping_sub(1)) {
                Some(on) => *on = state != 0.0,
                None => self.answer(0x15, "*ERROR* no such station\r\n", out),
            },
            _ => self.answer(0x15, "*ERROR* wrong parameters\r\n", out),
        }
    }

    fn answer(&self, command: u8, text: &str, out: &mut Vec<u8>) {
        if self.binary {
            self.header((1, command), text.len(), out);
        }
        out.extend(text.bytes());
    }

    fn header(&self, (station, command): (u8, u8), body: usize, out: &mut Vec<u8>) {
        out.extend(if self.patriot { b"PA" } else { b"LY" });
        out.extend([station, command, b' ', 0]);
        out.extend((body as u16).to_le_bytes());
    }

    pub(crate) fn stream(&mut self, pose: RigidTransform, out: &mut Vec<u8>) {
        self.records(b'C', pose, out);
    }

    /// Appends one record of every receiver that is on.
    fn records(&mut self, command: u8, pose: RigidTransform, out: &mut Vec<u8>) {
        for (i, on) in self.on.into_iter().enumerate() {
            if on {
                self.record((i as u8 + 1, command), receiver_pose(pose, i), out);
            }
        }
    }

    /// Appends one record; in text mode a line of station, error and numbers.
    fn record(&mut self, (station, command): (u8, u8), pose: RigidTransform, out: &mut Vec<u8>) {
        self.records_sent += 1;
        let pose = in_hemisphere(pose, self.hemisphere);
        let mut body = Vec::new();
        if !self.binary {
            body.extend(format!("{station:02}  ").bytes());
        }
        for item in self.items.clone() {
            self.item(item, pose, &mut body);
        }
        if self.binary {
            self.header((station, command), body.len(), out);
        }
        out.extend(body);
    }

    fn item(&self, item: u8, pose: RigidTransform, body: &mut Vec<u8>) {
        let units = if self.centimetres {
            100.0
        } else {
            1.0 / 0.0254
        };
        let values: Vec<f64> = match item {
            0 => return body.push(b' '),
            1 => return body.extend(b"\r\n"),
            2 => (pose.translation * units).to_array().to_vec(),
            4 => {
                let (a, e, r) = pose.rotation.to_euler(EulerRot::ZYX);
                [a, e, r].map(f64::to_degrees).to_vec()
            }
            7 => {
                let DQuat { x, y, z, w } = pose.rotation;
                vec![w, x, y, z]
            }
            8 => return body.extend(self.records_sent.to_le_bytes()),
            _ => return,
        };
        for value in values {
            if self.binary {
                body.extend((value as f32).to_le_bytes());
            } else {
                body.extend(format!("{value:9.4}").bytes());
            }
        }
    }
}

fn numbers(text: &[u8]) -> impl Iterator<Item = f64> {
    text.split(|byte| *byte == b',')
        .filter_map(|field| str::from_utf8(field).ok()?.trim().parse().ok())
}
