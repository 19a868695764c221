//! The commands of a FASTRAK. They are case sensitive; single letters take no carriage return,
//! the others do.

use super::record::{Encoding, Ending, Format, Orientation};
use super::status::Status;
use crate::settings::{TrackerSettings, Units};
use crate::step::{Answer, Step};
use std::time::Duration;

/// Receivers of one system electronics unit.
const STATIONS: std::ops::RangeInclusive<u8> = 1..=4;

/// Stops the stream, queries the status, sets the mode, checks it by the status, and starts.
pub(crate) fn start_sequence(settings: &TrackerSettings, format: &Format) -> Vec<Step> {
    let binary = format.encoding == Encoding::Binary;
    let centimetres = settings.units == Units::Centimetres;
    let confirm_mode = match (binary, centimetres) {
        (false, false) => |received: &[u8]| confirm(received, false, false),
        (false, true) => |received: &[u8]| confirm(received, false, true),
        (true, false) => |received: &[u8]| confirm(received, true, false),
        (true, true) => |received: &[u8]| confirm(received, true, true),
    };
    vec![
        Step::Send(b"c".to_vec()),
        Step::AwaitSilence,
        ask(|received| Status::find(received).map(|status| describe(&status))),
        Step::Send(mode(settings, format)),
        Step::Pause(Duration::from_millis(50)),
        Step::AwaitSilence,
        ask(confirm_mode),
        Step::Send(b"C".to_vec()),
        Step::AwaitRecords(Duration::from_millis(1500)),
    ]
}

/// Asks for the status.
fn ask(parse: fn(&[u8]) -> Option<Answer>) -> Step {
    Step::Ask {
        question: b"S".to_vec(),
        parse,
        timeout: Duration::from_millis(500),
        tries: 3,
        required: true,
    }
}

/// Sets units, encoding, receivers, items and hemisphere.
fn mode(settings: &TrackerSettings, format: &Format) -> Vec<u8> {
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

/// The items of the `O` command (p. 57) for the records of a format.
fn items(format: &Format) -> String {
    let extended = match format.encoding {
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
    format!("{},{},{ending}", 2 + extended, orientation + extended)
}

/// The description of a device by its status.
pub(crate) fn describe(status: &Status) -> Answer {
    let clean = status.self_test.iter().all(|digit| b"0 ".contains(digit));
    let digits = String::from_utf8_lossy(&status.self_test);
    Answer {
        description: Some(format!(
            "FASTRAK, software {}, {}",
            status.version, status.system
        )),
        warning: (!clean)
            .then(|| format!("its built-in test found {digits}; see the manual's BIT table")),
        ..Answer::default()
    }
}

/// A warning if the device is not in the mode that it was set to.
fn confirm(received: &[u8], binary: bool, centimetres: bool) -> Option<Answer> {
    let status = Status::find(received)?;
    let mut answer = describe(&status);
    if (status.binary, status.centimetres) != (binary, centimetres) {
        let mode = |binary, centimetres| {
            let encoding = if binary { "binary" } else { "text" };
            let units = if centimetres { "centimetres" } else { "inches" };
            format!("{encoding} in {units}")
        };
        answer.warning = Some(format!(
            "was set to send {} but reports that it sends {}",
            mode(binary, centimetres),
            mode(status.binary, status.centimetres)
        ));
    }
    Some(answer)
}
