//! Refines the scene camera's lens by its views of flat, mapped markers while a live rig runs. The
//! views of a camera that moves are those of a calibration board.
//!
//! The thread `lens` keeps the views that differ from the others, estimates the lens when there are
//! a quarter more of them, and passes on a lens that is clearly more certain than the one in use.

use crate::calibration_runner::files::calibration_folder;
use crate::error::RigError;
use crate::setup::RigSetup;
use crate::source::Source;
use crate::viewed::{FoundLens, RefinedLens};
use crate::wall_date::iso_now;
use crossbeam_channel::{Receiver, Sender, bounded};
use glam::DVec2;
use penumbra_calibration::intrinsics::{
    Board, Correspondence, LensModel, Options, Outcome, PictureResult, ViewCollector,
};
use penumbra_camera::PinholeCamera;
use penumbra_config::{Config, PoseSource};
use penumbra_fiducials::{Family, Tag, TagMap, TagObservation};
use penumbra_interface::threads;
use penumbra_picture::write_whole;
use penumbra_rig_model::Grade;
use penumbra_rig_model::lens_files::SCENE_LENS;
use penumbra_rig_model::lens_record::LensRecord;
use penumbra_status::{LensSource, LensStatus};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// The lens file's `source` of a lens that was refined here.
pub const REFINED_SOURCE: &str = "views of the markers while the rig ran";
/// Maximum distance of a marker's corner from the plane z = 0, metres.
const FLATNESS: f64 = 1e-5;
/// Maximum mean motion of the corners between two pictures, as a share of the picture's width: the
/// corners of faster ones are blurred, and skewed by a rolling shutter.
const STILL: f64 = 0.006;
/// Views with which the first lens is estimated.
const FIRST_VIEWS: usize = 8;
/// Growth of the number of views after which the lens is estimated again.
const GROWTH: f64 = 1.25;
/// A lens replaces another one if its uncertainty is below this share of the other's.
const BETTER: f64 = 0.8;
/// Pictures that wait for the thread; more are dropped.
const QUEUE: usize = 4;

/// Number of a marker in its family.
type Key = (Family, u32);

/// The thread that refines the lens, and what it has found.
pub(crate) struct LensRefiner {
    /// Corners of the markers on the board: +X right, +Y down, metres.
    corners: BTreeMap<Key, [DVec2; 4]>,
    size: (u32, u32),
    /// Middles of the markers in the previous picture.
    last: BTreeMap<Key, DVec2>,
    views: Option<Sender<Vec<Correspondence>>>,
    found: Arc<Mutex<Found>>,
    thread: Option<JoinHandle<()>>,
}

/// What the thread has found.
#[derive(Clone, Debug, Default)]
struct Found {
    /// A lens that is not in use yet.
    camera: Option<PinholeCamera>,
    status: LensStatus,
}

