//! The commands of a Liberty or Patriot. Every command ends with a carriage return. Letters
//! have other meanings than on a FASTRAK: `F1` is binary.

use super::record::Format;
use crate::settings::{TrackerSettings, Units};
use crate::step::{Answer, Step};
use std::time::Duration;

/// Receivers of the largest Liberty. A smaller device answers with an error for those that it
/// lacks; the answer is discarded.
const STATIONS: std::ops::RangeInclusive<u8> = 1..=16;

/// Stop (`P` asks for one record and ends continuous mode), text mode, identity, which receivers
/// there are, the receivers to use, items, units, hemisphere, binary mode, start.
pub(crate) fn start_sequence(settings: &TrackerSettings, format: &Format) -> Vec<Step> {
    vec![
        Step::Send(b"P\r".to_vec()),
        Step::AwaitSilence,
        Step::Send(b"F0\r".to_vec()),
        Step::AwaitSilence,
        Step::Ask {
            question: b"\x16\r".to_vec(),
            parse: identity,
            timeout: Duration::from_millis(500),
            tries: 2,
            // The form of the answer differs between versions: the records decide.
            required: false,
        },
        Step::AwaitSilence,
        Step::Ask {
            question: b"\x150\r".to_vec(),
            parse: receivers,
            timeout: Duration::from_millis(300),
            tries: 1,
            required: false,
        },
        Step::AwaitSilence,
        Step::Send(stations(settings)),
        Step::Pause(Duration::from_millis(50)),
        Step::AwaitSilence,
        Step::Send(mode(settings, format)),
        Step::Pause(Duration::from_millis(50)),
        Step::AwaitSilence,
        Step::Send(b"C\r".to_vec()),
        Step::AwaitRecords(Duration::from_millis(1500)),
    ]
}

/// `^U` (active station state) for every receiver. All that are plugged in are on after
/// power-up, and two of them at 240 records a second exceed a line of 115200 baud. The
/// configured ones are switched on before the others are switched off, so that at least one is
/// on at any time.
fn stations(settings: &TrackerSettings) -> Vec<u8> {
    let configured = |station: &u8| settings.stations.contains(station);
    let on = STATIONS.filter(configured).map(|station| (station, 1));
    let off = STATIONS
        .filter(|s| !configured(s))
        .map(|station| (station, 0));
    let commands = on.chain(off);
    commands
        .flat_map(|(station, state)| format!("\x15{station},{state}\r").into_bytes())
        .collect()
}

/// Sets items, units, hemisphere and encoding of all stations.
fn mode(settings: &TrackerSettings, format: &Format) -> Vec<u8> {
    let orientation = if format.euler { 4 } else { 7 };
    let units = match settings.units {
        Units::Inches => 0,
        Units::Centimetres => 1,
    };
    let [x, y, z] = settings.hemisphere.axis();
    format!("O*,2,{orientation}\rU{units}\rH*,{x},{y},{z}\rF1\r").into_bytes()
}

/// The line in the answer to `^V` that names the manufacturer or the model.
pub(crate) fn identity(received: &[u8]) -> Option<Answer> {
    let text = str::from_utf8(received).ok()?;
    let complete = text.get(..text.rfind('\n')?)?;
    let names = ["polhemus", "liberty", "patriot"];
    complete
        .lines()
        .find(|line| {
            let line = line.to_ascii_lowercase();
            names.iter().any(|name| line.contains(name))
        })
        .map(|line| Answer {
            description: Some(line.trim().chars().take(80).collect()),
            ..Answer::default()
        })
}

/// The receivers in the answer to `^U0`: a line that ends in eight hexadecimal digits, those that are
/// plugged in and those that are on, receiver 1 in the lowest bit.
fn receivers(received: &[u8]) -> Option<Answer> {
    let text = str::from_utf8(received).ok()?;
    let complete = text.get(..text.rfind('\n')?)?;
    let bits = complete.lines().rev().find_map(|line| {
        let line = line.trim();
        let digits = line.get(line.len().checked_sub(8)?..)?;
        let is_hex = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
        u16::from_str_radix(digits.get(..4).filter(|_| is_hex)?, 16).ok()
    })?;
    let is_there = |station: &u8| bits >> (station - 1) & 1 == 1;
    Some(Answer {
        receivers: STATIONS.filter(is_there).collect(),
        ..Answer::default()
    })
}
