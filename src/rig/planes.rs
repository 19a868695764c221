//! Shadowing planes in a rig: a bake is read from the cache or made on a thread of its own,
//! while pictures go on with the light dome's shadows.

use super::bake::BakePlan;
use super::runner::Runner;
use super::{RigError, threads};
use crate::compositor::planes::{PlanesChoice, Shading, Thresholds};
use crate::compositor::{Compositor, Gpu};
use crate::config::{PlaneShading, PlanesConfig};
use crate::scene::Scene;
use crate::scene::planes::Bake;
use crate::scene::planes::store::{self, StoreError};
use crate::status::planes::{PlanesState, PlanesStatus};
use crate::status::{Settings, Technique};
use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two looks at a bake that is waited for.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// A bake and how it was come by.
struct Obtained {
    bake: Bake,
    from_cache: bool,
    took: Duration,
}

/// A bake in the making.
struct Working {
    done: Arc<AtomicU32>,
    total: Arc<AtomicU32>,
    result: Receiver<Result<Obtained, RigError>>,
    thread: Option<JoinHandle<()>>,
}

/// See the module.
#[derive(Default)]
pub(super) struct PlanesStation {
    status: PlanesStatus,
    working: Option<Working>,
    /// There is a bake, or there cannot be one.
    settled: bool,
    failed: Option<String>,
}

impl PlanesStation {
    /// What planes are doing.
    pub const fn status(&self) -> &PlanesStatus {
        &self.status
    }

    /// How a frame is drawn with `settings`; `None` where planes are not the technique.
    pub fn choice(settings: &Settings) -> Option<PlanesChoice> {
        (settings.technique == Technique::ShadowingPlanes).then_some(PlanesChoice {
            thresholds: Thresholds {
                skip_below: settings.planes_skip_below,
                recompute_above: settings.planes_recompute_above,
            },
            shading: match settings.planes_shading {
                PlaneShading::Irradiance => Shading::Irradiance,
                PlaneShading::Lights => Shading::Lights,
                PlaneShading::Six => Shading::Six,
            },
        })
    }

    /// Sees to a bake where one is wanted. A recording waits for it, so that its pictures are
    /// always the same; a live rig goes on, and says in its status what is wrong.
    pub fn attend(
        &mut self,
        runner: &Runner,
        settings: &Settings,
        compositor: &mut Compositor,
    ) -> Result<(), RigError> {
        if settings.technique != Technique::ShadowingPlanes {
            self.status.state = PlanesState::Off;
            return Ok(());
        }
        if !self.settled && self.working.is_none() {
            let (setup, config) = (&runner.setup, &runner.config.planes);
            let working = Working::start(compositor.gpu(), &setup.scene, config)?;
            self.working = Some(working);
        }
        let wait = !runner.source.is_live();
        while let Some(working) = self.working.take() {
            match working
                .result
                .recv_timeout(if wait { LOOK_EVERY } else { Duration::ZERO })
            {
                Ok(result) => self.settle(result, wait, compositor)?,
                Err(RecvTimeoutError::Disconnected) => {
                    self.fail("the baking thread ended early".to_owned());
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.status.state = working.state();
                    self.working = Some(working);
                }
            }
            if !wait || runner.is_over() {
                break;
            }
            runner.status.update(|s| s.planes.clone_from(&self.status));
        }
        if self.settled {
            self.status.state = match &self.failed {
                Some(reason) => PlanesState::Failed {
                    reason: reason.clone(),
                },
                None => PlanesState::Ready,
            };
        }
        Ok(())
    }

    fn settle(
        &mut self,
        result: Result<Obtained, RigError>,
        strict: bool,
        compositor: &mut Compositor,
    ) -> Result<(), RigError> {
        let put = result.and_then(|obtained| {
            compositor.set_bake(Some(&obtained.bake))?;
            Ok(obtained)
        });
        match put {
            Ok(obtained) => {
                self.settled = true;
                self.describe(&obtained);
                Ok(())
            }
            Err(error) if strict => Err(error),
            Err(error) => {
                self.fail(error.to_string());
                Ok(())
            }
        }
    }

