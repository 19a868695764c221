//! Obtains and exchanges the bakes of shadowing planes in a rig.
//!
//! A bake is read from the cache or made on its own thread; until it is ready, the light dome casts
//! the shadows. Only a recording that starts with shadowing planes waits for its first bake. When
//! the scene changes later, the old scene stays in the picture with its bake
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
use penumbra_lighting::Lighting;
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
    Exact,
    /// It fits approximately after its motion, because real objects have not moved with the model.
    Approximate,
    /// It belongs to another scene.
    None,
}

/// The active bake.
struct ActivePlanes {
    baked: Baked,
    world_from_bake: RigidTransform,
    /// The scene that it was last compared with, and how well it fits.
    fit: (Arc<Scene>, Fit),
}

/// The bakes of a run.
pub(super) struct PlaneBakes {
    status: PlanesStatus,
    /// Whether the pictures wait for the first bake.
    waits: bool,
    /// The bake in progress.
    baking: Option<Baking>,
    /// Cancelled bakes whose threads may still run.
    retired: Vec<Baking>,
    active: Option<ActivePlanes>,
    /// The bake of a compositor whose device was lost, for the next one.
    lost: Option<Baked>,
    /// A scene whose bake failed, and the reason.
    failed: Option<(Arc<Scene>, String)>,
}

impl PlaneBakes {
    /// A recording that starts with planes waits for its first bake, so that its pictures are
    /// reproducible. No other picture waits: not those of a live rig, nor those after a user has
    /// changed the technique.
    pub fn new(context: &RunContext) -> Self {
        let starts_with_planes = context.config.shadows.technique == Technique::ShadowingPlanes;
        Self {
            waits: starts_with_planes && !context.source.is_live(),
            status: PlanesStatus::default(),
            baking: None,
            retired: Vec::new(),
            active: None,
            lost: None,
            failed: None,
        }
    }

    /// Returns the status of the planes.
    pub const fn status(&self) -> &PlanesStatus {
        &self.status
    }

    /// Returns how to render a frame of `scene` with `settings`; `None` if planes are not the
    /// technique or have no bake of the scene.
    pub fn choice(&self, settings: &Settings, scene: &Arc<Scene>) -> Option<PlanesChoice> {
        let is_used = settings.technique == Technique::ShadowingPlanes && self.fits(scene);
        is_used.then_some(PlanesChoice {
            thresholds: Thresholds {
                skip_below: settings.planes_skip_below,
                recompute_above: settings.planes_recompute_above,
            },
            shading: settings.planes_shading,
        })
    }

    /// Prepares the bakes for a new compositor, whose predecessor's device was lost.
    pub fn forget_device(&mut self) {
        self.retire();
        let reusable = self.active.take().and_then(|a| a.reusable());
        self.lost = reusable.or_else(|| self.lost.take());
        self.failed = None;
    }

    /// Returns the rotation of the light dome, which is that of the model.
    pub fn dome_rotation(&self) -> DQuat {
        self.active
            .as_ref()
            .map_or(DQuat::IDENTITY, |a| a.world_from_bake.rotation)
    }

    /// Returns whether the active bake fits `scene`.
    fn fits(&self, scene: &Arc<Scene>) -> bool {
        let fits = |a: &ActivePlanes| a.fit.1 != Fit::None && Arc::ptr_eq(&a.fit.0, scene);
        self.active.as_ref().is_some_and(fits)
    }

    /// Obtains the bake of `wanted`, the newest scene, and returns whether that scene may replace
    /// `shown`. A recording that starts with planes waits for its first bake; otherwise frames
    /// continue, and the status reports failures. `lighting` is the light of the next picture.
    ///
    /// # Errors
    /// The first bake of a recording fails, or the system cannot start a thread.
    pub fn update(
        &mut self,
        context: &RunContext,
        settings: &Settings,
        (wanted, shown): (&Arc<Scene>, &Arc<Scene>),
        lighting: Option<&Arc<Lighting>>,
        compositor: &mut Compositor,
    ) -> Result<bool, RigError> {
        if settings.technique != Technique::ShadowingPlanes {
            self.retire();
            self.waits = false;
            self.status.state = PlanesState::Off;
            return Ok(true);
        }
        if let Some(part) = wanted.motions.parts.first() {
            self.refuse(wanted, part.index);
            return Ok(true);
        }
        let wait = self.waits && self.active.is_none() && self.failed.is_none();
        loop {
            if self.has_failed(wanted) {
                self.status.state = self.settled_state(wanted);
                return Ok(true);
            }
            let fit = self.fit_to(wanted, compositor);
            if fit == Fit::Exact {
                self.retire();
                self.status.state = self.settled_state(wanted);
                return Ok(true);
            }
            self.start_bake(context, wanted, compositor)?;
            if let (Some(baking), false) = (&self.baking, wait) {
                baking.set_light(lighting);
            }
            let timeout = if wait { POLL_EVERY } else { Duration::ZERO };
            if self.take_finished(timeout, wait, compositor)? {
                continue;
            }
            if !wait || context.is_shutting_down() {
                return Ok(fit == Fit::Approximate || !self.fits(shown));
            }
            context.status.update(|s| s.planes.clone_from(&self.status));
        }
    }

