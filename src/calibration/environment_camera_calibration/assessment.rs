//! Grades a pose.

use super::inputs::Inputs;
use super::observations::{ImageObservation, ObservationKind};
use super::resection::Resection;
use crate::summary::Summary;
use penumbra_rig_model::Grade;

/// Maximum standard deviations of a good and of a usable orientation, degrees.
const MAX_SIGMA: (f64, f64) = (0.3, 1.5);

/// Adds lines and findings about a pose; `two_lights` if it is based on two lights alone.
pub(super) fn assess(
    inputs: &Inputs,
    resection: &Resection,
    image_observations: &[ImageObservation],
    two_lights: bool,
    summary: &mut Summary,
) {
    describe(inputs, resection, image_observations, summary);
    let degrees = resection.rotation_sigma.max_element().to_degrees();
    let rejected = resection.kept.iter().filter(|k| !**k).count();
    if rejected > 0 {
        let grade = if 5 * rejected > resection.kept.len() {
            Grade::Usable
        } else {
            Grade::Good
        };
        summary.finding(
            grade,
            format!(
                "{rejected} of {} known points and lights were rejected as outliers",
                resection.kept.len()
            ),
        );
    }
    match degrees {
        d if d > MAX_SIGMA.1 => summary.finding(Grade::Refused, format!("the orientation is known to {d:.1}° only; add points or lights farther from one another")),
        d if d > MAX_SIGMA.0 => summary.finding(Grade::Usable, format!("the orientation is known to {d:.1}° only; add points or lights farther from one another")),
        _ => {}
    }
    if let Some(angle) = resection.ambiguous {
        summary.finding(Grade::Refused, format!("another pose, {:.0}° away, fits as well; add a known point or light on another side, or an approximate pose to rig.json", angle.to_degrees()));
    }
    if two_lights {
        summary.finding(
            Grade::Usable,
            "the pose is based on two lights, so that a wrong match would go unnoticed; show both cameras a third light",
        );
    }
}

/// Adds lines with the uncertainty, the kinds of observations and the change from `rig.json`.
fn describe(
    inputs: &Inputs,
    resection: &Resection,
    image_observations: &[ImageObservation],
    summary: &mut Summary,
) {
    let degrees = resection.rotation_sigma.max_element().to_degrees();
    let count = |by: ObservationKind| {
        image_observations
            .iter()
            .zip(&resection.kept)
            .filter(|(m, k)| m.by == by && **k)
            .count()
    };
    let position = match resection.position_sigma.max_element() {
        0.0 => String::new(),
        sigma => format!("; position ± {:.1} mm", 1000.0 * sigma),
    };
    summary.line(format!(
        "orientation ± {degrees:.2}°{position}, from {} marker corners, {} clicks, {} lights; residual {:.3}° RMS",
        count(ObservationKind::Marker),
        count(ObservationKind::Click),
        count(ObservationKind::Light),
        resection.rms.to_degrees()
    ));
    if let Some(rough) = inputs.rough_pose() {
        let angle = rough
            .rotation
            .angle_between(resection.world_from_camera.rotation);
        let distance = rough
            .translation
            .distance(resection.world_from_camera.translation);
        summary.line(format!(
            "rotated by {:.2}° and moved by {:.1} mm from the pose in rig.json",
            angle.to_degrees(),
            1000.0 * distance
        ));
    }
}
