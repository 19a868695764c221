//! Simulated maps: corners with detection noise and outliers.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
use super::step::{MapOptions, MapStep};
use crate::simulation::{SimulatedRig, SimulationOptions};
use crate::step::{CalibrationProvenance, Finished, Step};
use glam::{DQuat, DVec2};
use penumbra_fiducials::{Family, Tag, TagObservation};
use penumbra_interface::RigidTransform;
use penumbra_numerics::Random;
use penumbra_rig_model::Grade;
use penumbra_rig_model::RigDocument;
use penumbra_rig_model::markers_file::{MARKERS, apply_markers_file};
use std::collections::BTreeMap;

fn options() -> MapOptions {
    MapOptions {
        families: vec![Family::Tag36h11],
        size: Some(0.08),
        sizes: BTreeMap::new(),
        origin: None,
    }
}

fn rehearsal(seed: u64) -> SimulatedRig {
    SimulatedRig::new(SimulationOptions {
        seed,
        ..SimulationOptions::default()
    })
}

/// Returns the camera's view of `tags` at a time, with corner noise of `noise` pixels.
fn view(
    rehearsal: &SimulatedRig,
    tags: &[Tag],
    at: f64,
    noise: f64,
    random: &mut Random,
) -> Vec<TagObservation> {
    let lens = rehearsal.scene.lens();
    let camera_from_world = rehearsal.world_from_camera(at).inverse();
    let inside = |p: &DVec2| p.cmpgt(DVec2::ONE).all() && p.cmplt(DVec2::new(638.0, 478.0)).all();
    let one = |tag: &Tag| {
        // A tag is not visible from behind.
        let eye = tag.map_from_tag.inverse() * camera_from_world.inverse();
        let corners = tag.corners().map(|c| {
            let pixel = lens.project(camera_from_world.transform_point(c))?;
            Some(pixel + DVec2::new(random.normal(), random.normal()) * noise)
        });
        let [Some(a), Some(b), Some(c), Some(d)] = corners else {
            return None;
        };
        let seen = TagObservation {
            family: tag.family,
            id: tag.id,
            corners: [a, b, c, d],
            margin: 1.0,
            wrong_bits: 0,
        };
        (seen.corners.iter().all(inside) && eye.translation.z < 0.0).then_some(seen)
    };
    tags.iter().filter_map(one).collect()
}

fn rig(rehearsal: &SimulatedRig, known: &[Tag]) -> RigDocument {
    let mut rig = RigDocument::parse(rehearsal.rig_json().to_string().as_bytes()).unwrap();
    rig.markers = known
        .iter()
        .map(|t| penumbra_rig_model::Marker {
            family: t.family.to_string(),
            id: t.id,
            size: t.size,
            world_from_marker: t.map_from_tag,
        })
        .collect();
    rig
}

/// Builds a map from 60 views; `tags_at` returns the tags at a share of the time.
fn mapped(
    rehearsal: &SimulatedRig,
    known: &[Tag],
    options: MapOptions,
    tags_at: &dyn Fn(f64) -> Vec<Tag>,
) -> Finished {
    let mut random = Random::new(rehearsal.options.seed + 31);
    let mut step = MapStep::new(
        &rig(rehearsal, known).calibration,
        &rig(rehearsal, known).markers,
        options,
    );
    for i in 0..60 {
        let share = f64::from(i) / 60.0;
        let mut seen = view(rehearsal, &tags_at(share), 20.0 * share, 0.12, &mut random);
        for tag in &mut seen {
            if random.uniform() < 0.03 {
                // Half hidden: one corner is displaced.
                tag.corners[1] += DVec2::new(14.0, -9.0);
            }
        }
        step.show(seen);
    }
    step.finish(&CalibrationProvenance::default())
}

fn markers(rehearsal: &SimulatedRig, known: &[Tag], found: &Finished) -> Vec<Tag> {
    let file = found.file.clone().expect("a file");
    let mut rig = rig(rehearsal, known);
    let get = |name: &str| (name == MARKERS).then_some(file.as_bytes());
    apply_markers_file(&mut rig, &get).unwrap();
    rig.markers.iter().map(|m| m.tag().unwrap()).collect()
}

/// Returns the maximum corner error, metres.
fn worst(found: &[Tag], truth: &[Tag]) -> f64 {
    let off = |f: &Tag| {
        let t = truth.iter().find(|t| t.id == f.id).unwrap();
        let pairs = f.corners().into_iter().zip(t.corners());
        pairs.map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
    };
    found.iter().map(off).fold(0.0, f64::max)
}

