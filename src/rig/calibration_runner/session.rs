//! Runs a calibration step on a recorded session.

use super::step_feeder::StepFeeder;
use crate::damage::intact_events;
use penumbra_calibration::step::{Progress, Step};
use penumbra_config::Config;
use penumbra_session::Session;

/// Passes all events of `session` that `step` needs to it, in the order of arrival. Calls `report`
/// after each picture with the share of the session (0 to 1) and the step's progress. Returns how
/// many pictures could not be read, and warns of damaged parts of the file. `metres_per_unit` is the tracker's
/// unit of length; `None` if the calibration does not state it.
pub fn feed_session(
    session: &Session,
    config: &Config,
    metres_per_unit: Option<f64>,
    step: &mut dyn Step,
    mut report: impl FnMut(f64, &Progress),
) -> usize {
    let Some((start, end)) = session.span() else {
        return 0;
    };
    let length = end.seconds_since(start).max(1e-9);
    let mut feeder = StepFeeder::new(start, metres_per_unit);
    for event in intact_events(session) {
        let share = event.arrived_at().seconds_since(start) / length;
        if feeder.feed(event, config, step).is_some() {
            report(share.clamp(0.0, 1.0), &step.progress());
        }
    }
    feeder.damaged
}
