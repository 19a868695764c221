//! The rig layout: pictures, FASTRAK bytes, calibration and objects.

use super::folder::Folder;
use super::{Camera, ImportError, Item, Plan};
use crate::messages;
use crate::views::{self, ViewedRig};
use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_tracker_serial::fastrak::{Decoder, Format};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders that are attached. Other folders, such as ground truth, are not.
const ATTACHED_FOLDERS: [&str; 3] = ["calibration", "object", "phantoms"];
const RIG: &str = "rig.json";
const TRACKER: &str = "tracker_fastrak.txt";
const TRACKER_INDEX: &str = "tracker_fastrak_index.csv";

pub(super) fn plan(folder: &Folder) -> Result<Plan, ImportError> {
    let mut plan = Plan {
        attachments: attachments(folder)?,
        ..Plan::default()
    };
    pictures(folder, Camera::Scene, "scene_timestamps.csv", &mut plan)?;
    if folder.has("env_timestamps.csv") {
        pictures(folder, Camera::Environment, "env_timestamps.csv", &mut plan)?;
    }
    let rig = rig(folder)?;
    if folder.has(TRACKER) {
        tracker(folder, &mut plan)?;
        view_tracker(&rig, &mut plan);
    }
    view_rig(&rig, &mut plan);
    Ok(plan)
}

pub(super) fn attachments(folder: &Folder) -> Result<Vec<(String, PathBuf)>, ImportError> {
    let mut files = Vec::new();
    if folder.has(RIG) {
        files.push(PathBuf::from(RIG));
    }
    for name in ATTACHED_FOLDERS {
        let below = folder.files_below(name)?;
        files.extend(below.into_iter().filter(|file| !is_leftover(file)));
    }
    Ok(files
        .into_iter()
        .map(|file| (slashed(&file), file))
        .collect())
}

/// Returns whether a file of `calibration/` is not a calibration: a report, an earlier calibration
/// (`tracker.20261121T120203Z.json`) or an incomplete file.
fn is_leftover(file: &Path) -> bool {
    if !file.starts_with("calibration") {
        return false;
    }
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let is_dated = |stem: &str| {
        let date = stem.rsplit_once('.').map_or("", |(_, date)| date);
        let (day, time) = date.split_once('T').unwrap_or_default();
        let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        digits(day) == 8 && day.len() == 8 && digits(time) == 6 && time[6..].starts_with('Z')
    };
    let is_earlier = name.strip_suffix(".json").is_some_and(is_dated);
    is_earlier || name.ends_with(".html") || name.starts_with('.')
}

/// Returns a relative path with `/` as separator.
fn slashed(path: &Path) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts.join("/")
}

/// Adds the pictures of one camera, each followed by its brackets.
fn pictures(
    folder: &Folder,
    camera: Camera,
    table: &str,
    plan: &mut Plan,
) -> Result<(), ImportError> {
    let text = folder.text(table)?;
    let brackets = brackets(folder, &text, table)?;
    for (line, [frame, file, stamp]) in
        folder.table(table, &text, ["frame", "file", "timestamp_ns"])?
    {
        let arrived_at = folder.nanos(table, line, &stamp)?;
        let sequence = frame
            .parse()
            .map_err(|_| folder.line(table, line, &format!("{frame:?} is no frame number")))?;
        let file = PathBuf::from(file);
        if !folder.lists(&file)? {
            let reason = format!("{} does not exist", file.display());
            return Err(folder.line(table, line, &reason));
        }
        let of_this = brackets.get(&file.with_extension("")).into_iter().flatten();
        let all = std::iter::once((0.0, file.clone())).chain(of_this.cloned());
        plan.items.extend(all.map(|(bracket_ev, file)| {
            let picture = Item::Picture {
                camera,
                file,
                sequence,
                bracket_ev,
            };
            (arrived_at, picture)
        }));
    }
    Ok(())
}

type Brackets = BTreeMap<PathBuf, Vec<(f64, PathBuf)>>;

/// Finds brackets such as `env/00000_ev-4.jpg` by their base `env/00000`, brightest first.
fn brackets(folder: &Folder, text: &str, table: &str) -> Result<Brackets, ImportError> {
    let mut parents = BTreeSet::new();
    for (_, [file]) in folder.table(table, text, ["file"])? {
        parents.extend(Path::new(&file).parent().map(Path::to_owned));
    }
    let mut brackets = Brackets::new();
    for parent in parents {
        for file in folder.files_in(&parent)? {
            if let Some((base, ev)) = bracket_of(&file) {
                brackets.entry(base).or_default().push((ev, file));
            }
        }
    }
    for of_base in brackets.values_mut() {
        of_base.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    }
    Ok(brackets)
}

