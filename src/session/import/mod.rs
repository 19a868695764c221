//! `penumbra import`: converts a folder of pictures, time stamps and poses to a session.
//!
//! There are two layouts. The rig layout has `scene_timestamps.csv` and `scene/`, optionally
//! `env_timestamps.csv` and `env/`, `tracker_fastrak.txt` with its index, and `rig.json`,
//! `calibration/`, `object/` and `phantoms/`, which become attachments. The TUM RGB-D layout has
//! `rgb.txt` and `groundtruth.txt`, and gets a `rig.json` if it has none. Only those columns of tables are read that a driver would stamp.

mod error;
mod folder;
mod rig_folder;
mod tum_folder;

pub use error::ImportError;

use super::{Attachment, Camera, SessionError, SessionWriter};
use folder::Folder;
use penumbra_interface::{Frame, MonotonicTime, PixelFormat, PoseSample, RigidTransform};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Arguments of an import.
#[derive(Clone, Debug)]
pub struct ImportArgs {
    /// The folder to import.
    pub folder: PathBuf,
    /// The session to write.
    pub output: PathBuf,
    /// Overwrite `output`.
    pub force: bool,
}

/// Contents of an imported session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImportSummary {
    /// Number of pictures of the scene camera.
    pub scene_frames: usize,
    /// Number of pictures of the environment camera, including brackets.
    pub environment_frames: usize,
    /// Number of portions of tracker bytes.
    pub tracker_chunks: usize,
    /// Number of poses of a tracker that is not a byte stream.
    pub poses: usize,
    /// Number of attached files.
    pub attachments: usize,
    /// Where the lens of a TUM RGB-D folder comes from; `None` for a rig's folder.
    pub lens: Option<Lens>,
    /// Size of the session, bytes.
    pub bytes: u64,
}

/// Origin of the lens of a TUM RGB-D folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lens {
    /// The folder's `rig.json`.
    Stated,
    /// The benchmark's published values for these recordings: `freiburg1`, `freiburg2`,
    /// `freiburg3`, or `default`.
    Published {
        /// Name of the recordings.
        sequence: &'static str,
    },
    /// The pictures do not have the benchmark's size, and there is no `rig.json`.
    Unknown,
}

/// An item to be written. Pictures are read from the disk only when they are written.
#[derive(Clone, Debug)]
enum Item {
    Picture {
        camera: Camera,
        file: PathBuf,
        sequence: u64,
        bracket_ev: f64,
    },
    TrackerBytes {
        bytes: std::ops::Range<usize>,
    },
    Pose(PoseSample),
    View {
        frames: (String, String),
        pose: RigidTransform,
    },
}

/// Everything that is read from a layout.
#[derive(Debug, Default)]
struct Plan {
    attachments: Vec<(String, PathBuf)>,
    /// Attachments that the import writes: name, bytes.
    written: Vec<(String, Vec<u8>)>,
    lens: Option<Lens>,
    /// Items in any order; they are sorted by arrival before writing.
    items: Vec<(MonotonicTime, Item)>,
    tracker: Vec<u8>,
    calibrations: Vec<(Camera, foxglove::messages::CameraCalibration)>,
    /// Constant transforms, for viewers.
    fixed: Vec<((String, String), RigidTransform)>,
}

type FileWriter = SessionWriter<BufWriter<File>>;

/// Converts a folder to a session. The session appears under its name only when it is complete.
/// Calls `report` after each item with the share that is written (0 to 1).
///
/// # Errors
/// The folder has an unknown layout, something in it is missing or malformed, the output exists
/// (unless forced), or it cannot be written.
pub fn import(
    args: &ImportArgs,
    report: &mut dyn FnMut(f64),
) -> Result<ImportSummary, ImportError> {
    refuse_overwriting(args)?;
    let folder = Folder::open(&args.folder)?;
    let plan = read_plan(&folder, &args.folder)?;
    let partial = partial_path(&args.output);
    let summary = write_partial(&folder, plan, &partial, report).and_then(|summary| {
        refuse_overwriting(args)?;
        fs::rename(&partial, &args.output).map_err(|e| ImportError::io(&args.output, e))?;
        Ok(summary)
    });
    if summary.is_err() {
        // The first error is reported.
        let _ = fs::remove_file(&partial);
    }
    summary
}

/// Reads the files of a rig in `folder` that sessions have as attachments: `rig.json`, `calibration/`,
/// `object/`, `phantoms/`, as far as they exist.
///
/// # Errors
/// There is no such folder, or a file in it cannot be read.
pub fn attachments_in(folder: &Path) -> Result<Vec<Attachment>, ImportError> {
    let folder = Folder::open(folder)?;
    let read = |(name, file): (String, PathBuf)| {
        Ok(Attachment {
            data: folder.read(&file)?.into(),
            media_type: String::new(),
            name,
        })
    };
    rig_folder::attachments(&folder)?
        .into_iter()
        .map(read)
        .collect()
}

