//! Runs a recording or a live rig: composes its frames and passes them to the outputs.

use crate::context::{RunContext, RunOptions};
use crate::display::DisplayLatency;
use crate::error::RigError;
use crate::light::updates::SceneUpdates;
use crate::notify::Notifier;
use crate::poses::PoseFile;
use crate::prepare::{Preparation, PreparationEvent, PreparationInputs};
use crate::report::Report;
use crate::run::{Outputs, Run};
use crate::setup::RigSetup;
use crate::source::Source;
use penumbra_compositor::{Gpu, GpuError};
use penumbra_config::Config;
use penumbra_output::Screen;
use penumbra_output::files::FrameFolder;
use penumbra_status::SharedStatus;
use penumbra_tracker_serial::freed::FreedSender;
use std::net::SocketAddr;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Runs a rig from its source to its outputs.
pub struct Runner(RunContext);

impl Runner {
    /// Reads the calibration and scene of the rig and checks the configuration.
    ///
    /// # Errors
    /// The calibration, an object or the scene file is missing or invalid; see [`RigError`].
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

    /// Runs until the end of the recording, the frame limit or shutdown. Skips and counts damaged
    /// pictures.
    ///
    /// # Errors
    /// An output cannot be created or written, the compositor fails, the recording has no picture,
    /// or the system cannot start a thread; see [`RigError`].
    pub fn run(self, gpu: Gpu, screen: Option<Box<dyn Screen>>) -> Result<Report, RigError> {
        let context = &self.0;
        check_lights(&gpu, context.config.environment.light_count)?;
        let folder = match &context.config.output.frames {
            Some(path) => Some(FrameFolder::create(path, context.options.force)?),
            None => None,
        };
        let poses = context.options.poses.as_deref();
        let poses = poses.map(|path| PoseFile::create(path, context.options.force));
        let poses = poses.transpose()?;
        let pose_out = context.config.output.freed.map(pose_sender).transpose()?;
        crate::playback::open(context);
        let display_latency = Arc::<DisplayLatency>::default();
        let inputs = PreparationInputs {
            requested: context.status.settings_receiver(),
            playback: context.status.playback_receiver(),
            scene_updates: SceneUpdates::default(),
            display_latency: display_latency.clone(),
        };
        let outputs = Outputs {
            screen,
            folder,
            pose_out,
            poses,
            display_latency,
        };
        let (preparation, mut run) = start(context, &gpu, inputs, outputs)?;
        // The devices are opened only when the preparation can take their deliveries.
        if let Source::Live(live) = &context.source {
            live.open()?;
        }
        crate::status::begin(
            &context.status,
            &context.source,
            (
                &context.setup,
                crate::status::guide(&context.setup, &context.config),
            ),
            (&gpu, context.config.picture.quality),
        );
        let mut notifier = Notifier::new();
        while !run.is_over(context) {
            if run.hold(context)? {
                notifier.turn(|| status_line(context));
                continue;
            }
            let Some(event) = preparation.next() else {
                break;
            };
            handle(event, context, &mut run, &preparation)?;
            notifier.turn(|| status_line(context));
        }
        drop(preparation);
        run.into_report(context)
    }
}

/// Starts the preparation and creates the compositor, at the same time: the tables of the light
/// take about as long as the passes and the scene.
fn start(
    context: &RunContext,
    gpu: &Gpu,
    inputs: PreparationInputs,
    outputs: Outputs,
) -> Result<(Preparation, Run), RigError> {
    let scene_updates = inputs.scene_updates.clone();
    let prepare = || {
        let RunContext { setup, config, .. } = context;
        let stop = context.shutdown.clone();
        Preparation::start_with(setup, config, &context.source, inputs, stop)
    };
    std::thread::scope(|scope| {
        let starting = std::thread::Builder::new()
            .name("start".to_owned())
            .spawn_scoped(scope, prepare)
            .map_err(|source| RigError::Thread { source })?;
        let run = Run::new(context, gpu.clone(), outputs, scene_updates)?;
        let preparation = starting.join();
        Ok((
            preparation.unwrap_or_else(|panic| resume_unwind(panic))?,
            run,
        ))
    })
}

/// Composes a prepared frame, or counts why there is none.
fn handle(
    event: PreparationEvent,
    context: &RunContext,
    run: &mut Run,
    preparation: &Preparation,
) -> Result<(), RigError> {
    match event {
        PreparationEvent::Frame(prepared) => {
            if !crate::playback::is_current(&context.status, prepared.jumps) {
                preparation.give_back(prepared.picture);
                return Ok(());
            }
            run.check_size(context, &prepared)?;
            run.compose(context, &prepared)?;
            if let Some(done) = run.keep(context, prepared) {
                preparation.give_back(done.picture);
            }
        }
        PreparationEvent::Skipped(count) => run.frames.skipped += count,
        PreparationEvent::Damaged {
            error,
            seconds,
            counts,
        } => run.skip_damaged(context, (&error, seconds), &counts),
        PreparationEvent::DamagedPart(error) => run.damage.add(&error, &context.status),
        PreparationEvent::Idle(counts) => run.idle(context, &counts)?,
        PreparationEvent::End(counts) => run.finish_loop(context, &counts),
        PreparationEvent::Pause => context.status.pause(),
    }
    Ok(())
}

/// Refuses more dome lights than the adapter can hold shadow maps for.
fn check_lights(gpu: &Gpu, lights: u32) -> Result<(), GpuError> {
    let max = gpu.max_lights();
    if lights <= max {
        return Ok(());
    }
    Err(GpuError::Unfit {
        adapter: gpu.name.clone(),
        reason: format!(
            "environment.light_count: {lights} lights, and it can hold the shadow maps of {max}"
        ),
    })
}

/// Returns the one-line state of the run for the service manager.
fn status_line(context: &RunContext) -> String {
    let snapshot = context.status.snapshot();
    let devices = snapshot.devices.iter();
    let problems: Vec<_> = devices
        .filter_map(|d| Some(format!("{}: {}", d.kind.label(), d.reason.as_ref()?)))
        .collect();
    let rate = snapshot.frames.per_second;
    if problems.is_empty() {
        format!("{rate:.1} frames/s")
    } else {
        format!("{rate:.1} frames/s; {}", problems.join("; "))
    }
}

/// Creates the sender of FreeD poses to virtual-production tools, as camera 1.
///
/// # Errors
/// The receiver cannot be reached.
fn pose_sender(receiver: SocketAddr) -> Result<FreedSender, RigError> {
    FreedSender::new(receiver, 1).map_err(|source| RigError::Freed { receiver, source })
}
