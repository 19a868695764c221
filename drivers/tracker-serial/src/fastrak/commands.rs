//! What a FASTRAK is told. Commands are case sensitive; single letters take no carriage
//! return, the others do.

use super::{Encoding, Ending, Format, Orientation, Status};
use crate::dialogue::{Answer, Step};
use crate::settings::{TrackerSettings, Units};
use std::time::Duration;

/// Receivers of one system electronics unit.
const STATIONS: std::ops::RangeInclusive<u8> = 1..=4;

/// Stop, ask, set the mode, ask again whether it is set, start.
pub(crate) fn greeting(settings: &TrackerSettings, format: &Format) -> Vec<Step> {
    let binary = format.encoding == Encoding::Binary;
    let centimetres = settings.units == Units::Centimetres;
    let confirmed = match (binary, centimetres) {
        (false, false) => |heard: &[u8]| confirm(heard, false, false),
        (false, true) => |heard: &[u8]| confirm(heard, false, true),
        (true, false) => |heard: &[u8]| confirm(heard, true, false),
        (true, true) => |heard: &[u8]| confirm(heard, true, true),
    };
    vec![
        Step::Send(b"c".to_vec()),
        Step::Quiet,
        ask(|heard| Status::find(heard).map(|status| introduce(&status))),
        Step::Send(mode(settings, format)),
        Step::Pause(Duration::from_millis(50)),
        Step::Quiet,
        ask(confirmed),
        Step::Send(b"C".to_vec()),
        Step::Stream(Duration::from_millis(1500)),
    ]
}

fn ask(heard: fn(&[u8]) -> Option<Answer>) -> Step {
    Step::Ask {
        send: b"S".to_vec(),
        heard,
        within: Duration::from_millis(500),
        tries: 3,
        needed: true,
    }
}

/// Units, encoding, receivers, items and hemisphere.
pub(crate) fn mode(settings: &TrackerSettings, format: &Format) -> Vec<u8> {
    let mut commands = Vec::new();
    commands.push(match settings.units {
        Units::Inches => b'U',
        Units::Centimetres => b'u',
    });
    commands.push(match format.encoding {
        Encoding::Binary => b'f',
        Encoding::Ascii | Encoding::AsciiExtended => b'F',
    });
    let [x, y, z] = settings.hemisphere.axis();
    for station in STATIONS {
        let on = settings.stations.contains(&station);
        commands.extend(format!("l{station},{}\r", u8::from(on)).bytes());
        if on {
            commands.extend(format!("O{station},{}\r", items(format)).bytes());
            commands.extend(format!("H{station},{x},{y},{z}\r").bytes());
        }
    }
    commands
}

/// The items of the `O` command (p. 57) that make up the format's record.
pub(crate) fn items(format: &Format) -> String {
    let more = match format.encoding {
        Encoding::AsciiExtended => 50,
        Encoding::Ascii | Encoding::Binary => 0,
    };
    let orientation = match format.orientation {
        Orientation::Euler => 4,
        Orientation::Quaternion => 11,
    };
    let ending = match format.ending {
        Ending::Space => 0,
        Ending::CrLf => 1,
    };
    format!("{},{},{ending}", 2 + more, orientation + more)
}

/// What a status record says of the device.
pub(crate) fn introduce(status: &Status) -> Answer {
    let clean = status.self_test.iter().all(|digit| b"0 ".contains(digit));
    let digits = String::from_utf8_lossy(&status.self_test);
    Answer {
        said: Some(format!(
            "FASTRAK, software {}, {}",
            status.version, status.system
        )),
        warning: (!clean)
            .then(|| format!("its built-in test found {digits}; see the manual's BIT table")),
    }
}

/// Whether it is in the mode that it was told.
fn confirm(heard: &[u8], binary: bool, centimetres: bool) -> Option<Answer> {
    let status = Status::find(heard)?;
    let mut answer = introduce(&status);
    if (status.binary, status.centimetres) != (binary, centimetres) {
        let spell = |binary, centimetres| {
            let encoding = if binary { "binary" } else { "text" };
            let units = if centimetres { "centimetres" } else { "inches" };
            format!("{encoding} in {units}")
        };
        answer.warning = Some(format!(
            "was told to send {} but says that it sends {}",
            spell(binary, centimetres),
            spell(status.binary, status.centimetres)
        ));
    }
    Some(answer)
}
