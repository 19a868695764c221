//! Obtains and exchanges the bakes of shadowing planes in a rig.
//!
//! A bake is read from the cache or made on its own thread; until it is ready, the light dome casts
//! the shadows. When the scene changes later, the old scene stays in the picture with its bake
//! until the bake of the new scene is ready. A rigid motion of the model moves its bake at once.

use crate::baking::{Baked, Baking, Obtained};
use crate::context::RunContext;
use crate::error::RigError;
use crossbeam_channel::RecvTimeoutError;
use glam::{DQuat, DVec3};
use penumbra_compositor::Compositor;
use penumbra_compositor::planes::{PlanesChoice, Thresholds};
use penumbra_config::Technique;
use penumbra_interface::RigidTransform;
use penumbra_scene::change::is_level;
use penumbra_scene::indirect_light::solid_phantoms;
use penumbra_scene::planes::{Bake, ShadowingPlane};
use penumbra_scene::{Change, Scene};
use penumbra_status::Settings;
use penumbra_status::planes::{PlanesState, PlanesStatus};
use std::sync::Arc;
use std::time::Duration;

/// Polling interval while waiting for a bake.
const POLL_EVERY: Duration = Duration::from_millis(100);

/// How well the active bake fits a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fit {
    /// It fits, after its motion.
    Right,
    /// It fits approximately after its motion, because real objects have not moved with the model.
    Nearly,
    /// It belongs to another scene.
    Not,
}

/// The bake that is shown.
struct ActivePlanes {
    baked: Baked,
    world_from_bake: RigidTransform,
    /// The scene that it was last compared with, and how well it fits.
    fits: (Arc<Scene>, Fit),
}

/// The bakes of a run; see the module.
#[derive(Default)]
pub(super) struct PlaneBakes {
    status: PlanesStatus,
    working: Option<Baking>,
    /// Cancelled bakes whose threads may still run.
    retired: Vec<Baking>,
    in_force: Option<ActivePlanes>,
    /// A scene whose bake failed, and the reason.
    failed: Option<(Arc<Scene>, String)>,
}

impl PlaneBakes {
    /// Status of the planes.
    pub const fn status(&self) -> &PlanesStatus {
        &self.status
    }

    /// Returns how to render a frame of `scene` with `settings`; `None` if planes are not the
    /// technique or have no bake of the scene.
    pub fn choice(&self, settings: &Settings, scene: &Arc<Scene>) -> Option<PlanesChoice> {
        let wanted = settings.technique == Technique::ShadowingPlanes && self.shows(scene);
        wanted.then_some(PlanesChoice {
            thresholds: Thresholds {
                skip_below: settings.planes_skip_below,
                recompute_above: settings.planes_recompute_above,
            },
            shading: settings.planes_shading,
        })
    }

    /// Rotation of the light dome, which is that of the model.
    pub fn turn(&self) -> DQuat {
        self.in_force
            .as_ref()
            .map_or(DQuat::IDENTITY, |f| f.world_from_bake.rotation)
    }

    fn shows(&self, scene: &Arc<Scene>) -> bool {
        let fits = |f: &ActivePlanes| f.fits.1 != Fit::Not && Arc::ptr_eq(&f.fits.0, scene);
        self.in_force.as_ref().is_some_and(fits)
    }

