//! Prediction errors on logs of trackers.

use super::*;
use penumbra_numerics::Random;
use std::path::{Path, PathBuf};

/// `tracker.csv` of a session, or a trajectory as TUM writes it (by motion capture: 0.3 mm of noise
/// is added to it).
fn readings(path: &Path) -> Vec<(MonotonicTime, RigidTransform)> {
    let text = std::fs::read_to_string(path).unwrap();
    let ours = path.extension().is_some_and(|e| e == "csv");
    let mut random = Random::new(1);
    let rows = text.lines().filter_map(|line| {
        let cells = line.split([',', ' ']).map(str::parse::<f64>);
        let n: Vec<f64> = cells.collect::<Result<_, _>>().ok()?;
        let place = DVec3::new(n[1], n[2], n[3]);
        let (nanos, place, turn) = if ours {
            (n[0], place, DQuat::from_xyzw(n[5], n[6], n[7], n[4]))
        } else {
            let noisy = place + 3e-4 * random.normal3();
            (n[0] * 1e9, noisy, DQuat::from_xyzw(n[4], n[5], n[6], n[7]))
        };
        let pose = RigidTransform::new(turn.normalize(), place);
        Some((MonotonicTime::from_nanos(nanos as i64), pose))
    });
    rows.collect()
}

/// RMS error of predictions over `ahead` seconds, mm: line, parabola, cubic, halfway between the first
/// two, and the history's.
fn errors(readings: &[(MonotonicTime, RigidTransform)], ahead: f64) -> [f64; 5] {
    let mut history = PoseHistory::new(HistoryConfig::default());
    let (mut sums, mut count) = ([0.0; 5], 0.0);
    for (k, (at, pose)) in readings.iter().enumerate() {
        history.push(*at, *pose);
        let due = at.offset_nanos((ahead * 1e9) as i64);
        let after = readings.partition_point(|(then, _)| *then < due);
        let Some((then, truth)) = readings.get(after).filter(|_| k >= 10) else {
            continue;
        };
        let Some(predicted) = history.expected(*then, *at, 200_000_000) else {
            continue;
        };
        let last = *history.samples.back().unwrap();
        let forecasts = history.forecasts(*then, history.len(), &last);
        let [line, parabola, cubic] = forecasts.map(|forecast| forecast.translation);
        let predicted = predicted.transmitter_from_sensor.translation;
        let all = [line, parabola, cubic, line.lerp(parabola, 0.5), predicted];
        for (sum, place) in sums.iter_mut().zip(all) {
            *sum += place.distance_squared(truth.translation);
        }
        count += 1.0;
    }
    sums.map(|sum| 1e3 * f64::sqrt(sum / count))
}

#[test]
#[ignore = "prints a table; TRACKER_LOGS=a/tracker.csv:b.txt"]
fn predictions_of_logs() {
    let logs = std::env::var_os("TRACKER_LOGS").unwrap_or_default();
    let logs: Vec<PathBuf> = std::env::split_paths(&logs).collect();
    assert!(!logs.is_empty(), "TRACKER_LOGS names none");
    println!(
        "| log | 40 ms: line | parabola | cubic | half way | mixed | 20 ms: half way | mixed |"
    );
    for log in logs {
        let readings = readings(&log);
        let [a, b, c, d, e] = errors(&readings, 0.04);
        let [.., f, g] = errors(&readings, 0.02);
        let name = log.display();
        println!("| {name} | {a:.2} | {b:.2} | {c:.2} | {d:.2} | {e:.2} | {f:.2} | {g:.2} |");
        assert!(e.is_finite() && g.is_finite());
    }
}
