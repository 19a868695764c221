//! A device with arbitrary answers.

use penumbra_interface::MonotonicTime;
use penumbra_tracker_serial::dialogue::{Action, Dialogue, Trouble};
use penumbra_tracker_serial::{PROTOCOLS, PortName, TrackerSettings};

/// Has a device answer with `data`: every dialogue ends, and gives the reason in one line.
pub fn dialogue(data: &[u8]) {
    let Some((seed, mut answers)) = data.split_first() else {
        return;
    };
    let protocol = PROTOCOLS[usize::from(*seed) % PROTOCOLS.len()];
    let settings = TrackerSettings::new(protocol, PortName::Serial("/dev/none".to_owned()));
    let Some(mut dialogue) = Dialogue::new(&settings) else {
        panic!("{protocol} is no protocol");
    };
    let mut now = MonotonicTime::from_nanos(0);
    for _ in 0..100_000 {
        match dialogue.next(now) {
            Action::Write(_) => {}
            Action::Read { until, .. } => {
                let (heard, later) = answers.split_at(answers.len().min(24));
                answers = later;
                now = if heard.is_empty() {
                    until
                } else {
                    now.offset_nanos(5_000_000)
                };
                if !heard.is_empty() {
                    dialogue.receive(heard, now);
                }
            }
            Action::Failed(Trouble::Foreign { seen }) => {
                assert!(!seen.contains('\n'), "{seen}");
                return;
            }
            Action::Done(_) | Action::Failed(Trouble::Silent { .. }) => return,
        }
    }
    panic!("{protocol}: the dialogue does not end");
}
