//! Lets frames flow through the compositor to the outputs: those of a recording, or those
//! of a live rig.

use crate::context::{RunContext, RunOptions};
use crate::display::DisplayLatency;
use crate::error::RigError;
use crate::light::updates::SceneUpdates;
use crate::notify::Notifier;
use crate::poses::PoseFile;
use crate::prepare::{Preparation, PreparationEvent, PreparationInputs};
use crate::report::Report;
use crate::run::{Outlets, Run};
use crate::setup::RigSetup;
use crate::source::Source;
use penumbra_compositor::Gpu;
use penumbra_config::Config;
use penumbra_output::Screen;
use penumbra_output::files::FrameFolder;
use penumbra_status::SharedStatus;
use penumbra_tracker_serial::freed::FreedSender;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Runs a rig from its source to its outputs.
pub struct Runner(RunContext);

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
        Ok(Self(RunContext {
            config,
            options,
            source,
            setup,
            status,
            shutdown,
        }))
    }

    /// Returns width and height of the composed pictures, pixels.
    #[must_use]
    pub const fn picture_size(&self) -> (u32, u32) {
        self.0.picture_size()
    }

    /// Runs to the end of the recording, the frame limit, or the shutdown.
    ///
    /// # Errors
    /// See [`RigError`]. A damaged picture is counted and left out.
    pub fn run(self, gpu: Gpu, screen: Option<Box<dyn Screen>>) -> Result<Report, RigError> {
        let context = &self.0;
        let folder = match &context.config.output.frames {
            Some(path) => Some(FrameFolder::create(path, context.options.force)?),
            None => None,
        };
        let poses = context.options.poses.as_deref();
        let poses = poses.map(|path| PoseFile::create(path, context.options.force));
        let poses = poses.transpose()?;
        let pose_out = context.config.output.freed.map(pose_sender).transpose()?;
        let news = SceneUpdates::default();
        let handing = Arc::<DisplayLatency>::default();
        let told = PreparationInputs {
            wished: context.status.settings_receiver(),
            news: news.clone(),
            handing: handing.clone(),
        };
        let stop = context.shutdown.clone();
        let preparation =
            Preparation::start_with(&context.setup, &context.config, &context.source, told, stop)?;
        // Only now is there somebody to take what they deliver.
        if let Source::Live(live) = &context.source {
            live.open()?;
        }
        crate::status::begin(&context.status, &context.source, &context.setup, &gpu);
        let mut notifier = Notifier::new();
        let outlets = Outlets {
            screen,
            folder,
            pose_out,
            poses,
            handing,
        };
        let mut run = Run::new(context, gpu, outlets, news)?;
        while !run.is_over(context) {
            let Some(step) = preparation.next() else {
                break;
            };
            match step {
                PreparationEvent::Frame(prepared) => {
                    run.compose(context, &prepared)?;
                    preparation.give_back(prepared.picture);
                }
                PreparationEvent::Skipped => run.frames.skipped += 1,
                PreparationEvent::Damaged => run.frames.damaged += 1,
                PreparationEvent::Idle(counts) => run.idle(context, &counts)?,
                PreparationEvent::End(counts) => run.finish_loop(context, &counts),
            }
            notifier.turn(|| sentence(context));
        }
        drop(preparation);
        run.into_report(context)
    }
}

/// Returns the one-line state of the run for the service manager.
fn sentence(context: &RunContext) -> String {
    let snapshot = context.status.snapshot();
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

/// Who tells poses to virtual-production tools, as camera 1.
fn pose_sender(receiver: SocketAddr) -> Result<FreedSender, RigError> {
    FreedSender::new(receiver, 1).map_err(|source| RigError::Freed { receiver, source })
}
