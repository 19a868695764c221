//! Simulated maps: corners with detection noise and outliers.

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

fn simulate(seed: u64) -> SimulatedRig {
    SimulatedRig::new(SimulationOptions {
        seed,
        ..SimulationOptions::default()
    })
}

/// Returns the camera's view of `tags` at a time, with corner noise of `noise` pixels.
fn view(
    rig: &SimulatedRig,
    tags: &[Tag],
    at: f64,
    noise: f64,
    random: &mut Random,
) -> Vec<TagObservation> {
    let lens = rig.scene.lens();
    let camera_from_world = rig.world_from_camera(at).inverse();
    let inside = |p: &DVec2| p.cmpgt(DVec2::ONE).all() && p.cmplt(DVec2::new(638.0, 478.0)).all();
    let observe = |tag: &Tag| {
        // A tag is not visible from behind.
        let tag_from_camera = tag.map_from_tag.inverse() * camera_from_world.inverse();
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
        (seen.corners.iter().all(inside) && tag_from_camera.translation.z < 0.0).then_some(seen)
    };
    tags.iter().filter_map(observe).collect()
}

fn document(rig: &SimulatedRig, known: &[Tag]) -> RigDocument {
    let mut document = RigDocument::parse(rig.rig_json().to_string().as_bytes()).unwrap();
    document.markers = known
        .iter()
        .map(|t| penumbra_rig_model::Marker {
            family: t.family.to_string(),
            id: t.id,
            size: t.size,
            world_from_marker: t.map_from_tag,
        })
        .collect();
    document
}

/// Builds a map from 60 views; `tags_at` returns the tags at a share of the time.
fn build(
    rig: &SimulatedRig,
    known: &[Tag],
    options: MapOptions,
    tags_at: &dyn Fn(f64) -> Vec<Tag>,
) -> Finished {
    let mut random = Random::new(rig.options.seed + 31);
    let mut step = MapStep::new(
        &document(rig, known).calibration,
        &document(rig, known).markers,
        options,
    );
    for i in 0..60 {
        let share = f64::from(i) / 60.0;
        let mut seen = view(rig, &tags_at(share), 20.0 * share, 0.12, &mut random);
        for tag in &mut seen {
            if random.uniform() < 0.03 {
                // Half hidden: one corner is displaced.
                tag.corners[1] += DVec2::new(14.0, -9.0);
            }
        }
        step.add_tags(seen);
    }
    step.finish(&CalibrationProvenance::default())
}

fn markers(rig: &SimulatedRig, known: &[Tag], found: &Finished) -> Vec<Tag> {
    let file = found.file.clone().expect("a file");
    let mut document = document(rig, known);
    let get = |name: &str| (name == MARKERS).then_some(file.as_bytes());
    apply_markers_file(&mut document, &get).unwrap();
    document.markers.iter().map(|m| m.tag().unwrap()).collect()
}

/// Returns the maximum corner error, metres.
fn max_error(found: &[Tag], truth: &[Tag]) -> f64 {
    let error = |f: &Tag| {
        let t = truth.iter().find(|t| t.id == f.id).unwrap();
        let pairs = f.corners().into_iter().zip(t.corners());
        pairs.map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
    };
    found.iter().map(error).fold(0.0, f64::max)
}

#[test]
fn map_is_accurate_to_a_millimetre() {
    for seed in 1..5 {
        let rig = simulate(seed);
        let found = build(&rig, &[], options(), &|_| rig.tags.clone());
        assert_eq!(found.grade, Grade::Good, "{seed}: {:?}", found.findings);
        let tags = markers(&rig, &[], &found);
        assert_eq!(tags.len(), 9, "{seed}");
        let error = max_error(&tags, &rig.tags);
        assert!(error < 0.001, "{seed}: {error}");
        assert!(found.report.contains("<svg") && !found.report.contains("NaN"));
    }
}

#[test]
fn known_markers_keep_their_poses_and_moved_ones_are_reported() {
    let rig = simulate(6);
    let lifted = RigidTransform::new(DQuat::from_rotation_z(0.4), glam::DVec3::new(1.0, 2.0, 0.5));
    let mut known = rig.tags[2..5].to_vec();
    for tag in &mut known {
        tag.map_from_tag = lifted * tag.map_from_tag;
    }
    let truth: Vec<Tag> = rig
        .tags
        .iter()
        .map(|t| Tag {
            map_from_tag: lifted * t.map_from_tag,
            ..*t
        })
        .collect();
    let all = |_: f64| rig.tags.clone();
    let found = build(&rig, &known, options(), &all);
    assert_ne!(found.grade, Grade::Refused, "{:?}", found.findings);
    let tags = markers(&rig, &known, &found);
    assert_eq!(tags.len(), 9);
    let error = max_error(&tags, &truth);
    assert!(error < 0.0015, "{error}");
    // A marker that was moved.
    known[1].map_from_tag.translation.x += 0.04;
    let found = build(&rig, &known, options(), &all);
    assert_eq!(found.grade, Grade::Refused);
    assert!(
        found.findings[0].1.contains("from its calibrated position"),
        "{:?}",
        found.findings
    );
    // A new world ignores the calibrated poses.
    let new_world = MapOptions {
        origin: Some(0),
        ..options()
    };
    let found = build(&rig, &known, new_world, &all);
    let tags = markers(&rig, &known, &found);
    assert!(max_error(&tags, &rig.tags) < 0.001);
}

#[test]
#[expect(clippy::too_many_lines, reason = "one map, case by case")]
fn wrong_size_moved_tag_and_isolated_tag_are_reported() {
    let rig = simulate(7);
    // Printed at 9 cm, given as 8 cm.
    let printed = |_: f64| {
        let mut tags = rig.tags.clone();
        tags[4].size = 0.09;
        tags
    };
    let found = build(&rig, &[], options(), &printed);
    assert_eq!(found.grade, Grade::Refused);
    let messages: Vec<&String> = found.findings.iter().map(|f| &f.1).collect();
    assert!(
        messages
            .iter()
            .any(|f| f.contains("tag36h11 4 a size") && f.contains("--size-of 4=")),
        "{messages:?}"
    );
    let corrected = MapOptions {
        sizes: BTreeMap::from([(4, 0.09)]),
        ..options()
    };
    let found = build(&rig, &[], corrected, &printed);
    assert_ne!(found.grade, Grade::Refused, "{:?}", found.findings);

    let knocked = |share: f64| {
        let mut tags = rig.tags.clone();
        if share > 0.5 {
            tags[5].map_from_tag.translation.x += 0.02;
        }
        tags
    };
    let found = build(&rig, &[], options(), &knocked);
    assert!(
        found
            .findings
            .iter()
            .any(|f| f.1.contains("tag36h11 5") && f.1.contains("moved")),
        "{:?}",
        found.findings
    );
    let tags = markers(&rig, &[], &found);
    assert!(tags.iter().all(|t| t.id != 5));
    assert!(max_error(&tags, &rig.tags) < 0.001);

    let found = build(
        &rig,
        &[],
        MapOptions {
            size: None,
            ..options()
        },
        &|_| rig.tags.clone(),
    );
    assert!(
        found.findings[0].1.contains("--size METRES"),
        "{:?}",
        found.findings
    );
    let found = build(&rig, &[], options(), &|_| rig.tags[..1].to_vec());
    assert_eq!(found.grade, Grade::Refused);
    assert!(
        found.findings[0].1.contains("two tags or more"),
        "{:?}",
        found.findings
    );
}
