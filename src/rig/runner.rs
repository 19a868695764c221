//! Lets frames flow through the compositor to the outputs: those of a recording, or those
//! of a live rig.

use super::display::Handing;
use super::lighter::SceneNews;
use super::notify::Notifier;
use super::poses::PoseFile;
use super::prepare::{Preparation, Step, Told};
use super::report::Report;
use super::run::{Outlets, Run};
use super::source::Source;
use super::{RigError, RigSetup};
use penumbra_compositor::Gpu;
use penumbra_config::Config;
use penumbra_output::Screen;
use penumbra_output::files::FrameFolder;
use penumbra_status::SharedStatus;
use penumbra_tracker_serial::freed::FreedSender;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What was asked for, beyond the configuration.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Stop after so many frames.
    pub frame_limit: Option<u64>,
    /// Write over frames that are there.
    pub force: bool,
    /// Write the pose of each picture into this file.
    pub poses: Option<PathBuf>,
}

/// Everything that a run needs.
pub struct Runner {
    pub(super) config: Config,
    pub(super) options: RunOptions,
    pub(super) source: Source,
    pub(super) setup: RigSetup,
    pub(super) status: Arc<SharedStatus>,
    pub(super) shutdown: Arc<AtomicBool>,
}

impl Runner {
    /// Reads what belongs to the rig and checks everything that can be checked before the
    /// first frame.
    ///
    /// # Errors
    /// See [`RigError`].
    pub fn new(
        source: Source,
        config: Config,
        options: RunOptions,
        status: Arc<SharedStatus>,
        shutdown: Arc<AtomicBool>,
    ) -> Result<Self, RigError> {
        let setup = RigSetup::read(&source, &config)?;
        Ok(Self {
            config,
            options,
            source,
            setup,
            status,
            shutdown,
        })
    }

    /// Width and height of the pictures to come, pixels.
    #[must_use]
    pub fn picture_size(&self) -> (u32, u32) {
        let camera = &self.setup.calibration.scene_camera.camera;
        (camera.width, camera.height)
    }

    /// Runs to the end of the recording, the frame limit, or the shutdown.
    ///
    /// # Errors
    /// See [`RigError`]. A damaged picture is counted and left out.
    pub fn run(self, gpu: Gpu, screen: Option<Box<dyn Screen>>) -> Result<Report, RigError> {
        let folder = match &self.config.output.frames {
            Some(path) => Some(FrameFolder::create(path, self.options.force)?),
            None => None,
        };
        let poses = self.options.poses.as_deref();
        let poses = poses.map(|path| PoseFile::create(path, self.options.force));
        let poses = poses.transpose()?;
        let pose_out = self.config.output.freed.map(pose_sender).transpose()?;
        let news = SceneNews::default();
        let handing = Arc::<Handing>::default();
        let told = Told {
            wished: self.status.settings_receiver(),
            news: news.clone(),
            handing: handing.clone(),
        };
        let stop = self.shutdown.clone();
        let preparation =
            Preparation::start_with(&self.setup, &self.config, &self.source, told, stop)?;
        // Only now is there somebody to take what they deliver.
        if let Source::Live(live) = &self.source {
            live.open()?;
        }
        super::status::begin(&self.status, &self.source, &self.setup, &gpu);
        let mut notifier = Notifier::new();
        let outlets = Outlets {
            screen,
            folder,
            pose_out,
            poses,
            handing,
        };
        let mut run = Run::new(&self, gpu, outlets, news)?;
        while !run.over(&self) {
            let Some(step) = preparation.next() else {
                break;
            };
            match step {
                Step::Frame(prepared) => {
                    run.compose(&self, &prepared)?;
                    preparation.give_back(prepared.picture);
                }
                Step::Skipped => run.frames.skipped += 1,
                Step::Damaged => run.frames.damaged += 1,
                Step::Idle(counts) => run.idle(&self, &counts)?,
                Step::End(counts) => run.finish_loop(&self, &counts),
            }
            notifier.turn(|| self.sentence());
        }
        drop(preparation);
        run.into_report(&self)
    }

    /// How it goes, in a line.
    fn sentence(&self) -> String {
        let snapshot = self.status.snapshot();
        let devices = snapshot.devices.iter();
        let troubled: Vec<_> = devices
            .filter_map(|d| Some(format!("{}: {}", d.kind.label(), d.reason.as_ref()?)))
            .collect();
        let rate = snapshot.frames.per_second;
        if troubled.is_empty() {
            format!("{rate:.1} frames/s")
        } else {
            format!("{rate:.1} frames/s; {}", troubled.join("; "))
        }
    }

    /// Asked to end.
    pub(super) fn is_over(&self) -> bool {
        self.shutdown.load(Ordering::Relaxed)
    }
}

/// Who tells poses to virtual-production tools, as camera 1.
fn pose_sender(receiver: SocketAddr) -> Result<FreedSender, RigError> {
    FreedSender::new(receiver, 1).map_err(|source| RigError::Freed { receiver, source })
}