    /// Obtains the bake of `wanted`, the newest scene, and returns whether that scene may replace
    /// `shown`. A recording waits for its first bake, so that its pictures are reproducible;
    /// otherwise frames continue, and the status reports failures.
    ///
    /// # Errors
    /// The first bake of a recording fails, or the system cannot start a thread.
    pub fn attend(
        &mut self,
        context: &RunContext,
        settings: &Settings,
        (wanted, shown): (&Arc<Scene>, &Arc<Scene>),
        compositor: &mut Compositor,
    ) -> Result<bool, RigError> {
        if settings.technique != Technique::ShadowingPlanes {
            self.status.state = PlanesState::Off;
            return Ok(true);
        }
        if let Some(mover) = wanted.motions.parts.first() {
            self.refuse(wanted, mover.index);
            return Ok(true);
        }
        let first = self.in_force.is_none() && self.failed.is_none();
        let wait = first && !context.source.is_live();
        loop {
            if self.has_failed(wanted) {
                self.status.state = self.settled(wanted);
                return Ok(true);
            }
            let fit = self.fit(wanted, compositor);
            if fit == Fit::Right {
                self.retire();
                self.status.state = self.settled(wanted);
                return Ok(true);
            }
            self.work(context, wanted, compositor)?;
            let timeout = if wait { POLL_EVERY } else { Duration::ZERO };
            if self.look(timeout, wait, compositor)? {
                continue;
            }
            if !wait || context.is_shutting_down() {
                return Ok(fit == Fit::Nearly || !self.shows(shown));
            }
            context.status.update(|s| s.planes.clone_from(&self.status));
        }
    }

    /// Returns how well the active bake fits `wanted`, and moves it if a motion suffices. A bake that
    /// does not fit stays in place for the scene that is shown.
    fn fit(&mut self, wanted: &Arc<Scene>, compositor: &mut Compositor) -> Fit {
        let Some(force) = &mut self.in_force else {
            return Fit::Not;
        };
        if Arc::ptr_eq(&force.fits.0, wanted) {
            return force.fits.1;
        }
        // Its bake is in progress, so the active bake was found not to fit.
        if let Some(working) = &self.working
            && Arc::ptr_eq(&working.scene, wanted)
        {
            return Fit::Not;
        }
        let (motion, fit) = match Change::between(&force.baked.scene, wanted) {
            Change::Looks => (RigidTransform::IDENTITY, Fit::Right),
            Change::Moved { new_from_old } if shadows_move_along(wanted, new_from_old) => {
                (new_from_old, Fit::Right)
            }
            Change::Moved { new_from_old } => (new_from_old, Fit::Nearly),
            Change::Shapes => return Fit::Not,
        };
        force.fits = (wanted.clone(), fit);
        force.world_from_bake = motion;
        compositor.move_planes(motion);
        fit
    }

    /// Refuses to bake a scene in which part `index` moves, because planes are baked for static
    /// objects. The light dome casts its shadows.
    fn refuse(&mut self, scene: &Arc<Scene>, index: usize) {
        self.retire();
        if !self.has_failed(scene) {
            let name = scene
                .virtual_parts
                .get(index)
                .map_or("", |p| p.name.as_str());
            let reason = format!(
                "`{name}` moves (`keys` or `animation`), and planes are baked for static objects"
            );
            tracing::warn!("shadowing planes: {reason}; the light dome casts the shadows");
            self.failed = Some((scene.clone(), reason));
        }
        self.status.state = self.settled(scene);
    }

    fn has_failed(&self, scene: &Arc<Scene>) -> bool {
        let failed = self.failed.as_ref();
        failed.is_some_and(|(of, _)| Arc::ptr_eq(of, scene))
    }

    fn settled(&self, scene: &Arc<Scene>) -> PlanesState {
        match &self.failed {
            Some((of, reason)) if Arc::ptr_eq(of, scene) => PlanesState::Failed {
                reason: reason.clone(),
            },
            _ => PlanesState::Ready,
        }
    }

    /// Starts the bake of `scene` if it is not in progress.
    fn work(
        &mut self,
        context: &RunContext,
        scene: &Arc<Scene>,
        compositor: &Compositor,
    ) -> Result<(), RigError> {
        let is_in_progress = |w: &Baking| Arc::ptr_eq(&w.scene, scene);
        if self.working.as_ref().is_none_or(|w| !is_in_progress(w)) {
            self.retire();
            let before = self.in_force.as_ref().and_then(ActivePlanes::to_build_on);
            let config = &context.config.planes;
            let working = Baking::start(compositor.gpu(), scene, config, before)?;
            self.working = Some(working);
        }
        Ok(())
    }

    /// Cancels the bake in progress without waiting for its thread.
    fn retire(&mut self) {
        self.retired.retain(|w| !w.is_over());
        if let Some(working) = self.working.take() {
            working.end();
            self.retired.push(working);
        }
    }

