//! Computes the calibration from everything gathered, with its report.

use super::super::step::{CalibrationProvenance, Finished};
use super::inputs::{EnvironmentCameraKind, Inputs};
use super::optics::{Optics, optics};
use super::pose::{PoseResult, estimate_pose};
use super::report::{ReportContents, report};
use crate::summary::Summary;
use glam::DVec3;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::environment_file::{EnvironmentRecord, PoseRecord, STEP, SphereRecord};

/// Computes lens and pose, grades them and writes file and report.
pub(super) fn finish(inputs: &Inputs, made: &CalibrationProvenance) -> Finished {
    let mut summary = Summary::default();
    if inputs.gathered.mean.count == 0 {
        summary.finding(Grade::Refused, "there is no picture of the environment camera; record with both cameras, or import the session with its env/ folder");
    }
    if inputs.gathered.other_size > 0 {
        summary.finding(
            Grade::Usable,
            format!(
                "{} pictures of the environment camera were ignored for their differing size",
                inputs.gathered.other_size
            ),
        );
    }
    let optics = optics(inputs, &mut summary);
    let pose = optics
        .as_ref()
        .and_then(|o| estimate_pose(inputs, o, &mut summary));
    let mut found = summary.finished();
    if let (Some(optics), Some(pose)) = (&optics, &pose) {
        let header = found.header(STEP, made);
        let record = record(inputs, header, optics, pose);
        found.file = serde_json::to_string_pretty(&record)
            .ok()
            .filter(|_| found.grade != Grade::Refused);
    }
    let contents = ReportContents {
        picture: (inputs.gathered.mean.count > 0).then(|| inputs.gathered.mean.picture()),
        optics: optics.as_ref(),
        pose: pose.as_ref(),
    };
    found.report = report(&found, made, &contents);
    found
}

fn record(
    inputs: &Inputs,
    header: Header,
    optics: &Optics,
    pose: &PoseResult,
) -> EnvironmentRecord {
    let size = inputs.gathered.mean.size;
    let sphere = optics.sphere().map(|(outline, radius)| {
        let (centre, sigma) = outline.centre(radius);
        let known = inputs
            .known
            .rig
            .mirror_sphere
            .as_ref()
            .map(|s| s.centre_in_world);
        let seen = pose.world_from_camera.transform_point(centre);
        SphereRecord {
            centre_in_world: known.unwrap_or(seen).to_array(),
            centre_in_camera: centre.to_array(),
            radius,
            sigma,
        }
    });
    let resection = pose.resection.as_ref();
    EnvironmentRecord {
        header,
        kind: match inputs.kind {
            EnvironmentCameraKind::Fisheye => "fisheye",
            EnvironmentCameraKind::Sphere => "sphere",
        }
        .to_owned(),
        image_size: [size.0, size.1],
        lens: optics.lens.clone(),
        world_from_camera: PoseRecord::from_pose(&pose.world_from_camera),
        by: pose.by.to_owned(),
        turn_sigma_degrees: resection.map(|p| p.rotation_sigma.to_array().map(f64::to_degrees)),
        place_sigma: resection
            .filter(|p| p.position_sigma != DVec3::ZERO)
            .map(|p| p.position_sigma.to_array()),
        sphere,
    }
}