/// Returns the base exposure (without extension) and the stops of a bracket's file.
fn bracket_of(file: &Path) -> Option<(PathBuf, f64)> {
    let name = slashed(&file.with_extension(""));
    let (base, ev) = name.rsplit_once("_ev")?;
    let ev: f64 = ev.parse().ok()?;
    ev.is_finite().then(|| (PathBuf::from(base), ev))
}

/// Adds the tracker's bytes, split into portions by the arrivals in the index.
fn tracker(folder: &Folder, plan: &mut Plan) -> Result<(), ImportError> {
    let bytes = folder.read(Path::new(TRACKER))?;
    let text = folder.text(TRACKER_INDEX)?;
    let mut chunks: Vec<(usize, MonotonicTime)> = Vec::new();
    for (line, [offset, arrival]) in
        folder.table(TRACKER_INDEX, &text, ["byte_offset", "arrival_ns"])?
    {
        let arrived_at = folder.nanos(TRACKER_INDEX, line, &arrival)?;
        let after = chunks.last().map_or(0, |(start, _)| *start);
        let start = offset
            .parse()
            .ok()
            .filter(|start| (after..=bytes.len()).contains(start))
            .ok_or_else(|| {
                let reason = format!("byte offset {offset} is not within {TRACKER}, or goes back");
                folder.line(TRACKER_INDEX, line, &reason)
            })?;
        chunks.push((start, arrived_at));
    }
    let ends: Vec<usize> = chunks.iter().skip(1).map(|(start, _)| *start).collect();
    let ends = ends.into_iter().chain([bytes.len()]);
    for ((start, arrived_at), end) in chunks.into_iter().zip(ends) {
        let bytes = start..end;
        plan.items.push((arrived_at, Item::TrackerBytes { bytes }));
    }
    plan.tracker = bytes;
    Ok(())
}

/// Reads `rig.json`. Only the values for viewers are used here; replay checks the rest.
pub(super) fn rig(folder: &Folder) -> Result<Value, ImportError> {
    if !folder.has(RIG) {
        return Ok(Value::Null);
    }
    let text = folder.text(RIG)?;
    serde_json::from_str(&text).map_err(|error| ImportError::Rig {
        path: folder.path(RIG),
        reason: error.to_string(),
    })
}

/// Adds poses for viewers, decoded from the tracker's bytes.
fn view_tracker(rig: &Value, plan: &mut Plan) {
    if rig.is_null() {
        return;
    }
    let mut decoder = Decoder::new(Format {
        metres_per_unit: views::metres_per_unit(rig),
        ..Format::default()
    });
    let mut views = Vec::new();
    for (arrived_at, item) in &plan.items {
        if let Item::TrackerBytes { bytes } = item {
            let bytes = plan.tracker.get(bytes.clone()).unwrap_or_default();
            decoder.push(bytes, *arrived_at, |sample| views.push(view(&sample)));
        }
    }
    plan.items.extend(views);
}

fn view(sample: &PoseSample) -> (MonotonicTime, Item) {
    let frames = ("tracker".to_owned(), messages::sensor_frame(sample.station));
    let pose = sample.transmitter_from_sensor;
    (sample.arrived_at, Item::View { frames, pose })
}

/// Adds calibrations and constant transforms for viewers, as far as `rig.json` has them.
pub(super) fn view_rig(rig: &Value, plan: &mut Plan) {
    let viewed = ViewedRig::from_rig_json(rig);
    let start = plan.items.iter().map(|(arrived_at, _)| *arrived_at).min();
    if let Some(stamp) = start.and_then(messages::timestamp) {
        plan.calibrations.extend(viewed.calibrations(stamp));
    }
    plan.fixed.extend(viewed.fixed);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attaches_calibrations_without_reports_and_backups() {
        for left in [
            "calibration/tracker.html",
            "calibration/tracker.refused.html",
            "calibration/tracker.20261121T120203Z.json",
            "calibration/tracker.20261121T120203Z-2.json",
            "calibration/checks/20261121-120203.html",
            "calibration/.tracker.json.part",
        ] {
            assert!(is_leftover(Path::new(left)), "{left}");
        }
        for carried in [
            "rig.json",
            "object/a.20261121T120203Z.json",
            "object/page.html",
            "calibration/tracker.json",
            "calibration/my.lens.json",
            "calibration/checks/20261121-120203.json",
            "calibration/scene_chart.jpg",
        ] {
            assert!(!is_leftover(Path::new(carried)), "{carried}");
        }
    }
}
