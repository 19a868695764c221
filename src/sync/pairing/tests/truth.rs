//! The pose error on the recordings with ground truth, which only tests read.

use super::*;
use penumbra_tracker_serial::fastrak::{Decoder, Format, METRES_PER_CENTIMETRE, METRES_PER_INCH};
use serde_json::Value;
use std::path::{Path, PathBuf};

const NAMES: [&str; 5] = [
    "desk",
    "desk-sphere",
    "courtyard",
    "desk-marker",
    "desk-lamp",
];

fn json(path: PathBuf) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn rigid(pose: &Value) -> RigidTransform {
    let number = |i: usize, j: usize| pose["matrix_row_major"][i][j].as_f64().unwrap();
    let columns = std::array::from_fn(|j| std::array::from_fn(|i| number(i, j)));
    RigidTransform::from_matrix(DMat4::from_cols_array_2d(&columns))
}

struct Recording {
    samples: Vec<PoseSample>,
    frames: Vec<(MonotonicTime, RigidTransform)>,
    world_from_transmitter: RigidTransform,
    sensor_from_camera: RigidTransform,
    latency_nanos: i64,
}

impl Recording {
    fn read(folder: &Path) -> Self {
        let rig = json(folder.join("rig.json"));
        let truth = json(folder.join("truth_rig.json"));
        let bytes = std::fs::read(folder.join("tracker_fastrak.txt")).unwrap();
        let index = std::fs::read_to_string(folder.join("tracker_fastrak_index.csv")).unwrap();
        let mut samples = Vec::new();
        let metres_per_unit = match rig["tracker"]["fastrak"]["units"].as_str().unwrap() {
            "inches" => METRES_PER_INCH,
            _ => METRES_PER_CENTIMETRE,
        };
        let mut decoder = Decoder::new(Format {
            metres_per_unit,
            ..Format::default()
        });
        for (row, record) in index.lines().skip(1).zip(bytes.chunks(47)) {
            let arrived = row.split(',').nth(2).unwrap().parse().unwrap();
            decoder.push(record, MonotonicTime::from_nanos(arrived), |s| {
                samples.push(s)
            });
        }
        let frames = truth["scene_camera"]["frames_truth"].as_array().unwrap();
        let frame = |frame: &Value| {
            let nanos = frame["capture_ns"].as_i64().unwrap();
            (
                MonotonicTime::from_nanos(nanos),
                rigid(&frame["T_world_cam"]),
            )
        };
        Self {
            samples,
            frames: frames.iter().map(frame).collect(),
            world_from_transmitter: rigid(&rig["tracker"]["T_world_source"]),
            sensor_from_camera: rigid(&rig["tracker"]["T_sensor_cam"]),
            latency_nanos: (rig["tracker"]["latency_s"].as_f64().unwrap() * 1e9) as i64,
        }
    }

    /// Position error in millimetres and rotation error in degrees of every frame.
    fn errors(&self, smoothing: Smoothing, full: bool) -> Vec<(f64, f64)> {
        let mut config = PairingConfig {
            tracker_latency_nanos: self.latency_nanos,
            ..PairingConfig::default()
        };
        config.history.smoothing = smoothing;
        if full {
            config = config.with_full_windows();
        }
        let mut pairing = Pairing::new(config);
        let mut arrivals: Vec<(i64, Option<&PoseSample>)> = Vec::new();
        arrivals.extend(
            self.samples
                .iter()
                .map(|s| (s.arrived_at.as_nanos(), Some(s))),
        );
        arrivals.extend(self.frames.iter().map(|(at, _)| (at.as_nanos(), None)));
        arrivals.sort_by_key(|(nanos, _)| *nanos);
        let mut found = Vec::new();
        for (nanos, sample) in arrivals {
            match sample {
                Some(sample) => pairing.push_pose(sample),
                None => {
                    let time = MonotonicTime::from_nanos(nanos);
                    let mut frame = picture(0, 0, 0.0);
                    (frame.captured_at, frame.arrived_at) = (time, time);
                    pairing.push_scene(frame);
                }
            }
            found.extend(std::iter::from_fn(|| pairing.pop()));
        }
        pairing.finish();
        found.extend(std::iter::from_fn(|| pairing.pop()));
        assert_eq!(found.len(), self.frames.len());
        let pairs = found.iter().zip(&self.frames);
        pairs
            .map(|(frame, (_, truth))| self.error(frame, truth))
            .collect()
    }

    fn error(&self, frame: &RigFrame, truth: &RigidTransform) -> (f64, f64) {
        let pose = frame.pose.expect("the tracker covers every frame");
        let sensor = self.world_from_transmitter * pose.transmitter_from_sensor;
        let camera = sensor * self.sensor_from_camera;
        let moved = camera.translation.distance(truth.translation) * 1e3;
        let rotation = camera.rotation.inverse() * truth.rotation;
        let turned = 2.0 * rotation.xyz().length().atan2(rotation.w.abs());
        (moved, turned.to_degrees())
    }
}

fn mean_and_max(errors: &[(f64, f64)]) -> [f64; 4] {
    let n = errors.len() as f64;
    let mean = |pick: fn(&(f64, f64)) -> f64| errors.iter().map(pick).sum::<f64>() / n;
    let max = |pick: fn(&(f64, f64)) -> f64| errors.iter().map(pick).fold(0.0, f64::max);
    [mean(|e| e.0), max(|e| e.0), mean(|e| e.1), max(|e| e.1)]
}

/// Smoothing removes at least half of the error; the test prints the errors.
#[test]
fn smoothing_halves_the_pose_error_of_the_recordings() {
    let Some(truth) = penumbra_test_data::shared("truth") else {
        return;
    };
    let smoothing = HistoryConfig::default().smoothing;
    println!("position mm mean, max; rotation degrees mean, max");
    for name in NAMES {
        let recording = Recording::read(&truth.join(name));
        let [raw, live, full] = [
            (Smoothing::None, false),
            (smoothing, false),
            (smoothing, true),
        ]
        .map(|(smoothing, full)| mean_and_max(&recording.errors(smoothing, full)));
        for (kind, [a, b, c, d]) in [("raw", raw), ("live", live), ("full", full)] {
            println!("{name:12} {kind:5} {a:.3} {b:.3}   {c:.4} {d:.4}");
        }
        for figure in [0, 2] {
            assert!(full[figure] < 0.5 * raw[figure], "{name}");
            assert!(live[figure] < 0.85 * raw[figure], "{name}");
        }
    }
}
