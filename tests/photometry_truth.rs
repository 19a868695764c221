//! Gains between the cameras, against the true ones of the path-traced rigs.
//!
//! `cargo test --release --test photometry_truth -- --nocapture` prints the table.
//! The judge's files (`truth_rig.json`) are read here and nowhere in the program.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use glam::{DQuat, DVec2, DVec3};
use penumbra::calibration::Response;
use penumbra::calibration::colour::delta_e_of_gain_error;
use penumbra::calibration::photometry::GainEstimate;
use penumbra::calibration::photometry::chart::{Photograph, match_chart};
use penumbra::calibration::photometry::gather::{GatherOptions, Overlap, gather_pairs};
use penumbra::calibration::photometry::overlap::{
    GainTracker, PairTiming, Shortage, SmoothingOptions, estimate_overlap,
};
use penumbra::calibration::photometry::raycast::PhantomCaster;
use penumbra::calibration::photometry::reflectance::{
    KnownSurface, ReflectanceOptions, estimate_reflectance,
};
use penumbra::calibration::rig::{EnvironmentCamera, EnvironmentView, FisheyeLens};
use penumbra::calibration::rig_json::RigDocument;
use penumbra::picture::{Picture, YuvEncoding};
use penumbra::scene::mesh::Scene;
use penumbra_interface::{Frame, MonotonicTime, PixelFormat, RigidTransform};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

const SESSIONS: [&str; 5] = [
    "desk",
    "desk-sphere",
    "courtyard",
    "desk-marker",
    "desk-lamp",
];

fn truth_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/truth")
}

struct Session {
    folder: PathBuf,
    rig: RigDocument,
    scene: Scene,
    judge: serde_json::Value,
    true_gains: DVec3,
}

/// A frame's file and the middle of its exposure.
struct Shot {
    file: String,
    captured_at: MonotonicTime,
}

impl Session {
    fn load(name: &str) -> Self {
        let folder = truth_folder().join(name);
        let rig = RigDocument::parse(&std::fs::read(folder.join("rig.json")).unwrap()).unwrap();
        let meshes: HashMap<String, Vec<u8>> = rig
            .phantoms
            .iter()
            .map(|p| (p.file.clone(), std::fs::read(folder.join(&p.file)).unwrap()))
            .collect();
        let scene = Scene::phantoms_of_rig(&rig, &|file| meshes.get(file).map(Vec::as_slice));
        let judge: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.join("truth_rig.json")).unwrap()).unwrap();
        let gain = |camera: &str| vector(&judge[camera]["response_truth"]["total_gain_rgb"]);
        let true_gains = gain("scene_camera") / gain("environment_camera");
        Self {
            scene: scene.unwrap(),
            rig,
            judge,
            true_gains,
            folder,
        }
    }

    fn picture(&self, file: &str) -> Picture {
        let data = std::fs::read(self.folder.join(file)).unwrap();
        let format = if file.ends_with(".png") {
            PixelFormat::Png
        } else {
            PixelFormat::Jpeg
        };
        let frame = Frame {
            data: data.into(),
            format,
            width: 0,
            height: 0,
            stride: 0,
            sequence: 0,
            captured_at: MonotonicTime::default(),
            arrived_at: MonotonicTime::default(),
            exposure: None,
            bracket_ev: 0.0,
        };
        Picture::decode(&frame, &YuvEncoding::default()).unwrap()
    }

    fn shots(&self, camera: &str, latency_nanos: i64) -> Vec<Shot> {
        let text = std::fs::read_to_string(self.folder.join(format!("{camera}_timestamps.csv")));
        let text = text.unwrap();
        let lines = text.lines().skip(1).map(|line| {
            let columns: Vec<&str> = line.split(',').collect();
            let stamped = MonotonicTime::from_nanos(columns[2].parse().unwrap());
            Shot {
                file: columns[1].to_owned(),
                captured_at: stamped.offset_nanos(-latency_nanos),
            }
        });
        lines.collect()
    }

    fn poses(&self) -> Vec<(MonotonicTime, RigidTransform)> {
        let tracker = self.rig.calibration.tracker.as_ref().unwrap();
        let text = std::fs::read_to_string(self.folder.join("tracker.csv")).unwrap();
        let lines = text.lines().skip(1).map(|line| {
            let n: Vec<f64> = line.split(',').map(|c| c.parse().unwrap()).collect();
            let sensor = RigidTransform::new(
                DQuat::from_xyzw(n[5], n[6], n[7], n[4]),
                DVec3::new(n[1], n[2], n[3]),
            );
            let arrived_at = MonotonicTime::from_nanos(n[0] as i64);
            (
                tracker.measured_at(arrived_at),
                tracker.world_from_scene_camera(sensor),
            )
        });
        lines.collect()
    }

    fn environment(&self) -> &EnvironmentCamera {
        self.rig.calibration.environment.as_ref().unwrap()
    }
}

fn vector(value: &serde_json::Value) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|c| value[c].as_f64().unwrap()))
}

fn pose_at(poses: &[(MonotonicTime, RigidTransform)], at: MonotonicTime) -> RigidTransform {
    let after = poses
        .partition_point(|(t, _)| *t < at)
        .clamp(1, poses.len() - 1);
    let ((t0, a), (t1, b)) = (poses[after - 1], poses[after]);
    let s = at.seconds_since(t0) / t1.seconds_since(t0);
    RigidTransform::new(
        a.rotation.slerp(b.rotation, s),
        a.translation.lerp(b.translation, s),
    )
}