    /// Takes a finished bake, waiting up to `timeout`. Returns whether a bake finished or failed.
    fn look(
        &mut self,
        timeout: Duration,
        strict: bool,
        compositor: &mut Compositor,
    ) -> Result<bool, RigError> {
        let Some(working) = &self.working else {
            return Ok(false);
        };
        match working.result.recv_timeout(timeout) {
            Err(RecvTimeoutError::Timeout) => {
                self.status.state = working.state();
                return Ok(false);
            }
            Ok(Ok(obtained)) => self.put(obtained, compositor),
            Ok(Err(error)) if strict => return Err(error),
            Ok(Err(error)) => self.fail(error.to_string()),
            Err(RecvTimeoutError::Disconnected) => {
                self.fail("the baking thread ended early".to_owned());
            }
        }
        self.working = None;
        Ok(true)
    }

    fn put(&mut self, obtained: Obtained, compositor: &mut Compositor) {
        self.describe(&obtained);
        compositor.show_planes(obtained.stage);
        self.failed = None;
        self.in_force = Some(ActivePlanes {
            fits: (obtained.baked.scene.clone(), Fit::Right),
            baked: obtained.baked,
            world_from_bake: RigidTransform::IDENTITY,
        });
    }

    fn fail(&mut self, reason: String) {
        tracing::warn!("shadowing planes: {reason}; the light dome casts the shadows");
        if let Some(working) = &self.working {
            // A moved bake that fits approximately is not shown either.
            if let Some(force) = &mut self.in_force
                && Arc::ptr_eq(&force.fits.0, &working.scene)
            {
                force.fits.1 = Fit::Not;
            }
            self.failed = Some((working.scene.clone(), reason));
        }
    }

    fn describe(&mut self, obtained: &Obtained) {
        let bake = &obtained.baked.bake;
        let (lit, all) = bake.counts();
        self.status.planes = bake.planes.len() as u32;
        self.status.lights = bake.lights() as u32;
        self.status.basis_images = lit as u32;
        self.status.basis_images_dropped = (all - lit) as u32;
        self.status.bake_seconds = Some(obtained.took.as_secs_f64());
        self.status.bake_bytes = bake.texels.len() as u64;
        self.status.from_cache = obtained.from_cache;
    }

    /// Counts the work of the last frame. Waits for the GPU to finish it.
    ///
    /// # Errors
    /// The counts cannot be read from the GPU.
    pub fn count(&mut self, compositor: &Compositor) -> Result<(), RigError> {
        let Some(work) = compositor.plane_work()? else {
            return Ok(());
        };
        self.status.planes_seen = work.seen as u32;
        self.status.lights_skipped = work.lights_skipped as u32;
        self.status.sources = work.sources as u32;
        self.status.source_images = work.source_images;
        self.status
            .count_picture(work.images as u32, work.resummed as u32);
        Ok(())
    }
}

impl ActivePlanes {
    /// Returns the bake in its current position, for reuse in a scene that has changed partly. A
    /// rotated bake has rotated lights, too, and cannot be reused.
    fn to_build_on(&self) -> Option<Baked> {
        let RigidTransform {
            rotation,
            translation,
        } = self.world_from_bake;
        if rotation != DQuat::IDENTITY && rotation.angle_between(DQuat::IDENTITY) > 1e-9 {
            return None;
        }
        if translation == DVec3::ZERO {
            return Some(self.baked.clone());
        }
        let moved = |p: &ShadowingPlane| p.moved(self.world_from_bake);
        let bake = Bake {
            planes: self.baked.bake.planes.iter().map(moved).collect(),
            ..(*self.baked.bake).clone()
        };
        (self.fits.1 == Fit::Right).then(|| Baked {
            scene: self.fits.0.clone(),
            bake: Arc::new(bake),
        })
    }
}

/// Returns whether all shadows of `scene` move with its model: the real scene is level ground alone,
/// and the model has stayed upright on it.
fn shadows_move_along(scene: &Scene, motion: RigidTransform) -> bool {
    is_level(motion) && solid_phantoms(scene).next().is_none()
}
