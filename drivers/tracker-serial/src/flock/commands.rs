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
/// Highest address that the prefix can name.
const MOST_BIRDS: u8 = 14;

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
        let birds = birds(settings);
        steps.extend(group(birds));
        // Each of them sends records from now on, wanted or not, and one that sent other
        // items would spoil its neighbours' as well.
        let modes = (1..=birds).map(|bird| mode(Some(bird), settings.hemisphere, format));
        steps.extend(modes.map(Step::Send));
    } else {
        steps.push(Step::Send(mode(None, settings.hemisphere, format)));
    }
    steps.extend([
        Step::Pause(Duration::from_millis(50)),
        Step::Quiet,
        Step::Send(vec![STREAM]),
        Step::Stream(Duration::from_millis(1500)),
    ]);
    steps
}

/// Birds on the bus that take part: addresses count from 1 without gaps, so those below a
/// wanted one are among them.
fn birds(settings: &TrackerSettings) -> u8 {
    let last = settings.stations.iter().copied().max();
    last.unwrap_or(1).clamp(1, MOST_BIRDS)
}

/// Auto-configuration of so many birds, then group mode. The manual wants 600 ms around the
/// former.
fn group(birds: u8) -> [Step; 4] {
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