    /// Returns how well the active bake fits `wanted`, and moves it if a motion suffices. A bake
    /// that does not fit stays in place for the scene that is shown.
    fn fit_to(&mut self, wanted: &Arc<Scene>, compositor: &mut Compositor) -> Fit {
        let Some(active) = &mut self.active else {
            return Fit::None;
        };
        if Arc::ptr_eq(&active.fit.0, wanted) {
            return active.fit.1;
        }
        // The bake of `wanted` is in progress, so the active bake was found not to fit.
        if let Some(baking) = &self.baking
            && Arc::ptr_eq(&baking.scene, wanted)
        {
            return Fit::None;
        }
        let (motion, fit) = match Change::between(&active.baked.scene, wanted) {
            Change::Looks => (RigidTransform::IDENTITY, Fit::Exact),
            Change::Moved { new_from_old } if shadows_move_along(wanted, new_from_old) => {
                (new_from_old, Fit::Exact)
            }
            Change::Moved { new_from_old } => (new_from_old, Fit::Approximate),
            Change::Shapes => return Fit::None,
        };
        active.fit = (wanted.clone(), fit);
        active.world_from_bake = motion;
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
        self.status.state = self.settled_state(scene);
    }

    fn has_failed(&self, scene: &Arc<Scene>) -> bool {
        let failed = self.failed.as_ref();
        failed.is_some_and(|(failed, _)| Arc::ptr_eq(failed, scene))
    }

    /// Returns the state of a scene whose bake is neither needed nor in progress.
    fn settled_state(&self, scene: &Arc<Scene>) -> PlanesState {
        match &self.failed {
            Some((failed, reason)) if Arc::ptr_eq(failed, scene) => PlanesState::Failed {
                reason: reason.clone(),
            },
            _ => PlanesState::Ready,
        }
    }

    /// Starts the bake of `scene` if it is not in progress.
    fn start_bake(
        &mut self,
        context: &RunContext,
        scene: &Arc<Scene>,
        compositor: &Compositor,
    ) -> Result<(), RigError> {
        let is_in_progress = |b: &Baking| Arc::ptr_eq(&b.scene, scene);
        if self.baking.as_ref().is_none_or(|b| !is_in_progress(b)) {
            self.retire();
            let reusable = self.active.as_ref().and_then(ActivePlanes::reusable);
            let reusable = reusable.or_else(|| self.lost.take());
            let config = &context.config.planes;
            let baking = Baking::start(compositor.planes_uploader(), scene, config, reusable)?;
            self.baking = Some(baking);
        }
        Ok(())
    }

    /// Cancels the bake in progress without waiting for its thread.
    fn retire(&mut self) {
        self.retired.retain(|b| !b.is_over());
        if let Some(baking) = self.baking.take() {
            baking.end();
            self.retired.push(baking);
        }
    }

    /// Activates a finished bake, waiting up to `timeout`. Returns whether a bake finished or
    /// failed.
    ///
    /// # Errors
    /// The bake failed, and `strict`.
    fn take_finished(
        &mut self,
        timeout: Duration,
        strict: bool,
        compositor: &mut Compositor,
    ) -> Result<bool, RigError> {
        let Some(baking) = &self.baking else {
            return Ok(false);
        };
        match baking.result.recv_timeout(timeout) {
            Err(RecvTimeoutError::Timeout) => {
                self.status.state = baking.state();
                return Ok(false);
            }
            Ok(Ok(obtained)) => self.activate(obtained, compositor),
            Ok(Err(error)) if strict => return Err(error),
            Ok(Err(error)) => self.fail(error.to_string()),
            Err(RecvTimeoutError::Disconnected) => {
                self.fail("the baking thread ended early".to_owned());
            }
        }
        self.baking = None;
        Ok(true)
    }

    fn activate(&mut self, obtained: Obtained, compositor: &mut Compositor) {
        self.report(&obtained);
        compositor.show_planes(obtained.stage);
        self.failed = None;
        self.active = Some(ActivePlanes {
            fit: (obtained.baked.scene.clone(), Fit::Exact),
            baked: obtained.baked,
            world_from_bake: RigidTransform::IDENTITY,
        });
    }

    fn fail(&mut self, reason: String) {
        tracing::warn!("shadowing planes: {reason}; the light dome casts the shadows");
        if let Some(baking) = &self.baking {
            // A moved bake that fits approximately is not shown either.
            if let Some(active) = &mut self.active
                && Arc::ptr_eq(&active.fit.0, &baking.scene)
            {
                active.fit.1 = Fit::None;
            }
            self.failed = Some((baking.scene.clone(), reason));
        }
    }

    fn report(&mut self, obtained: &Obtained) {
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
        self.status.planes_seen = work.visible as u32;
        self.status.lights_skipped = work.lights_skipped as u32;
        self.status.sources = work.sources as u32;
        self.status.source_images = work.source_images;
        self.status
            .count_picture(work.images as u32, work.recomputed as u32);
        Ok(())
    }
}

impl ActivePlanes {
    /// Returns the bake in its current position, for reuse in a scene that has changed partly. A
    /// rotated bake has rotated lights, too, and cannot be reused.
    fn reusable(&self) -> Option<Baked> {
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
        (self.fit.1 == Fit::Exact).then(|| Baked {
            scene: self.fit.0.clone(),
            bake: Arc::new(bake),
        })
    }
}

/// Returns whether all shadows of `scene` move with its model: the real scene is level ground
/// alone, and the model has stayed upright on it.
fn shadows_move_along(scene: &Scene, motion: RigidTransform) -> bool {
    is_level(motion) && solid_phantoms(scene).next().is_none()
}