impl LensRefiner {
    /// Starts the thread; `None` if the lens is not to be refined: in a replay, without flat
    /// markers, and if it was calibrated in another way.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(
        setup: &RigSetup,
        config: &Config,
        source: &Source,
    ) -> Result<Option<Self>, RigError> {
        let status = lens_status(setup, source);
        let wanted = config.registration.refine_lens
            && source.is_live()
            && setup.pose == PoseSource::Markers
            && status.source != LensSource::Calibrated;
        let Some(corners) = setup
            .tags
            .as_ref()
            .and_then(flat_corners)
            .filter(|_| wanted)
        else {
            return Ok(None);
        };
        let camera = &setup.calibration.scene_camera.camera;
        let found = Arc::new(Mutex::new(Found {
            camera: None,
            status: LensStatus {
                refining: true,
                ..status
            },
        }));
        let (views, waiting) = bounded(QUEUE);
        let worker = Worker {
            size: (camera.width, camera.height),
            collector: ViewCollector::new(NO_BOARD),
            estimated: 0,
            uncertainty: uncertainty_of_file(source),
            file: calibration_folder(config)
                .ok()
                .map(|folder| folder.join(SCENE_LENS)),
            found: Arc::clone(&found),
            recorded: match source {
                Source::Live(live) => Arc::clone(&live.contents.refined_lens),
                Source::Recorded(_) => Arc::default(),
            },
        };
        let thread = threads::spawn_background("lens", move || worker.run(&waiting))
            .map_err(|source| RigError::Thread { source })?;
        Ok(Some(Self {
            corners,
            size: (camera.width, camera.height),
            last: BTreeMap::new(),
            views: Some(views),
            found,
            thread: Some(thread),
        }))
    }

    /// Passes on the markers of a picture, if the camera hardly moves.
    pub fn look(&mut self, seen: &[TagObservation]) {
        let middles: BTreeMap<Key, DVec2> = seen
            .iter()
            .map(|tag| {
                (
                    (tag.family, tag.id),
                    tag.corners.iter().sum::<DVec2>() / 4.0,
                )
            })
            .collect();
        let before = std::mem::replace(&mut self.last, middles);
        let moved: Vec<f64> = self
            .last
            .iter()
            .filter_map(|(key, at)| Some(at.distance(*before.get(key)?)))
            .collect();
        let mean = moved.iter().sum::<f64>() / moved.len().max(1) as f64;
        if moved.is_empty() || mean > STILL * f64::from(self.size.0) {
            return;
        }
        let points: Vec<Correspondence> = seen
            .iter()
            .filter_map(|tag| Some((self.corners.get(&(tag.family, tag.id))?, tag)))
            .flat_map(|(points, tag)| points.iter().zip(tag.corners))
            .map(|(&point, pixel)| Correspondence { point, pixel })
            .collect();
        if let Some(views) = &self.views {
            // A picture that does not fit is dropped; the next one shows nearly the same.
            let _ = views.try_send(points);
        }
    }

    /// Returns a new lens, once.
    pub fn take_lens(&self) -> Option<PinholeCamera> {
        lock(&self.found).camera.take()
    }

    /// Returns the status of the lens.
    pub fn status(&self) -> LensStatus {
        lock(&self.found).status.clone()
    }
}

