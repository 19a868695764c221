//! The TUM RGB-D benchmark's layout: `rgb.txt` lists pictures, `groundtruth.txt` poses of
//! the camera's optical frame in the world. Depth pictures are ignored.
//!
//! A session replays with a `rig.json`, which the benchmark does not have. The import writes one:
//! the camera is its own tracker, and the lens is the one that the benchmark publishes for the
//! sequence. A `rig.json` in the folder takes precedence.

use super::folder::Folder;
use super::{Camera, ImportError, Item, Lens, Plan, rig_folder};
use glam::{DQuat, DVec3};
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const PICTURES: &str = "rgb.txt";
const POSES: &str = "groundtruth.txt";
/// The optional calibration.
const RIG: &str = "rig.json";

pub(super) fn plan(folder: &Folder) -> Result<Plan, ImportError> {
    let mut plan = Plan::default();
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
    rig(folder, &text, &mut plan)?;
    Ok(plan)
}

/// Adds the `rig.json`, and what viewers read of it.
fn rig(folder: &Folder, list: &str, plan: &mut Plan) -> Result<(), ImportError> {
    let (mut rig, lens) = if folder.has(RIG) {
        (rig_folder::rig(folder)?, Lens::Stated)
    } else if is_vga(folder, plan) {
        let (sequence, lens) = published_lens(list);
        (rig_of(sequence, &lens), Lens::Published { sequence })
    } else {
        plan.lens = Some(Lens::Unknown);
        return Ok(());
    };
    let has_poses = plan.items.iter().any(|(_, i)| matches!(i, Item::Pose(_)));
    if let Some(object) = rig.as_object_mut().filter(|_| has_poses) {
        // The poses are the camera's own.
        let rows = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
        let here = json!({ "matrix_row_major": rows });
        let tracker = json!({ "T_world_source": here.clone(), "T_sensor_cam": here });
        object.entry("tracker").or_insert(tracker);
    }
    rig_folder::view_rig(&rig, plan);
    plan.written
        .push((RIG.to_owned(), format!("{rig:#}\n").into_bytes()));
    plan.lens = Some(lens);
    Ok(())
}

/// Focal lengths, principal point (pixels) and OpenCV's distortion of a colour camera.
struct PublishedLens {
    k: [f64; 4],
    distortion: [f64; 5],
}

/// Returns the lens that the benchmark publishes for a sequence, by the name in the head of
/// `rgb.txt`: the three cameras of the recordings fr1, fr2 and fr3, else the suggested default.
fn published_lens(list: &str) -> (&'static str, PublishedLens) {
    let head: String = list.lines().take_while(|l| l.starts_with('#')).collect();
    let lens = |k, distortion| PublishedLens { k, distortion };
    if head.contains("freiburg1") {
        let distortion = [0.262_383, -0.953_104, -0.005_358, 0.002_628, 1.163_314];
        let k = [517.306_408, 516.469_215, 318.643_040, 255.313_989];
        ("freiburg1", lens(k, distortion))
    } else if head.contains("freiburg2") {
        let distortion = [0.231_222, -0.784_899, -0.003_257, -0.000_105, 0.917_205];
        let k = [520.908_620, 521.007_327, 325.141_442, 249.701_764];
        ("freiburg2", lens(k, distortion))
    } else if head.contains("freiburg3") {
        ("freiburg3", lens([535.4, 539.2, 320.1, 247.6], [0.0; 5]))
    } else {
        ("default", lens([525.0, 525.0, 319.5, 239.5], [0.0; 5]))
    }
}

fn rig_of(sequence: &str, lens: &PublishedLens) -> Value {
    let [fx, fy, cx, cy] = lens.k;
    json!({
        "name": format!("TUM RGB-D, {sequence}"),
        "scene_camera": {
            "image_size": VGA,
            "K": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            "lens_distortion": lens.distortion,
        },
    })
}

/// The size of the benchmark's pictures.
const VGA: [u32; 2] = [640, 480];

/// Returns whether the first picture is a PNG of the benchmark's size.
fn is_vga(folder: &Folder, plan: &Plan) -> bool {
    let first = plan.items.iter().find_map(|(_, item)| match item {
        Item::Picture { file, .. } => Some(file),
        _ => None,
    });
    let size = |file: &Path| {
        let bytes = folder.read(file).ok()?;
        let side = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
        // The size stands at the head of the first chunk, IHDR.
        let is_png = bytes.starts_with(b"\x89PNG\r\n\x1a\n");
        is_png.then_some(())?;
        Some([side(16)?, side(20)?])
    };
    first.and_then(|file| size(file)) == Some(VGA)
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
