//! The inputs of one run, shared by its components.

use crate::setup::RigSetup;
use crate::source::Source;
use penumbra_config::{Config, ReplaySpeed};
use penumbra_status::SharedStatus;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Options of a run beyond the configuration.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Maximum number of composed frames.
    pub frame_limit: Option<u64>,
    /// Whether existing frame files may be overwritten.
    pub force: bool,
    /// The file to which the pose of each picture is written.
    pub poses: Option<PathBuf>,
}

/// The inputs of a run.
pub(crate) struct RunContext {
    pub config: Config,
    pub options: RunOptions,
    pub source: Source,
    pub setup: RigSetup,
    pub status: Arc<SharedStatus>,
    pub shutdown: Arc<AtomicBool>,
}

impl RunContext {
    /// Returns width and height of the composed pictures, pixels.
    pub const fn picture_size(&self) -> (u32, u32) {
        let camera = &self.setup.calibration.scene_camera.camera;
        (camera.width, camera.height)
    }

    /// Returns whether a recording is replayed as fast as possible.
    pub fn is_unhurried(&self) -> bool {
        let is_recorded = matches!(self.source, Source::Recorded(_));
        is_recorded && self.config.replay.speed == ReplaySpeed::Max
    }

    /// Returns whether the program has been asked to end.
    pub fn is_shutting_down(&self) -> bool {
        self.shutdown.load(Ordering::Relaxed)
    }
}