/// Reads a folder of either layout.
fn read_plan(folder: &Folder, path: &Path) -> Result<Plan, ImportError> {
    let path = path.to_owned();
    let plan = if folder.has("scene_timestamps.csv") {
        rig_folder::plan(folder)?
    } else if folder.has("rgb.txt") {
        tum_folder::plan(folder)?
    } else {
        return Err(ImportError::UnknownLayout { path });
    };
    let shows_scene = |(_, item): &(MonotonicTime, Item)| {
        matches!(
            item,
            Item::Picture {
                camera: Camera::Scene,
                ..
            }
        )
    };
    if plan.items.iter().any(shows_scene) {
        Ok(plan)
    } else {
        Err(ImportError::NoPictures { path })
    }
}

fn refuse_overwriting(args: &ImportArgs) -> Result<(), ImportError> {
    if !args.force && args.output.symlink_metadata().is_ok() {
        let path = args.output.clone();
        return Err(ImportError::Exists { path });
    }
    if args.output.is_dir() {
        let path = args.output.clone();
        return Err(ImportError::IsFolder { path });
    }
    Ok(())
}

/// Returns a name beside the output, so that renaming stays within the file system.
fn partial_path(output: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(output.file_name().unwrap_or_default());
    name.push(format!(".partial-{}", std::process::id()));
    output.with_file_name(name)
}

fn write_partial(
    folder: &Folder,
    mut plan: Plan,
    partial: &Path,
    report: &mut dyn FnMut(f64),
) -> Result<ImportSummary, ImportError> {
    // The sort is stable: at equal times the base exposure stays before its brackets.
    plan.items.sort_by_key(|(arrived_at, _)| *arrived_at);
    let all = plan.items.len() + plan.attachments.len();
    let mut done = 0;
    let mut advance = || {
        done += 1;
        report(f64::from(done) / all as f64);
    };
    let mut writer = SessionWriter::create(partial)?;
    let mut summary = ImportSummary {
        lens: plan.lens,
        ..ImportSummary::default()
    };
    for (name, bytes) in &plan.written {
        writer.attach(name, bytes)?;
        summary.attachments += 1;
    }
    for (name, file) in &plan.attachments {
        writer.attach(name, &folder.read(file)?)?;
        summary.attachments += 1;
        advance();
    }
    write_views(&mut writer, &plan)?;
    for (arrived_at, item) in &plan.items {
        write_item(&mut writer, folder, &plan.tracker, *arrived_at, item)?;
        summary.count(item);
        advance();
    }
    let file = writer.finish()?;
    file.get_ref()
        .sync_all()
        .map_err(|e| ImportError::io(partial, e))?;
    let metadata = fs::metadata(partial).map_err(|e| ImportError::io(partial, e))?;
    summary.bytes = metadata.len();
    Ok(summary)
}

/// Writes calibrations and constant transforms at the time of the first item.
fn write_views(writer: &mut FileWriter, plan: &Plan) -> Result<(), SessionError> {
    let Some((start, _)) = plan.items.first() else {
        return Ok(());
    };
    for (camera, calibration) in &plan.calibrations {
        writer.view_calibration(*camera, calibration, *start)?;
    }
    for ((parent, child), pose) in &plan.fixed {
        writer.view_transform((parent, child), *pose, *start)?;
    }
    Ok(())
}

fn write_item(
    writer: &mut FileWriter,
    folder: &Folder,
    tracker: &[u8],
    arrived_at: MonotonicTime,
    item: &Item,
) -> Result<(), ImportError> {
    match item {
        Item::Picture {
            camera,
            file,
            sequence,
            bracket_ev,
        } => {
            let frame = Frame {
                data: folder.read(file)?.into(),
                format: picture_format(file)?,
                width: 0,
                height: 0,
                stride: 0,
                sequence: *sequence,
                captured_at: arrived_at,
                arrived_at,
                exposure: None,
                bracket_ev: *bracket_ev,
                controls: None,
            };
            writer.frame(*camera, &frame)?;
        }
        Item::TrackerBytes { bytes } => {
            let bytes = tracker.get(bytes.clone()).unwrap_or_default();
            writer.tracker_bytes("fastrak", bytes, arrived_at)?;
        }
        Item::Pose(sample) => writer.pose(sample)?,
        Item::View { frames, pose } => {
            writer.view_transform((&frames.0, &frames.1), *pose, arrived_at)?;
        }
    }
    Ok(())
}

/// Returns the format by the file's extension.
fn picture_format(file: &Path) -> Result<PixelFormat, ImportError> {
    let ending = file.extension().map(|e| e.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("jpg" | "jpeg") => Ok(PixelFormat::Jpeg),
        Some("png") => Ok(PixelFormat::Png),
        _ => Err(ImportError::PictureFormat {
            path: file.to_owned(),
        }),
    }
}

impl ImportSummary {
    fn count(&mut self, item: &Item) {
        match item {
            Item::Picture {
                camera: Camera::Scene,
                ..
            } => self.scene_frames += 1,
            Item::Picture { .. } => self.environment_frames += 1,
            Item::TrackerBytes { .. } => self.tracker_chunks += 1,
            Item::Pose(_) => self.poses += 1,
            Item::View { .. } => {}
        }
    }
}

#[cfg(test)]
mod tests;