    fn fail(&mut self, reason: String) {
        tracing::warn!("shadowing planes: {reason}; the light dome casts the shadows");
        self.settled = true;
        self.failed = Some(reason);
    }

    fn describe(&mut self, obtained: &Obtained) {
        let bake = &obtained.bake;
        let (lit, all) = bake.counts();
        self.status.planes = bake.planes.len() as u32;
        self.status.lights = bake.lights() as u32;
        self.status.basis_images = lit as u32;
        self.status.basis_images_dropped = (all - lit) as u32;
        self.status.bake_seconds = Some(obtained.took.as_secs_f64());
        self.status.bake_bytes = bake.texels.len() as u64;
        self.status.from_cache = obtained.from_cache;
    }

    /// Counts what the last frame cost. Waits for it.
    pub fn count(&mut self, compositor: &Compositor) -> Result<(), RigError> {
        let Some(work) = compositor.plane_work()? else {
            return Ok(());
        };
        self.status.planes_seen = work.seen as u32;
        self.status.lights_skipped = work.lights_skipped as u32;
        self.status
            .count_picture(work.images as u32, work.resummed as u32);
        Ok(())
    }
}

impl Working {
    fn start(gpu: &Gpu, scene: &Scene, config: &PlanesConfig) -> Result<Self, RigError> {
        let (done, total) = (Arc::<AtomicU32>::default(), Arc::<AtomicU32>::default());
        let (send, result) = bounded(1);
        let (gpu, scene, config) = (gpu.clone(), scene.clone(), config.clone());
        let counts = (done.clone(), total.clone());
        let job = move || {
            let mut progress = |at: usize, of: usize| {
                counts.0.store(at as u32, Ordering::Relaxed);
                counts.1.store(of as u32, Ordering::Relaxed);
            };
            // Nobody waits any more where the rig has ended.
            let _ = send.send(obtain(&gpu, &scene, &config, &mut progress));
        };
        let thread = threads::spawn("bake", job).map_err(|source| RigError::Thread { source })?;
        Ok(Self {
            done,
            total,
            result,
            thread: Some(thread),
        })
    }

    fn state(&self) -> PlanesState {
        PlanesState::Baking {
            done: self.done.load(Ordering::Relaxed),
            total: self.total.load(Ordering::Relaxed),
        }
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The bake of `scene`: from the cache, or made now and put there.
fn obtain(
    gpu: &Gpu,
    scene: &Scene,
    config: &PlanesConfig,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Obtained, RigError> {
    let begun = Instant::now();
    let plan = BakePlan::new(scene, config)?;
    let file = plan.cache_file(config);
    let known = file.as_ref().and_then(|file| {
        let read = store::load(file, &plan.key);
        // A cache that cannot be read is as good as none.
        read.inspect_err(|error| tracing::warn!("{error}"))
            .ok()
            .flatten()
    });
    if let Some(bake) = known {
        return Ok(Obtained {
            bake,
            from_cache: true,
            took: begun.elapsed(),
        });
    }
    let planes = plan.planes.len();
    tracing::info!("baking {planes} shadowing planes; the next start reads them from the cache");
    let bake = plan.bake(gpu, scene, config, progress)?;
    if let Some(file) = file
        && let Err(error) = keep(&file, &bake)
    {
        tracing::warn!("{error}");
    }
    Ok(Obtained {
        bake,
        from_cache: false,
        took: begun.elapsed(),
    })
}

/// Puts a bake into the cache; those that were used longest ago make room for it.
fn keep(file: &Path, bake: &Bake) -> Result<(), StoreError> {
    store::save(file, bake)?;
    if let Some(folder) = file.parent() {
        store::trim(folder, store::CACHE_LIMIT)?;
    }
    Ok(())
}