#[test]
fn map_is_accurate_to_a_millimetre() {
    for seed in 1..5 {
        let rehearsal = rehearsal(seed);
        let found = mapped(&rehearsal, &[], options(), &|_| rehearsal.tags.clone());
        assert_eq!(found.grade, Grade::Good, "{seed}: {:?}", found.findings);
        let tags = markers(&rehearsal, &[], &found);
        assert_eq!(tags.len(), 9, "{seed}");
        let worst = worst(&tags, &rehearsal.tags);
        assert!(worst < 0.001, "{seed}: {worst}");
        assert!(found.report.contains("<svg") && !found.report.contains("NaN"));
    }
}

#[test]
fn known_markers_keep_their_poses_and_moved_ones_are_reported() {
    let rehearsal = rehearsal(6);
    let lifted = RigidTransform::new(DQuat::from_rotation_z(0.4), glam::DVec3::new(1.0, 2.0, 0.5));
    let mut known = rehearsal.tags[2..5].to_vec();
    for tag in &mut known {
        tag.map_from_tag = lifted * tag.map_from_tag;
    }
    let truth: Vec<Tag> = rehearsal
        .tags
        .iter()
        .map(|t| Tag {
            map_from_tag: lifted * t.map_from_tag,
            ..*t
        })
        .collect();
    let all = |_: f64| rehearsal.tags.clone();
    let found = mapped(&rehearsal, &known, options(), &all);
    assert_ne!(found.grade, Grade::Refused, "{:?}", found.findings);
    let tags = markers(&rehearsal, &known, &found);
    assert_eq!(tags.len(), 9);
    assert!(worst(&tags, &truth) < 0.0015, "{}", worst(&tags, &truth));
    // A marker that was moved.
    known[1].map_from_tag.translation.x += 0.04;
    let found = mapped(&rehearsal, &known, options(), &all);
    assert_eq!(found.grade, Grade::Refused);
    assert!(
        found.findings[0]
            .1
            .contains("from where the calibration says"),
        "{:?}",
        found.findings
    );
    // A new world ignores the calibrated poses.
    let anew = MapOptions {
        origin: Some(0),
        ..options()
    };
    let found = mapped(&rehearsal, &known, anew, &all);
    let tags = markers(&rehearsal, &known, &found);
    assert!(worst(&tags, &rehearsal.tags) < 0.001);
}

#[test]
#[expect(clippy::too_many_lines, reason = "one map, case by case")]
fn wrong_size_moved_tag_and_isolated_tag_are_reported() {
    let rehearsal = rehearsal(7);
    // Printed at 9 cm, given as 8 cm.
    let printed = |_: f64| {
        let mut tags = rehearsal.tags.clone();
        tags[4].size = 0.09;
        tags
    };
    let found = mapped(&rehearsal, &[], options(), &printed);
    assert_eq!(found.grade, Grade::Refused);
    let said: Vec<&String> = found.findings.iter().map(|f| &f.1).collect();
    assert!(
        said.iter()
            .any(|f| f.contains("tag36h11 4 is") && f.contains("--size-of 4=")),
        "{said:?}"
    );
    let told = MapOptions {
        sizes: BTreeMap::from([(4, 0.09)]),
        ..options()
    };
    let found = mapped(&rehearsal, &[], told, &printed);
    assert_ne!(found.grade, Grade::Refused, "{:?}", found.findings);

    let knocked = |share: f64| {
        let mut tags = rehearsal.tags.clone();
        if share > 0.5 {
            tags[5].map_from_tag.translation.x += 0.02;
        }
        tags
    };
    let found = mapped(&rehearsal, &[], options(), &knocked);
    assert!(
        found
            .findings
            .iter()
            .any(|f| f.1.contains("tag36h11 5") && f.1.contains("moved")),
        "{:?}",
        found.findings
    );
    let tags = markers(&rehearsal, &[], &found);
    assert!(tags.iter().all(|t| t.id != 5));
    assert!(worst(&tags, &rehearsal.tags) < 0.001);

    let found = mapped(
        &rehearsal,
        &[],
        MapOptions {
            size: None,
            ..options()
        },
        &|_| rehearsal.tags.clone(),
    );
    assert!(
        found.findings[0].1.contains("--size METRES"),
        "{:?}",
        found.findings
    );
    let found = mapped(&rehearsal, &[], options(), &|_| {
        rehearsal.tags[..1].to_vec()
    });
    assert_eq!(found.grade, Grade::Refused);
    assert!(
        found.findings[0].1.contains("two tags or more"),
        "{:?}",
        found.findings
    );
}
