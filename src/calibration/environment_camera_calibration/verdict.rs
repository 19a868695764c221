//! How good a pose is.

use super::resection::Placed;
use super::solve::Said;
use super::step::EnvironmentStep;
use crate::environment_camera_calibration::observations::{By, Marked};
use penumbra_rig_model::Grade;

/// Standard deviation of the orientation up to which it is good, and up to which it can be used,
/// degrees.
const TURN: (f64, f64) = (0.3, 1.5);

/// Says what a pose is worth; `two` where two lights alone give it.
pub(super) fn judge(
    step: &EnvironmentStep,
    placed: &Placed,
    marked: &[Marked],
    two: bool,
    said: &mut Said,
) {
    let degrees = placed.turn_sigma.max_element().to_degrees();
    let count = |by: By| {
        marked
            .iter()
            .zip(&placed.kept)
            .filter(|(m, k)| m.by == by && **k)
            .count()
    };
    let place = match placed.place_sigma.max_element() {
        0.0 => String::new(),
        sigma => format!("; place ± {:.1} mm", 1000.0 * sigma),
    };
    said.line(format!(
        "orientation ± {degrees:.2}°{place}, by {} corners of markers, {} clicks, {} lights; residual {:.3}° RMS",
        count(By::Marker),
        count(By::Click),
        count(By::Light),
        placed.rms.to_degrees()
    ));
    if let Some(rough) = step.rough_pose() {
        let turn = rough
            .rotation
            .angle_between(placed.world_from_camera.rotation);
        let moved = rough
            .translation
            .distance(placed.world_from_camera.translation);
        said.line(format!(
            "turned by {:.2}° and moved by {:.1} mm from what was known",
            turn.to_degrees(),
            1000.0 * moved
        ));
    }
    let out = placed.kept.iter().filter(|k| !**k).count();
    if out > 0 {
        let grade = if 5 * out > placed.kept.len() {
            Grade::Usable
        } else {
            Grade::Good
        };
        said.against(
            grade,
            format!(
                "{out} of {} known points and lights contradict the others and were left out",
                placed.kept.len()
            ),
        );
    }
    match degrees {
        d if d > TURN.1 => said.against(Grade::Refused, format!("the orientation is open by {d:.1}°: add points or lights farther from one another")),
        d if d > TURN.0 => said.against(Grade::Usable, format!("the orientation is known to {d:.1}° only: add points or lights farther from one another")),
        _ => {}
    }
    if let Some(turn) = placed.ambiguous {
        said.against(Grade::Refused, format!("another pose, {:.0}° away, suits as well: add a known point or light on another side, or a rough pose to rig.json", turn.to_degrees()));
    }
    if two {
        said.against(
            Grade::Usable,
            "two lights alone: nothing would contradict a wrong one; let a third be seen",
        );
    }
}
