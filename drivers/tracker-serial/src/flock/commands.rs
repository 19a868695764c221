//! What a Flock of Birds is told: bytes without line ends. It is put into point mode
//! before anything else, and what it was asked is read before it is asked again, or it
//! complains.

use super::Format;
use crate::dialogue::{Answer, Step};
use crate::settings::{Hemisphere, TrackerSettings};
use std::time::Duration;

/// One record.
pub(crate) const POINT: u8 = b'B';
/// Records without end.
pub(crate) const STREAM: u8 = b'@';
/// Prefix that passes the next command on to the bird with this address.
const TO_BIRD: u8 = 0xf0;

/// Point mode, version, group mode where wanted, hemisphere and items, stream.
pub(crate) fn greeting(settings: &TrackerSettings, format: &Format) -> Vec<Step> {
    let mut steps = vec![
        Step::Send(vec![POINT]),
        Step::Quiet,
        Step::Ask {
            send: vec![b'O', 1],
            heard: version,
            within: Duration::from_millis(500),
            tries: 2,
            needed: true,
        },
    ];
    if format.group {
        steps.extend(group(settings));
    }
    let birds: Vec<Option<u8>> = if format.group {
        settings.stations.iter().copied().map(Some).collect()
    } else {
        vec![None]
    };
    for bird in birds {
        steps.push(Step::Send(mode(bird, settings.hemisphere, format)));
    }
    steps.extend([
        Step::Pause(Duration::from_millis(50)),
        Step::Quiet,
        Step::Send(vec![STREAM]),
        Step::Stream(Duration::from_millis(1500)),
    ]);
    steps
}

/// Auto-configuration of as many birds as there are stations, then group mode. The manual
/// wants 600 ms around the former.
fn group(settings: &TrackerSettings) -> [Step; 4] {
    let birds = u8::try_from(settings.stations.len()).unwrap_or(u8::MAX);
    [
        Step::Pause(Duration::from_millis(600)),
        Step::Send(vec![b'P', 0x32, birds]),
        Step::Pause(Duration::from_millis(600)),
        Step::Send(vec![b'P', 0x23, 1]),
    ]
}

/// Hemisphere and items of one bird.
fn mode(bird: Option<u8>, hemisphere: Hemisphere, format: &Format) -> Vec<u8> {
    // The axis, then whether its negative half is meant; `Upper` is −Z here, too.
    let [axis, sign] = match hemisphere {
        Hemisphere::Forward => [0x00, 0x00],
        Hemisphere::Back => [0x00, 0x01],
        Hemisphere::Right => [0x06, 0x00],
        Hemisphere::Left => [0x06, 0x01],
        Hemisphere::Lower => [0x0c, 0x00],
        Hemisphere::Upper => [0x0c, 0x01],
    };
    let items = if format.angles { b'Y' } else { b']' };
    let to_bird = bird.map(|address| TO_BIRD | (address & 0x0f));
    let mut bytes: Vec<u8> = to_bird.into_iter().collect();
    bytes.extend([b'L', axis, sign]);
    bytes.extend(to_bird);
    bytes.push(items);
    bytes
}

/// Examining parameter 1 gives the software's version, two bytes.
fn version(heard: &[u8]) -> Option<Answer> {
    match heard {
        [major, minor] => Some(Answer {
            said: Some(format!("Flock of Birds, software {major}.{minor}")),
            warning: None,
        }),
        _ => None,
    }
}
