//! What a Liberty or Patriot is told. Every command ends in a carriage return, and capital
//! letters mean other things than on a FASTRAK (`F1` is binary).

use super::Format;
use crate::dialogue::{Answer, Step};
use crate::settings::{TrackerSettings, Units};
use std::time::Duration;

/// Stop (`P` asks for one record and ends the continuous mode), text, who are you, items,
/// units, hemisphere, binary, start.
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
        Step::Send(mode(settings, format)),
        Step::Pause(Duration::from_millis(50)),
        Step::Quiet,
        Step::Send(b"C\r".to_vec()),
        Step::Stream(Duration::from_millis(1500)),
    ]
}

/// Items, units, hemisphere and encoding. All stations: which are on is the device's.
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