impl Drop for LensRefiner {
    fn drop(&mut self) {
        self.views = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A poisoned lock is still used: what is known of the lens stays valid.
fn lock(found: &Mutex<Found>) -> MutexGuard<'_, Found> {
    found.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The collector searches no pictures here.
const NO_BOARD: Board = Board::Chess {
    columns: 3,
    rows: 3,
    square: 0.01,
};

/// Returns the corners of the markers in the plane z = 0 as on a board that is seen from +Z; `None`
/// if one of them lies elsewhere.
fn flat_corners(map: &TagMap) -> Option<BTreeMap<Key, [DVec2; 4]>> {
    let all = map.tags().iter();
    let is_flat = |tag: &Tag| tag.corners().iter().all(|c| c.z.abs() < FLATNESS);
    let corners = all.clone().map(|tag| {
        let on_board = tag.corners().map(|c| DVec2::new(c.x, -c.y));
        ((tag.family, tag.id), on_board)
    });
    all.clone().all(is_flat).then(|| corners.collect())
}

/// Returns the present lens's record, if it has one.
fn record(source: &Source) -> Option<LensRecord> {
    LensRecord::parse(SCENE_LENS, source.attachment(SCENE_LENS)?).ok()
}

fn uncertainty_of_file(source: &Source) -> f64 {
    let quality = record(source).and_then(|record| record.quality);
    quality.map_or(f64::INFINITY, |quality| quality.projection_sigma[0])
}

/// Returns the field of view across the picture, degrees.
fn field_of_view(camera: &PinholeCamera) -> f64 {
    let half = (0.5 * f64::from(camera.width) / camera.focal.x).atan();
    2.0 * half.to_degrees()
}

/// Returns the status of a lens that is not refined.
pub(crate) fn lens_status(setup: &RigSetup, source: &Source) -> LensStatus {
    let record = record(source);
    let camera = &setup.calibration.scene_camera.camera;
    LensStatus {
        source: match &record {
            None => LensSource::Assumed,
            Some(record) if record.source == REFINED_SOURCE => LensSource::Refined,
            Some(_) => LensSource::Calibrated,
        },
        field_of_view_deg: Some(field_of_view(camera)),
        views: record
            .as_ref()
            .and_then(|r| r.quality.as_ref())
            .map_or(0, |quality| quality.views[0] as u32),
        ..LensStatus::default()
    }
}

/// The state of the thread.
struct Worker {
    size: (u32, u32),
    collector: ViewCollector,
    /// Number of views of the last estimate.
    estimated: usize,
    /// Uncertainty of the lens in use: median of the picture, pixels.
    uncertainty: f64,
    /// The lens file; `None` if the rig has no folder.
    file: Option<PathBuf>,
    found: Arc<Mutex<Found>>,
    /// What recordings state.
    recorded: Arc<RefinedLens>,
}

impl Worker {
    fn run(mut self, waiting: &Receiver<Vec<Correspondence>>) {
        for points in waiting {
            let added = self.collector.add_points("marker view", self.size, points);
            if !matches!(added, PictureResult::Added { .. }) {
                continue;
            }
            let count = self.collector.views().len();
            let mut found = lock(&self.found);
            if found.status.source == LensSource::Assumed {
                found.status.views = count as u32;
            }
            drop(found);
            if count >= FIRST_VIEWS && count as f64 >= GROWTH * self.estimated as f64 {
                self.estimated = count;
                self.estimate();
            }
        }
    }

    /// Estimates the lens from the views so far, and passes it on if it is better.
    fn estimate(&mut self) {
        let outcome = self.collector.finish(&Options {
            model: LensModel::Brown,
            square_pixels: true,
        });
        let hint = outcome.assessment.hints.first();
        lock(&self.found).status.hint = hint.map(|hint| in_words(hint));
        if outcome.assessment.grade == Grade::Refused {
            return;
        }
        let Some(assessed) = &outcome.result else {
            return;
        };
        let uncertainty = assessed.uncertainty.median;
        let Some(camera) = assessed.estimate.lens.as_pinhole() else {
            return;
        };
        // Not a number is not better.
        let is_better = uncertainty < BETTER * self.uncertainty;
        if !is_better {
            return;
        }
        self.uncertainty = uncertainty;
        let used = assessed.estimate.views.iter().filter(|v| v.used).count();
        let mut found = lock(&self.found);
        found.status.source = LensSource::Refined;
        found.status.field_of_view_deg = Some(field_of_view(&camera));
        found.status.views = used as u32;
        found.status.reprojection_px = Some(assessed.estimate.rms);
        found.status.focal_sigma_percent =
            Some(100.0 * assessed.estimate.sigma[0] / camera.focal.x);
        found.camera = Some(camera.clone());
        drop(found);
        if let Some(file) = calibration_file(&outcome) {
            self.keep(&file);
            self.recorded.set(FoundLens { camera, file });
        }
    }

    /// Writes the lens beside the rig's calibration.
    fn keep(&mut self, file: &str) {
        if let Some(path) = &self.file
            && let Err(error) = write(path, file)
        {
            tracing::warn!("{}: the lens cannot be kept ({error})", path.display());
            self.file = None;
        }
    }
}

/// Returns the lens's calibration file.
fn calibration_file(outcome: &Outcome) -> Option<String> {
    let record = outcome.record("scene", "markers of the rig", iso_now())?;
    let record = LensRecord {
        source: REFINED_SOURCE.to_owned(),
        ..record
    };
    let text = serde_json::to_string_pretty(&record).ok()?;
    Some(text + "\n")
}

fn write(path: &Path, text: &str) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    write_whole(path, |part| std::fs::write(part, text))
}

/// Returns a hint for a printed board in the words of a sheet that lies on a table.
fn in_words(hint: &str) -> String {
    hint.replace("cover the", "show the sheet in the")
        .replace("tilt the board", "tilt the camera or the sheet")
}

#[cfg(test)]
mod tests;