fn have_truth(test: &str) -> bool {
    let there = truth_folder().join("desk/rig.json").exists();
    if !there {
        eprintln!("SKIPPED {test}: ../shared is missing");
    }
    there
}

/// One row of the table: error per channel in percent, stated error, ΔE2000 of a grey.
fn print_row(session: &str, method: &str, estimate: &GainEstimate, truth: DVec3, note: &str) {
    let error = estimate.percent_from(truth);
    let stated = 100.0 * estimate.relative_sd;
    println!(
        "{session:12} {method:12} {:+6.2} {:+6.2} {:+6.2} %   stated {:4.1} {:4.1} {:4.1} %   dE {:5.2}   {note}",
        error.x,
        error.y,
        error.z,
        stated.x,
        stated.y,
        stated.z,
        estimate.delta_e_from(truth),
    );
}

#[test]
fn the_chart_gives_the_gains_within_one_percent() {
    if !have_truth("the_chart_gives_the_gains_within_one_percent") {
        return;
    }
    for name in SESSIONS {
        let session = Session::load(name);
        let chart = session.rig.calibration.chart.as_ref().unwrap();
        let (scene, environment) = (
            session.picture(&chart.scene_picture),
            session.picture(&chart.environment_picture),
        );
        let scene = Photograph {
            picture: &scene,
            response: &session.rig.calibration.scene_camera.response,
        };
        let environment = Photograph {
            picture: &environment,
            response: &session.environment().response,
        };
        let found = match_chart(chart, scene, environment, true).unwrap();
        let note = format!(
            "patches {:?}, residual dE {:.2} (worst {:.2}), matrix {}",
            found.patches,
            found.residual_delta_e,
            found.worst_delta_e,
            found.matrix.is_some()
        );
        print_row(name, "chart", &found.estimate, session.true_gains, &note);
        let error = found.estimate.percent_from(session.true_gains);
        assert!(error.abs().max_element() < 1.0, "{name}: {error}");
        assert!(found.estimate.delta_e_from(session.true_gains) < 1.0);
        assert_eq!(
            found.matrix, None,
            "{name}: the cameras differ by gains only"
        );
    }
}

/// What the overlap finds in a whole session.
struct OverlapRun {
    tracker: GainTracker,
    answered: usize,
    frames: usize,
    last_shortage: Option<Shortage>,
}

fn run_overlap(session: &Session) -> OverlapRun {
    let calibration = &session.rig.calibration;
    let environment = session.environment();
    let caster = PhantomCaster::new(&session.scene);
    let poses = session.poses();
    let scene_shots = session.shots("scene", calibration.scene_camera.latency_nanos);
    let environment_shots = session.shots("env", environment.latency_nanos);
    let mut run = OverlapRun {
        tracker: GainTracker::new(SmoothingOptions::default()),
        answered: 0,
        frames: 0,
        last_shortage: None,
    };
    for shot in &environment_shots {
        let near = |s: &&Shot| s.captured_at.nanos_since(shot.captured_at).abs();
        let scene_shot = scene_shots.iter().min_by_key(near).unwrap();
        let scene_picture = session.picture(&scene_shot.file);
        let environment_picture = session.picture(&shot.file);
        let overlap = Overlap {
            scene: Photograph {
                picture: &scene_picture,
                response: &calibration.scene_camera.response,
            },
            scene_camera: &calibration.scene_camera.camera,
            world_from_scene_camera: pose_at(&poses, scene_shot.captured_at),
            environment: Photograph {
                picture: &environment_picture,
                response: &environment.response,
            },
            environment_view: &environment.view,
        };
        let started = std::time::Instant::now();
        let pairs = gather_pairs(
            &overlap,
            &|o, d| caster.cast(o, d),
            &GatherOptions::default(),
        );
        let gathered = started.elapsed();
        let answer = estimate_overlap(&pairs);
        run.frames += 1;
        match &answer {
            Ok(found) => {
                run.answered += 1;
                if std::env::var_os("VERBOSE").is_some() {
                    let note = format!(
                        "{} pairs, {} used, {} clusters, spread {:.3}, {:.1} ms",
                        pairs.len(),
                        found.pairs,
                        found.clusters,
                        found.spread,
                        gathered.as_secs_f64() * 1e3
                    );
                    print_row(
                        &shot.file,
                        "  frame",
                        &found.estimate,
                        session.true_gains,
                        &note,
                    );
                }
            }
            Err(shortage) => run.last_shortage = Some(*shortage),
        }
        let timing = PairTiming {
            scene_at: scene_shot.captured_at,
            environment_at: shot.captured_at,
            exposure_factor: 1.0,
        };
        run.tracker.update(answer, timing);
    }
    run
}

#[test]
fn the_overlap_is_within_three_percent_or_says_that_it_has_none() {
    if !have_truth("the_overlap_is_within_three_percent_or_says_that_it_has_none") {
        return;
    }
    for name in SESSIONS {
        let session = Session::load(name);
        let run = run_overlap(&session);
        let note = format!(
            "{} of {} frame pairs answered, frozen: {:?}, last shortage {:?}",
            run.answered,
            run.frames,
            run.tracker.frozen(),
            run.last_shortage
        );
        match run.tracker.estimate() {
            Some(estimate) => print_row(name, "overlap", &estimate, session.true_gains, &note),
            None => println!("{name:12} overlap      none: {note}"),
        }
    }
}
