//! The commands of a Flock of Birds: bytes without line endings. It must be in point mode
//! before any other command, and an answer must be read before the next question, or it
//! reports an error.

use super::record::Format;
use crate::settings::{Hemisphere, TrackerSettings};
use crate::step::{Answer, Step};
use std::time::Duration;

/// Point mode: send one record.
pub(crate) const POINT: u8 = b'B';
/// Stream mode: send records continuously.
pub(crate) const STREAM: u8 = b'@';
/// Prefix that passes the next command on to the bird with the address in its low bits
/// (RS232-to-FBB).
const TO_BIRD: u8 = 0xf0;
/// Highest address that fits into the prefix.
const MAX_ADDRESS: u8 = 14;

/// Point mode, version, group mode if configured, hemisphere and items, stream mode.
pub(crate) fn start_sequence(settings: &TrackerSettings, format: &Format) -> Vec<Step> {
    let mut steps = vec![
        Step::Send(vec![POINT]),
        Step::AwaitSilence,
        Step::Ask {
            question: vec![b'O', 1],
            parse: version,
            timeout: Duration::from_millis(500),
            tries: 2,
            required: true,
        },
    ];
    if format.group {
        let birds = birds(settings);
        steps.extend(group(birds));
        // All of them send from now on, and records of another length would make those of
        // their neighbours unreadable.
        let modes = (1..=birds).map(|bird| mode(Some(bird), settings.hemisphere, format));
        steps.extend(modes.map(Step::Send));
    } else {
        steps.push(Step::Send(mode(None, settings.hemisphere, format)));
    }
    steps.extend([
        Step::Pause(Duration::from_millis(50)),
        Step::AwaitSilence,
        Step::Send(vec![STREAM]),
        Step::AwaitRecords(Duration::from_millis(1500)),
    ]);
    steps
}

/// Number of birds in the group. Addresses count from 1 without gaps, so all up to the highest
/// station take part.
fn birds(settings: &TrackerSettings) -> u8 {
    let last = settings.stations.iter().copied().max();
    last.unwrap_or(1).clamp(1, MAX_ADDRESS)
}

/// Auto-configuration of this many birds, then group mode. The manual asks for 600 ms before
/// and after the former.
fn group(birds: u8) -> [Step; 4] {
    [
        Step::Pause(Duration::from_millis(600)),
        Step::Send(vec![b'P', 0x32, birds]),
        Step::Pause(Duration::from_millis(600)),
        Step::Send(vec![b'P', 0x23, 1]),
    ]
}

/// Sets hemisphere and items of one bird; `None`: of the only one.
fn mode(bird: Option<u8>, hemisphere: Hemisphere, format: &Format) -> Vec<u8> {
    // The axis, then 1 for its negative half. `Upper` is −Z here, too.
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

/// The answer to examining parameter 1: the software version, two bytes.
fn version(received: &[u8]) -> Option<Answer> {
    match received {
        [major, minor] => Some(Answer {
            description: Some(format!("Flock of Birds, software {major}.{minor}")),
            ..Answer::default()
        }),
        _ => None,
    }
}
