//! Compares gains between the cameras with the true ones of the path-traced rigs.
//!
//! `cargo test --release --test white_balance_truth -- --nocapture` prints the table.
//! Only this test, not the program, reads the ground truth (`truth_rig.json`).

#![expect(clippy::unwrap_used)]
#![allow(missing_docs)]

use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::Response;
use penumbra_camera::{EnvironmentView, FisheyeLens};
use penumbra_interface::{Frame, MonotonicTime, PixelFormat, RigidTransform};
use penumbra_picture::{Picture, YuvEncoding};
use penumbra_rig_model::EnvironmentCamera;
use penumbra_rig_model::RigDocument;
use penumbra_scene::raycast::sphere_hit;
use penumbra_scene::{RayCaster, Scene};
use penumbra_white_balance::chart::{ChartMatch, Photograph, match_chart};
use penumbra_white_balance::gather::{GatherOptions, Overlap, gather_pairs};
use penumbra_white_balance::overlap::{
    GainTracker, PairTiming, Shortage, SmoothingOptions, estimate_overlap,
};
use penumbra_white_balance::reflectance::{
    KnownSurface, ReflectanceOptions, SceneView, estimate_reflectance, gather_known,
};
use penumbra_white_balance::{GainEstimate, Provenance, WhiteBalanceMatch, WhiteBalanceSettings};
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
    ground_truth: serde_json::Value,
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
        let scene = rig.phantom_scene(&|file| meshes.get(file).map(Vec::as_slice));
        let ground_truth: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.join("truth_rig.json")).unwrap()).unwrap();
        let gain = |camera: &str| vector(&ground_truth[camera]["response_truth"]["total_gain_rgb"]);
        let true_gains = gain("scene_camera") / gain("environment_camera");
        Self {
            scene: scene.unwrap(),
            rig,
            ground_truth,
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
            controls: None,
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

/// Prints one row of the table: error per channel in percent, reported standard deviation, ΔE2000
/// of a grey.
fn print_row(session: &str, method: &str, estimate: &GainEstimate, truth: DVec3, note: &str) {
    let error = estimate.percent_from(truth);
    let reported = 100.0 * estimate.relative_sd;
    println!(
        "{session:12} {method:12} {:+6.2} {:+6.2} {:+6.2} %   reported {:4.1} {:4.1} {:4.1} %   dE {:5.2}   {note}",
        error.x,
        error.y,
        error.z,
        reported.x,
        reported.y,
        reported.z,
        estimate.delta_e_from(truth),
    );
}

fn chart_match(session: &Session) -> ChartMatch {
    let calibration = &session.rig.calibration;
    let chart = calibration.chart.as_ref().unwrap();
    let scene = session.picture(&chart.scene_picture);
    let environment = session.picture(&chart.environment_picture);
    let scene = Photograph {
        picture: &scene,
        response: &calibration.scene_camera.response,
    };
    let environment = Photograph {
        picture: &environment,
        response: &session.environment().response,
    };
    match_chart(chart, scene, environment, true).unwrap()
}

#[test]
fn chart_gains_are_within_one_percent() {
    if !have_truth("chart_gains_are_within_one_percent") {
        return;
    }
    for name in SESSIONS {
        let session = Session::load(name);
        let found = chart_match(&session);
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

/// Results of the overlap method in a complete session.
struct OverlapRun {
    tracker: GainTracker,
    answered: usize,
    frames: usize,
    last_shortage: Option<Shortage>,
}

#[expect(clippy::too_many_lines, reason = "one rig, step by step")]
fn run_overlap(session: &Session) -> OverlapRun {
    let calibration = &session.rig.calibration;
    let environment = session.environment();
    let caster = RayCaster::from_phantoms(&session.scene);
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
            vignetting: [None; 2],
        };
        let started = std::time::Instant::now();
        let pairs = gather_pairs(&overlap, &caster, &GatherOptions::default());
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
fn overlap_gains_are_within_three_percent_or_missing() {
    if !have_truth("overlap_gains_are_within_three_percent_or_missing") {
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
        let Some(estimate) = run.tracker.estimate() else {
            // There are no usable observations, and the tracker reports it.
            assert!(run.tracker.frozen().is_some());
            println!("{name:12} overlap      none: {note}");
            continue;
        };
        print_row(name, "overlap", &estimate, session.true_gains, &note);
        let error = estimate.percent_from(session.true_gains).abs();
        let reported = 100.0 * estimate.relative_sd;
        assert!(error.max_element() < 3.0, "{name}: {error}");
        assert!(
            (error / reported).max_element() < 3.0,
            "{name}: {error} {reported}"
        );
    }
}

#[test]
fn chart_and_overlap_agree_and_the_chart_is_used() {
    if !have_truth("chart_and_overlap_agree_and_the_chart_is_used") {
        return;
    }
    for name in ["desk-sphere", "courtyard"] {
        let session = Session::load(name);
        let mut matched = WhiteBalanceMatch::new(WhiteBalanceSettings::default(), false);
        matched.set_chart(Ok(chart_match(&session)));
        let answer = run_overlap(&session).tracker.last().copied();
        let now = MonotonicTime::default();
        matched.update_overlap(Ok(answer.unwrap()), now, now);
        let status = matched.status();
        println!("{}", serde_json::to_string(&status).unwrap());
        assert_eq!(status.in_force, Provenance::Chart);
        assert_eq!(status.notice, None);
        let overlap = status.methods.last().unwrap();
        assert!(!overlap.disagrees && overlap.disagreement_delta_e < 1.5);
    }
}

/// Radiance by direction in the upper hemisphere, in units of the environment camera.
struct Sky {
    radiance: Vec<DVec3>,
}

const RINGS: usize = 48;
const SECTORS: usize = 96;

impl Sky {
    fn bin(direction: DVec3) -> Option<usize> {
        // Rings of equal height on the unit sphere have equal solid angle (Archimedes).
        let ring = (direction.z * RINGS as f64) as usize;
        let turn = direction.y.atan2(direction.x) / std::f64::consts::TAU + 0.5;
        let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
        (direction.z > 0.0).then_some(ring.min(RINGS - 1) * SECTORS + sector)
    }

    fn direction(bin: usize) -> DVec3 {
        let z = ((bin / SECTORS) as f64 + 0.5) / RINGS as f64;
        let turn = ((bin % SECTORS) as f64 + 0.5) / SECTORS as f64 - 0.5;
        let (sin, cos) = (turn * std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }

    /// Merges the brackets of one instant; each pixel from its longest unclipped exposure.
    fn merge(session: &Session, shot: &Shot) -> Self {
        let environment = session.environment();
        let mut exposures = vec![(0.0, session.picture(&shot.file))];
        for ev in &environment.brackets_ev {
            let file = shot.file.replace(".jpg", &format!("_ev{ev}.jpg"));
            exposures.push((*ev, session.picture(&file)));
        }
        let (width, height) = (exposures[0].1.width, exposures[0].1.height);
        let bins = RINGS * SECTORS;
        let mut sums = vec![(DVec3::ZERO, 0.0); bins];
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let pixel = DVec2::new(f64::from(x), f64::from(y));
            let Some((direction, loss)) = light_direction(&environment.view, pixel) else {
                continue;
            };
            if let Some(bin) = Self::bin(direction) {
                sums[bin].0 += merged(&exposures, &environment.response, x, y) / loss;
                sums[bin].1 += 1.0;
            }
        }
        let seen = sums.iter().filter(|s| s.1 > 0.0).map(|s| s.0 / s.1);
        let mean = seen.clone().sum::<DVec3>() / seen.count() as f64;
        let radiance = sums.iter();
        let radiance = radiance.map(|(sum, n)| if *n > 0.0 { *sum / *n } else { mean });
        Self {
            radiance: radiance.collect(),
        }
    }

    /// Irradiance on the ground at `point`, with the shadows of the phantoms.
    fn irradiance(&self, point: DVec3, caster: &RayCaster) -> DVec3 {
        let solid_angle = std::f64::consts::TAU / (RINGS * SECTORS) as f64;
        let origin = point + DVec3::new(0.0, 0.0, 1e-4);
        let bins = self.radiance.iter().enumerate();
        let open = bins.filter(|(bin, _)| caster.nearest(origin, Self::direction(*bin)).is_none());
        open.map(|(bin, l)| *l * Self::direction(bin).z * solid_angle)
            .sum()
    }
}

fn merged(exposures: &[(f64, Picture)], response: &Response, x: u32, y: u32) -> DVec3 {
    let channel = |c: usize| {
        let unclipped = exposures.iter().find(|(_, p)| p.rgb(x, y)[c] < 248);
        let (ev, picture) = unclipped.unwrap_or(exposures.last().unwrap());
        let code = usize::from(picture.rgb(x, y)[c]);
        f64::from(response.linear_from_code()[code]) / ev.exp2()
    };
    DVec3::from_array([0, 1, 2].map(channel))
}

/// The direction from which a pixel's light arrives, at infinity, and the mirror's reflectance.
fn light_direction(view: &EnvironmentView, pixel: DVec2) -> Option<(DVec3, DVec3)> {
    match view {
        EnvironmentView::Fisheye {
            lens,
            world_from_camera,
        } => {
            let FisheyeLens { focal, centre, .. } = lens;
            let theta = (pixel - centre).length() / focal;
            let side = (pixel - centre).normalize_or_zero() * theta.sin();
            let direction = world_from_camera.rotation * side.extend(theta.cos());
            (theta < lens.max_theta).then_some((direction, DVec3::ONE))
        }
        EnvironmentView::Sphere {
            camera,
            world_from_camera,
            sphere,
        } => {
            let direction = world_from_camera.rotation * camera.unproject(pixel);
            let eye = world_from_camera.translation;
            let distance = sphere_hit(sphere.centre_in_world, sphere.radius, eye, direction)?;
            let normal = (eye + distance * direction - sphere.centre_in_world) / sphere.radius;
            let reflected = direction - 2.0 * direction.dot(normal) * normal;
            Some((reflected, DVec3::from(sphere.reflectance.map(f64::from))))
        }
        EnvironmentView::SphereInScene { .. } => None,
    }
}

/// Blocks of ground in the scene picture, with the irradiance that the phantoms do not block.
fn ground_surfaces(session: &Session, sky: &Sky, shot: &Shot) -> Vec<KnownSurface> {
    let calibration = &session.rig.calibration;
    let picture = session.picture(&shot.file);
    // An owner would measure it; here it is ground truth.
    let albedo = vector(&session.ground_truth["ground_plane"]["mean_albedo_linear_rgb"]);
    let mut scene = session.scene.clone();
    let ground = scene.phantom_parts.iter_mut().find(|p| p.name == "ground");
    ground.unwrap().albedo = Some(albedo.as_vec3());
    let caster = RayCaster::from_phantoms(&scene);
    let view = SceneView {
        photograph: Photograph {
            picture: &picture,
            response: &calibration.scene_camera.response,
        },
        camera: &calibration.scene_camera.camera,
        world_from_camera: pose_at(&session.poses(), shot.captured_at),
    };
    gather_known(&view, &caster, 24, |hit| sky.irradiance(hit.point, &caster))
}

#[test]
fn reflectance_gains_are_within_their_uncertainty() {
    if !have_truth("reflectance_gains_are_within_their_uncertainty") {
        return;
    }
    for name in SESSIONS {
        let session = Session::load(name);
        let scene_shot = &session.shots("scene", 0)[0];
        let sky = Sky::merge(&session, &session.shots("env", 0)[0]);
        let surfaces = ground_surfaces(&session, &sky, scene_shot);
        let options = ReflectanceOptions::default();
        let found = estimate_reflectance(&surfaces, &options).unwrap();
        let note = format!("{} ground patches", surfaces.len());
        print_row(name, "reflectance", &found, session.true_gains, &note);
        let error = found.percent_from(session.true_gains).abs();
        let reported = 100.0 * found.relative_sd;
        assert!(error.max_element() < 15.0, "{name}: {error}");
        assert!(
            (error / reported).max_element() < 2.0,
            "{name}: {error} {reported}"
        );
    }
}
