//! Obtains a bake on its own thread: from the cache, from an earlier bake, or by baking.

use crate::bake::{BakePlan, bake_changes};
use crate::error::RigError;
use crossbeam_channel::{Receiver, bounded};
use penumbra_compositor::planes::{PlanesStage, PlanesUploader, Progress, SourceBaker};
use penumbra_compositor::{Gpu, GpuError};
use penumbra_config::PlanesConfig;
use penumbra_interface::threads;
use penumbra_lighting::Lighting;
use penumbra_scene::Scene;
use penumbra_scene::planes::Bake;
use penumbra_scene::planes::store;
use penumbra_scene::planes::store::StoreError;
use penumbra_status::planes::PlanesState;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A bake and its scene.
#[derive(Clone)]
pub(super) struct Baked {
    /// The scene as it was baked.
    pub scene: Arc<Scene>,
    /// The bake.
    pub bake: Arc<Bake>,
}

/// A finished bake, its source and the stage that renders it.
pub(super) struct Obtained {
    pub baked: Baked,
    pub stage: Box<PlanesStage>,
    pub from_cache: bool,
    pub took: Duration,
}

/// A bake in progress. Dropping it ends the thread.
pub(super) struct Baking {
    /// The scene to bake.
    pub scene: Arc<Scene>,
    /// Receives the result.
    pub result: Receiver<Result<Obtained, RigError>>,
    light: Arc<NewestLight>,
    done: Arc<AtomicU32>,
    total: Arc<AtomicU32>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// The light of the newest picture; `None` while the pictures wait for the bake.
type NewestLight = Mutex<Option<Arc<Lighting>>>;

impl Baking {
    /// Starts the bake of `scene`. With an earlier bake `before`, only changed parts are baked;
    /// otherwise the bake is read from the cache, or baked completely and stored there.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(
        uploader: PlanesUploader,
        scene: &Arc<Scene>,
        config: &PlanesConfig,
        before: Option<Baked>,
    ) -> Result<Self, RigError> {
        let (done, total) = (Arc::<AtomicU32>::default(), Arc::<AtomicU32>::default());
        let stop = Arc::<AtomicBool>::default();
        let (send, result) = bounded(1);
        let (light, config) = (Arc::<NewestLight>::default(), config.clone());
        let newest = light.clone();
        let (counts, stopped) = ((done.clone(), total.clone()), stop.clone());
        let target = scene.clone();
        let job = move || {
            let mut progress = |done: usize, total: usize| {
                // The last call only asks whether to go on.
                if total > 0 {
                    counts.0.store(done as u32, Ordering::Relaxed);
                    counts.1.store(total as u32, Ordering::Relaxed);
                }
                if stopped.load(Ordering::Relaxed) {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            };
            // The receiver is gone if the rig has ended.
            let made = obtain(&uploader, &target, &config, before, &mut progress);
            let _ = send.send(made.map(|made| prepared(made, &uploader.gpu, &newest)));
        };
        let thread = threads::spawn_background("bake", job);
        let thread = thread.map_err(|source| RigError::Thread { source })?;
        Ok(Self {
            scene: scene.clone(),
            result,
            light,
            done,
            total,
            stop,
            thread: Some(thread),
        })
    }

    /// Sets the light of the newest picture, in which the bake will be shown. Without it, the
    /// first picture with the bake does the work for its light at once.
    pub fn set_light(&self, light: Option<&Arc<Lighting>>) {
        let mut newest = self.light.lock().unwrap_or_else(PoisonError::into_inner);
        *newest = light.cloned();
    }

    /// Returns the progress of the bake.
    pub fn state(&self) -> PlanesState {
        PlanesState::Baking {
            done: self.done.load(Ordering::Relaxed),
            total: self.total.load(Ordering::Relaxed),
        }
    }
}

impl Baking {
    /// Requests the thread to end.
    pub fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Returns whether the thread has ended.
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for Baking {
    fn drop(&mut self) {
        self.end();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Does the work for the present light, which would delay the first picture otherwise.
fn prepared(mut made: Obtained, gpu: &Gpu, newest: &NewestLight) -> Obtained {
    // A copy, because the pictures must not wait for this work.
    let light = newest
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .clone();
    if let Some(light) = light {
        made.stage.prepare_sources(gpu, light.faces.as_deref());
    }
    made
}

fn obtain(
    uploader: &PlanesUploader,
    scene: &Arc<Scene>,
    config: &PlanesConfig,
    before: Option<Baked>,
    progress: &mut Progress<'_>,
) -> Result<Obtained, RigError> {
    let begun = Instant::now();
    let gpu = &uploader.gpu;
    let (bake, from_cache) = match before {
        Some(old) => {
            let old = (&*old.scene, &*old.bake);
            (bake_changes(gpu, old, scene, config, progress)?, false)
        }
        None => load_or_bake(gpu, scene, config, progress)?,
    };
    if progress(0, 0).is_break() {
        return Err(GpuError::Stopped.into());
    }
    // Without images of the compact sources, the lights of the dome still cast shadows.
    let sources = || {
        let made = SourceBaker::new(gpu, scene, &bake);
        made.inspect_err(|error| tracing::warn!("{error}")).ok()
    };
    let sources = config.sources.then_some(sources);
    Ok(Obtained {
        stage: Box::new(uploader.upload(&bake, sources)?),
        baked: Baked {
            scene: scene.clone(),
            bake: Arc::new(bake),
        },
        from_cache,
        took: begun.elapsed(),
    })
}

/// Returns the bake, and whether it was read from the cache. A new bake is stored there.
fn load_or_bake(
    gpu: &Gpu,
    scene: &Scene,
    config: &PlanesConfig,
    progress: &mut Progress<'_>,
) -> Result<(Bake, bool), RigError> {
    let plan = BakePlan::new(scene, config);
    let file = plan.cache_file(config);
    let cached = file.as_ref().and_then(|file| {
        let read = store::load(file, &plan.key);
        // An unreadable cache file counts as missing.
        read.inspect_err(|error| tracing::warn!("{error}"))
            .ok()
            .flatten()
    });
    if let Some(bake) = cached {
        return Ok((bake, true));
    }
    let bake = plan.bake(gpu, scene, config, progress)?;
    if let Some(file) = file
        && let Err(error) = store_in_cache(&file, &bake)
    {
        tracing::warn!("{error}");
    }
    Ok((bake, false))
}

/// Stores a bake in the cache and removes the least recently used ones beyond its limit.
fn store_in_cache(file: &Path, bake: &Bake) -> Result<(), StoreError> {
    store::save(file, bake)?;
    if let Some(folder) = file.parent() {
        store::trim(folder, store::CACHE_LIMIT)?;
    }
    Ok(())
}
