//! What a Liberty or Patriot is told. Every command ends in a carriage return, and capital
//! letters mean other things than on a FASTRAK (`F1` is binary).

use super::Format;
use crate::dialogue::{Answer, Step};
use crate::settings::{TrackerSettings, Units};
use std::time::Duration;

/// Receivers of the largest Liberty. A smaller device answers an error for those that it
/// lacks, which is passed over.
const STATIONS: std::ops::RangeInclusive<u8> = 1..=16;

/// Stop (`P` asks for one record and ends the continuous mode), text, who are you,
/// receivers, items, units, hemisphere, binary, start.
pub(crate) fn greeting(settings: &TrackerSettings, format: &Format) -> Vec<Step> {
    vec![
        Step::Send(b"P\r".to_vec()),
        Step::Quiet,
        Step::Send(b"F0\r".to_vec()),
        Step::Quiet,
        Step::Ask {
            send: b"\x16\r".to_vec(),
            heard: who_it_is,
            within: Duration::from_millis(500),
            tries: 2,
            // Its answer's form differs between versions: the records decide.
            needed: false,
        },
        Step::Quiet,
        Step::Send(stations(settings)),
        Step::Pause(Duration::from_millis(50)),
        Step::Quiet,
        Step::Send(mode(settings, format)),
        Step::Pause(Duration::from_millis(50)),
        Step::Quiet,
        Step::Send(b"C\r".to_vec()),
        Step::Stream(Duration::from_millis(1500)),
    ]
}

/// `^U` (active station state): what is plugged in is on after power-up, and two receivers
/// at 240 records a second are more than a line of 115200 baud carries. The wanted ones are
/// switched on before the others go off, so that there is one at any time.
fn stations(settings: &TrackerSettings) -> Vec<u8> {
    let wanted = |station: &u8| settings.stations.contains(station);
    let on = STATIONS.filter(wanted).map(|station| (station, 1));
    let off = STATIONS.filter(|s| !wanted(s)).map(|station| (station, 0));
    let commands = on.chain(off);
    commands
        .flat_map(|(station, state)| format!("\x15{station},{state}\r").into_bytes())
        .collect()
}

/// Items, units, hemisphere and encoding of all stations.
fn mode(settings: &TrackerSettings, format: &Format) -> Vec<u8> {
    let orientation = if format.euler { 4 } else { 7 };
    let units = match settings.units {
        Units::Inches => 0,
        Units::Centimetres => 1,
    };
    let [x, y, z] = settings.hemisphere.axis();
    format!("O*,2,{orientation}\rU{units}\rH*,{x},{y},{z}\rF1\r").into_bytes()
}

/// The line of `^V` that names the maker or the model.
pub(crate) fn who_it_is(heard: &[u8]) -> Option<Answer> {
    let text = str::from_utf8(heard).ok()?;
    let complete = text.get(..text.rfind('\n')?)?;
    let names = ["polhemus", "liberty", "patriot"];
    complete
        .lines()
        .find(|line| {
            let line = line.to_ascii_lowercase();
            names.iter().any(|name| line.contains(name))
        })
        .map(|line| Answer {
            said: Some(line.trim().chars().take(80).collect()),
            warning: None,
        })
}
