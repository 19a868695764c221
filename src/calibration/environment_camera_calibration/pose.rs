//! The environment camera's pose from everything that it observed.

use super::assessment::assess;
use super::inputs::Inputs;
use super::observations::{ImageObservation, ObservationKind};
use super::optics::Optics;
use super::resection::{NoPose, Observation, Resection, Target, Unknowns, resect};
use super::view::View;
use crate::summary::Summary;
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_rig_model::Grade;

/// The pose and its observations.
pub(super) struct PoseResult {
    pub world_from_camera: RigidTransform,
    pub resection: Option<Resection>,
    pub image_observations: Vec<ImageObservation>,
    /// The source that determined it, as written into the calibration file.
    pub by: &'static str,
}

/// Computes the camera's pose; `None` if it is undetermined and `rig.json` has none.
pub(super) fn estimate_pose(
    inputs: &Inputs,
    optics: &Optics,
    summary: &mut Summary,
) -> Option<PoseResult> {
    let (image_observations, two_lights) = observations(inputs, optics, summary);
    let rough = inputs.rough_pose();
    let observations: Vec<Observation> = image_observations.iter().map(|m| m.observation).collect();
    let result = match unknowns(inputs, optics, &observations) {
        Some(unknowns) if !observations.is_empty() => resect(&observations, unknowns, rough),
        Some(_) => Err(NoPose::TooFew {
            known: 0,
            needed: 2,
        }),
        None => {
            summary.finding(Grade::Refused, "the position of the environment camera is unknown, and fewer than 4 known points were observed; give it with --at X,Y,Z (world, metres), or show the camera a marker");
            return None;
        }
    };
    match result {
        Ok(resection) => {
            assess(inputs, &resection, &image_observations, two_lights, summary);
            let by = image_observations
                .iter()
                .max_by_key(|m| priority(m.by))
                .map_or("", |m| m.by.name());
            Some(PoseResult {
                world_from_camera: resection.world_from_camera,
                resection: Some(resection),
                image_observations,
                by,
            })
        }
        Err(why) => fallback(inputs, optics, &why, image_observations, summary),
    }
}

/// Returns the rank by which one kind is named as the pose's source.
const fn priority(by: ObservationKind) -> u8 {
    match by {
        ObservationKind::Light => 0,
        ObservationKind::Click => 1,
        ObservationKind::Marker => 2,
    }
}

/// Returns all observations, and whether they are two lights alone.
fn observations(
    inputs: &Inputs,
    optics: &Optics,
    summary: &mut Summary,
) -> (Vec<ImageObservation>, bool) {
    let view = &optics.view;
    let (mut image_observations, tags) = inputs.marker_observations(view);
    let (clicks, lost) = inputs.click_observations(view);
    if lost > 0 {
        summary.finding(Grade::Usable, format!("{lost} clicks are ignored: they are outside of the picture, or the scene camera has no pose at their time"));
    }
    let names: Vec<String> = tags
        .iter()
        .map(|t| format!("{} {}", t.family, t.id))
        .collect();
    if !names.is_empty() {
        summary.line(format!(
            "markers in the environment camera's picture: {}",
            names.join(", ")
        ));
    }
    image_observations.extend(clicks);
    let points = image_observations
        .iter()
        .filter(|m| m.by == ObservationKind::Marker)
        .count();
    if points >= 8 {
        // Two markers determine the pose more reliably than lights.
        return (with_lens_sigma(image_observations, view, optics), false);
    }
    let own = inputs.environment_lights(view, optics.sphere());
    let world = inputs.world_lights();
    let mut two = false;
    match inputs.light_observations((view, optics.sphere()), &own, &world) {
        Ok((lights, found)) => {
            summary.line(format!(
                "{} bright lights of the environment camera, {} of the scene camera, {} matched",
                own.len(),
                world.len(),
                lights.len()
            ));
            two = image_observations.is_empty() && lights.len() == 2;
            match found.ambiguous {
                Some(angle) if image_observations.is_empty() => summary.finding(Grade::Refused, format!("the lights can be matched in two ways, {:.0}° apart; show both cameras a third light, or write an approximate pose of the environment camera into rig.json", angle.to_degrees())),
                // Markers and clicks suffice without ambiguous lights.
                Some(_) => return (with_lens_sigma(image_observations, view, optics), false),
                None => {}
            }
            image_observations.extend(lights);
        }
        Err(why) if image_observations.is_empty() => summary.hints.push(why.to_string()),
        Err(_) => {}
    }
    (with_lens_sigma(image_observations, view, optics), two)
}

/// Adds the uncertainty of the lens to every observation.
fn with_lens_sigma(
    mut image_observations: Vec<ImageObservation>,
    view: &View,
    optics: &Optics,
) -> Vec<ImageObservation> {
    let Some(circle) = &optics.circle else {
        return image_observations;
    };
    for m in &mut image_observations {
        let theta = m.observation.bearing.angle_between(DVec3::Z);
        let scale = theta * circle.radius_sigma / circle.radius;
        let shift = circle.centre_sigma.length() / view.focal();
        m.observation.sigma = m.observation.sigma.hypot(scale).hypot(shift);
    }
    image_observations
}

/// Returns the unknowns that the observations can determine; `None` if the position is unknown.
fn unknowns(inputs: &Inputs, optics: &Optics, observations: &[Observation]) -> Option<Unknowns> {
    let points = observations
        .iter()
        .filter(|s| matches!(s.target, Target::Point(_)))
        .count();
    let sphere = inputs
        .known
        .rig
        .mirror_sphere
        .as_ref()
        .map(|s| s.centre_in_world);
    if points >= 4 && inputs.options.position.is_none() {
        return Some(Unknowns::Pose);
    }
    match (optics.sphere(), sphere) {
        (Some((outline, radius)), Some(in_world)) => Some(Unknowns::OrientationAbout {
            in_camera: outline.centre(radius).0,
            in_world,
        }),
        _ => inputs.position().map(Unknowns::Orientation),
    }
}

/// Falls back to the pose in `rig.json`, if there is one, as the orientation is undetermined.
fn fallback(
    inputs: &Inputs,
    optics: &Optics,
    why: &NoPose,
    image_observations: Vec<ImageObservation>,
    summary: &mut Summary,
) -> Option<PoseResult> {
    summary.hints.push("show both cameras a marker of rig.json's `markers`, or two or more bright lights; or click on known things: --click-pairs FILE".to_owned());
    let Some(mut pose) = inputs.rough_pose() else {
        summary.finding(
            Grade::Refused,
            format!("the orientation of the environment camera is undetermined: {why}"),
        );
        return None;
    };
    if matches!(why, NoPose::Inconsistent { .. }) {
        summary.finding(Grade::Refused, why);
    } else {
        summary.finding(
            Grade::Usable,
            format!("the orientation of rig.json is kept: {why}"),
        );
    }
    let sphere = inputs.known.rig.mirror_sphere.as_ref();
    if let (Some((outline, _)), Some(sphere)) = (optics.sphere(), sphere) {
        // The position is easier to measure than the orientation; the outline corrects two angles.
        let to = (sphere.centre_in_world - pose.translation).normalize_or(DVec3::Z);
        let arc = DQuat::from_rotation_arc(pose.rotation * outline.axis, to);
        pose.rotation = (arc * pose.rotation).normalize();
    }
    Some(PoseResult {
        world_from_camera: pose,
        resection: None,
        image_observations,
        by: "rig.json",
    })
}
