//! The TUM RGB-D benchmark's layout: `rgb.txt` lists pictures, `groundtruth.txt` poses of
//! the camera's optical frame in the world. Depth pictures are ignored.

use super::folder::Folder;
use super::{Camera, ImportError, Item, Plan};
use glam::{DQuat, DVec3};
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use std::path::PathBuf;

const PICTURES: &str = "rgb.txt";
const POSES: &str = "groundtruth.txt";
/// The optional calibration.
const RIG: &str = "rig.json";

pub(super) fn plan(folder: &Folder) -> Result<Plan, ImportError> {
    let mut plan = Plan::default();
    if folder.has(RIG) {
        plan.attachments.push((RIG.to_owned(), PathBuf::from(RIG)));
    }
    let text = folder.text(PICTURES)?;
    for (sequence, (line, row)) in rows(&text).enumerate() {
        let fault = |reason: &str| folder.line(PICTURES, line, reason);
        let (stamp, file) = row
            .split_once(char::is_whitespace)
            .ok_or_else(|| fault("not `timestamp filename`"))?;
        let arrived_at = seconds(stamp).ok_or_else(|| fault("no time in seconds"))?;
        let picture = Item::Picture {
            camera: Camera::Scene,
            file: PathBuf::from(file.trim()),
            sequence: sequence as u64,
            bracket_ev: 0.0,
        };
        plan.items.push((arrived_at, picture));
    }
    if folder.has(POSES) {
        poses(folder, &mut plan)?;
    }
    Ok(plan)
}

fn poses(folder: &Folder, plan: &mut Plan) -> Result<(), ImportError> {
    let text = folder.text(POSES)?;
    for (line, row) in rows(&text) {
        let sample = pose(row).ok_or_else(|| {
            folder.line(
                POSES,
                line,
                "not `timestamp tx ty tz qx qy qz qw` of a unit quaternion",
            )
        })?;
        plan.items.push((sample.arrived_at, Item::Pose(sample)));
    }
    Ok(())
}

/// Iterates over the lines that are not comments, with their numbers.
fn rows(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

fn pose(row: &str) -> Option<PoseSample> {
    let mut cells = row.split_whitespace();
    let arrived_at = seconds(cells.next()?)?;
    let mut numbers = [0.0_f64; 7];
    for number in &mut numbers {
        *number = cells.next()?.parse().ok()?;
    }
    let [x, y, z, qx, qy, qz, qw] = numbers;
    let (translation, rotation) = (DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw));
    let unit = (rotation.length() - 1.0).abs() < 0.01;
    (translation.is_finite() && unit).then(|| PoseSample {
        station: 1,
        transmitter_from_sensor: RigidTransform::new(rotation.normalize(), translation),
        arrived_at,
        error: None,
    })
}

/// Parses decimal seconds digit by digit: a double of today's Unix time has only 0.2 µs resolution.
fn seconds(text: &str) -> Option<MonotonicTime> {
    let (integer, fraction) = text.split_once('.').unwrap_or((text, ""));
    let seconds: i64 = integer.parse().ok().filter(|s| *s >= 0)?;
    if !fraction.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let nanos: i64 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
    let nanos = seconds.checked_mul(1_000_000_000)?.checked_add(nanos)?;
    Some(MonotonicTime::from_nanos(nanos))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_read_to_the_nanosecond() {
        let nanos = |text| seconds(text).map(MonotonicTime::as_nanos);
        assert_eq!(nanos("1305031102.175304"), Some(1_305_031_102_175_304_000));
        assert_eq!(nanos("0.0000000019"), Some(1));
        assert_eq!(nanos("7"), Some(7_000_000_000));
        for wrong in [
            "",
            "-1.0",
            "1.2.3",
            "1e9",
            "1.-5",
            "99999999999999999999",
            "nan",
        ] {
            assert_eq!(nanos(wrong), None, "{wrong}");
        }
    }
}
