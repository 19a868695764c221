//! Shows a step of calibration what a session holds.

use super::showing::Showing;
use crate::error::RigError;
use penumbra_calibration::step::{Progress, Step};
use penumbra_config::Config;
use penumbra_session::Session;

/// Shows `step` everything in `session` that it wants, in the order of arrival, and `told` how
/// far it is after each picture (share of the session, progress); returns how many pictures and
/// stretches of the file could not be read. `metres_per_unit` is the tracker's, where the
/// calibration says it.
///
/// # Errors
/// None but for a session that cannot be read at all.
pub fn show_session(
    session: &Session,
    config: &Config,
    metres_per_unit: Option<f64>,
    step: &mut dyn Step,
    mut told: impl FnMut(f64, &Progress),
) -> Result<usize, RigError> {
    let Some((start, end)) = session.span() else {
        return Ok(0);
    };
    let length = end.seconds_since(start).max(1e-9);
    let mut showing = Showing::new(start, metres_per_unit);
    for event in session.events() {
        let Ok(event) = event else {
            showing.damaged += 1;
            continue;
        };
        let share = event.arrived_at().seconds_since(start) / length;
        if showing.show(event, config, step).is_some() {
            told(share.clamp(0.0, 1.0), &step.progress());
        }
    }
    Ok(showing.damaged)
}
