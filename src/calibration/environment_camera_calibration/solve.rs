//! From all that was gathered to a calibration, and how good it is.

use super::super::step::{Finished, Made};
use super::optics::{Optics, optics};
use super::page::{Drawn, page};
use super::resection::{NoPose, Placed, Sight, Target, Unknowns, place};
use super::step::{EnvironmentStep, Kind};
use super::verdict::judge;
use super::view::View;
use crate::environment_camera_calibration::observations::{By, Marked};
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::environment_file::{EnvironmentRecord, PoseRecord, STEP, SphereRecord};

/// What there is to say.
#[derive(Debug, Default)]
pub(super) struct Said {
    pub lines: Vec<String>,
    pub findings: Vec<(Grade, String)>,
    pub hints: Vec<String>,
}

impl Said {
    pub fn against(&mut self, grade: Grade, text: impl ToString) {
        self.findings.push((grade, text.to_string()));
    }

    pub fn line(&mut self, text: String) {
        self.lines.push(text);
    }

    fn grade(&self) -> Grade {
        self.findings
            .iter()
            .map(|f| f.0)
            .max()
            .unwrap_or(Grade::Good)
    }
}

/// The pose, and what speaks for it.
pub(super) struct Stand {
    pub pose: RigidTransform,
    pub placed: Option<Placed>,
    pub marked: Vec<Marked>,
    pub by: &'static str,
}

pub(super) fn finish(step: &EnvironmentStep, made: &Made) -> Finished {
    let mut said = Said::default();
    if step.gathered.layers.count == 0 {
        said.against(Grade::Refused, "there is no picture of the environment camera; record with both cameras, or import the session with its env/ folder");
    }
    if step.gathered.other_size > 0 {
        said.against(
            Grade::Usable,
            format!(
                "{} pictures of the environment camera are of another size and were passed over",
                step.gathered.other_size
            ),
        );
    }
    let optics = optics(step, &mut said);
    let stand = optics.as_ref().and_then(|o| stand(step, o, &mut said));
    said.findings.sort_by_key(|f| std::cmp::Reverse(f.0));
    let mut found = Finished {
        grade: said.grade(),
        lines: said.lines,
        findings: said.findings,
        hints: said.hints,
        page: String::new(),
        file: None,
    };
    if let (Some(optics), Some(stand)) = (&optics, &stand) {
        let header = found.header(STEP, made);
        let record = record(step, header, optics, stand);
        found.file = serde_json::to_string_pretty(&record)
            .ok()
            .filter(|_| found.grade != Grade::Refused);
    }
    let drawn = Drawn {
        picture: (step.gathered.layers.count > 0).then(|| step.gathered.layers.picture()),
        optics: optics.as_ref(),
        stand: stand.as_ref(),
    };
    found.page = page(&found, made, &drawn);
    found
}

/// Where the camera stands.
fn stand(step: &EnvironmentStep, optics: &Optics, said: &mut Said) -> Option<Stand> {
    let (marked, two_lights) = marked(step, optics, said);
    let rough = step.rough_pose();
    let sights: Vec<Sight> = marked.iter().map(|m| m.sight).collect();
    let result = match unknowns(step, optics, &sights) {
        Some(unknowns) if !sights.is_empty() => place(&sights, unknowns, rough),
        Some(_) => Err(NoPose::TooFew {
            known: 0,
            needed: 2,
        }),
        None => {
            said.against(Grade::Refused, "the place of the environment camera is not known, and there are fewer than 4 known points to find it by: say it with --at X,Y,Z (world, metres), or show it a marker");
            return None;
        }
    };
    match result {
        Ok(placed) => {
            judge(step, &placed, &marked, two_lights, said);
            let by = marked
                .iter()
                .max_by_key(|m| weight(m.by))
                .map_or("", |m| m.by.name());
            Some(Stand {
                pose: placed.world_from_camera,
                placed: Some(placed),
                marked,
                by,
            })
        }
        Err(why) => fallback(step, optics, &why, marked, said),
    }
}

const fn weight(by: By) -> u8 {
    match by {
        By::Light => 0,
        By::Click => 1,
        By::Marker => 2,
    }
}

/// All sights; true where two lights alone must do.
fn marked(step: &EnvironmentStep, optics: &Optics, said: &mut Said) -> (Vec<Marked>, bool) {
    let view = &optics.view;
    let (mut marked, tags) = step.markers(view);
    let (clicks, lost) = step.clicks(view);
    if lost > 0 {
        said.against(Grade::Usable, format!("{lost} clicks are outside of the picture, or of a time without a pose of the scene camera; they are left out"));
    }
    let names: Vec<String> = tags
        .iter()
        .map(|t| format!("{} {}", t.family, t.id))
        .collect();
    if !names.is_empty() {
        said.line(format!(
            "markers seen by the environment camera: {}",
            names.join(", ")
        ));
    }
    marked.extend(clicks);
    let points = marked.iter().filter(|m| m.by == By::Marker).count();
    if points >= 8 {
        // What is sure does not need what is not.
        return (weighed(marked, view, optics), false);
    }
    let own = step.own_lights(view, optics.ball());
    let world = step.world_lights();
    let mut two = false;
    match step.lights((view, optics.ball()), &own, &world) {
        Ok((lights, found)) => {
            said.line(format!(
                "{} bright lights of the environment camera, {} by the scene camera, {} the same",
                own.len(),
                world.len(),
                lights.len()
            ));
            two = marked.is_empty() && lights.len() == 2;
            match found.ambiguous {
                Some(turn) if marked.is_empty() => said.against(Grade::Refused, format!("the lights can be told apart in two ways, {:.0}° from one another; let a third light be seen, or write a rough pose of the environment camera into rig.json", turn.to_degrees())),
                // What is sure does not need what is not.
                Some(_) => return (weighed(marked, view, optics), false),
                None => {}
            }
            marked.extend(lights);
        }
        Err(why) if marked.is_empty() => said.hints.push(why.to_string()),
        Err(_) => {}
    }
    (weighed(marked, view, optics), two)
}

/// What the lens leaves open is open in every sight.
fn weighed(mut marked: Vec<Marked>, view: &View, optics: &Optics) -> Vec<Marked> {
    let Some(circle) = &optics.circle else {
        return marked;
    };
    for m in &mut marked {
        let theta = m.sight.bearing.angle_between(DVec3::Z);
        let scale = theta * circle.radius_sigma / circle.radius;
        let shift = circle.centre_sigma.length() / view.focal();
        m.sight.sigma = m.sight.sigma.hypot(scale).hypot(shift);
    }
    marked
}

fn unknowns(step: &EnvironmentStep, optics: &Optics, sights: &[Sight]) -> Option<Unknowns> {
    let points = sights
        .iter()
        .filter(|s| matches!(s.target, Target::Point(_)))
        .count();
    let sphere = step
        .known
        .rig
        .mirror_sphere
        .as_ref()
        .map(|s| s.centre_in_world);
    if points >= 4 && step.asked.at.is_none() {
        return Some(Unknowns::Pose);
    }
    match (optics.ball(), sphere) {
        (Some((outline, radius)), Some(in_world)) => Some(Unknowns::About {
            in_camera: outline.centre(radius).0,
            in_world,
        }),
        _ => step.stand().map(Unknowns::Turn),
    }
}

/// Nothing tells the orientation: what is written down stays, if it is.
fn fallback(
    step: &EnvironmentStep,
    optics: &Optics,
    why: &NoPose,
    marked: Vec<Marked>,
    said: &mut Said,
) -> Option<Stand> {
    said.hints.push("show both cameras a marker of rig.json's `markers`, or two or more bright lights; or click on known things: --click-pairs FILE".to_owned());
    let Some(mut pose) = step.rough_pose() else {
        said.against(
            Grade::Refused,
            format!("the orientation of the environment camera is open: {why}"),
        );
        return None;
    };
    if matches!(why, NoPose::Contradiction { .. }) {
        said.against(Grade::Refused, why);
    } else {
        said.against(
            Grade::Usable,
            format!("the orientation stays as rig.json has it: {why}"),
        );
    }
    let sphere = step.known.rig.mirror_sphere.as_ref();
    if let (Some((outline, _)), Some(sphere)) = (optics.ball(), sphere) {
        // Its place is easier to measure than where it looks; the outline puts two angles right.
        let to = (sphere.centre_in_world - pose.translation).normalize_or(DVec3::Z);
        let arc = DQuat::from_rotation_arc(pose.rotation * outline.axis, to);
        pose.rotation = (arc * pose.rotation).normalize();
    }
    Some(Stand {
        pose,
        placed: None,
        marked,
        by: "rig.json",
    })
}

fn record(
    step: &EnvironmentStep,
    header: Header,
    optics: &Optics,
    stand: &Stand,
) -> EnvironmentRecord {
    let size = step.gathered.layers.size;
    let sphere = optics.ball().map(|(outline, radius)| {
        let (centre, sigma) = outline.centre(radius);
        let known = step
            .known
            .rig
            .mirror_sphere
            .as_ref()
            .map(|s| s.centre_in_world);
        let seen = stand.pose.transform_point(centre);
        SphereRecord {
            centre_in_world: known.unwrap_or(seen).to_array(),
            centre_in_camera: centre.to_array(),
            radius,
            sigma,
        }
    });
    let placed = stand.placed.as_ref();
    EnvironmentRecord {
        header,
        kind: match step.kind {
            Kind::Fisheye => "fisheye",
            Kind::Sphere => "sphere",
        }
        .to_owned(),
        image_size: [size.0, size.1],
        lens: optics.lens.clone(),
        world_from_camera: PoseRecord::of(&stand.pose),
        by: stand.by.to_owned(),
        turn_sigma_degrees: placed.map(|p| p.turn_sigma.to_array().map(f64::to_degrees)),
        place_sigma: placed
            .filter(|p| p.place_sigma != DVec3::ZERO)
            .map(|p| p.place_sigma.to_array()),
        sphere,
    }
}
