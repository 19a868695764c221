//! Shadowing planes in a rig: a bake is read from the cache or made on a thread of its own,
//! while pictures go on with the light dome's shadows. When the scene is changed later, the old
//! scene stays in the picture with its bake until that of the new one is there; a model that is
//! moved as a whole takes its bake along at once.

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

/// Time between two looks at a bake that is waited for.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Whether the bake in force is right for a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fit {
    /// It is, where it was moved to.
    Right,
    /// Nearly, where it was moved to: something real has not moved along.
    Nearly,
    /// It is another scene's.
    Not,
}

/// What is shown of planes.
struct ActivePlanes {
    baked: Baked,
    world_from_bake: RigidTransform,
    /// The scene that it was compared with last, and how well it fits.
    fits: (Arc<Scene>, Fit),
}

/// See the module.
#[derive(Default)]
pub(super) struct PlaneBakes {
    status: PlanesStatus,
    working: Option<Baking>,
    /// Nobody wants these any more.
    retired: Vec<Baking>,
    in_force: Option<ActivePlanes>,
    /// A scene that has no bake, and why.
    failed: Option<(Arc<Scene>, String)>,
}

impl PlaneBakes {
    /// What planes are doing.
    pub const fn status(&self) -> &PlanesStatus {
        &self.status
    }

    /// How a frame of `scene` is drawn with `settings`; `None` where planes are not the
    /// technique, or have no bake of it.
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

    /// How the dome of the lights is turned: with the model.
    pub fn turn(&self) -> DQuat {
        self.in_force
            .as_ref()
            .map_or(DQuat::IDENTITY, |f| f.world_from_bake.rotation)
    }

    fn shows(&self, scene: &Arc<Scene>) -> bool {
        let fits = |f: &ActivePlanes| f.fits.1 != Fit::Not && Arc::ptr_eq(&f.fits.0, scene);
        self.in_force.as_ref().is_some_and(fits)
    }

    /// Sees to the bake of `wanted`, the newest scene, and says whether that may be shown in
    /// place of `shown`. A recording waits for its first bake, so that its pictures are always the
    /// same; else the picture goes on, and the status says what is wrong.
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
            let patience = if wait { LOOK_EVERY } else { Duration::ZERO };
            if self.look(patience, wait, compositor)? {
                continue;
            }
            if !wait || context.is_shutting_down() {
                return Ok(fit == Fit::Nearly || !self.shows(shown));
            }
            context.status.update(|s| s.planes.clone_from(&self.status));
        }
    }

    /// How well the bake in force fits `wanted`, moved along with it where that is enough. Where
    /// it does not fit it stays as it is, for the scene that is shown.
    fn fit(&mut self, wanted: &Arc<Scene>, compositor: &mut Compositor) -> Fit {
        let Some(force) = &mut self.in_force else {
            return Fit::Not;
        };
        if Arc::ptr_eq(&force.fits.0, wanted) {
            return force.fits.1;
        }
        // It is being baked because it was compared before.
        if let Some(working) = &self.working
            && Arc::ptr_eq(&working.scene, wanted)
        {
            return Fit::Not;
        }
        let (motion, fit) = match Change::between(&force.baked.scene, wanted) {
            Change::Looks => (RigidTransform::IDENTITY, Fit::Right),
            Change::Moved { new_from_old } if goes_along(wanted, new_from_old) => {
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

    /// Planes are baked for what stands still: a scene in which part `index` moves has the dome's
    /// shadows.
    fn refuse(&mut self, scene: &Arc<Scene>, index: usize) {
        self.retire();
        if !self.has_failed(scene) {
            let name = scene
                .virtual_parts
                .get(index)
                .map_or("", |p| p.name.as_str());
            let reason = format!(
                "`{name}` moves (`keys` or `animation`), and planes are baked for what stands still"
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

    /// Makes sure that the bake of `scene` is on its way.
    fn work(
        &mut self,
        context: &RunContext,
        scene: &Arc<Scene>,
        compositor: &Compositor,
    ) -> Result<(), RigError> {
        let on_its_way = |w: &Baking| Arc::ptr_eq(&w.scene, scene);
        if self.working.as_ref().is_none_or(|w| !on_its_way(w)) {
            self.retire();
            let before = self.in_force.as_ref().and_then(ActivePlanes::to_build_on);
            let config = &context.config.planes;
            let working = Baking::start(compositor.gpu(), scene, config, before)?;
            self.working = Some(working);
        }
        Ok(())
    }

    /// Ends what is on its way; nobody waits for its end.
    fn retire(&mut self) {
        self.retired.retain(|w| !w.is_over());
        if let Some(working) = self.working.take() {
            working.end();
            self.retired.push(working);
        }
    }

    /// Takes what is finished, and says whether something is.
    fn look(
        &mut self,
        patience: Duration,
        strict: bool,
        compositor: &mut Compositor,
    ) -> Result<bool, RigError> {
        let Some(working) = &self.working else {
            return Ok(false);
        };
        match working.result.recv_timeout(patience) {
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
            // Not even one that was moved along and nearly fits.
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

    /// Counts what the last frame cost. Waits for it.
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
    /// The bake as it stands now, for a scene in which not all has changed. One that was turned
    /// has its lights turned, too, and is no start.
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

/// Whether all shadows of `scene` move along with its model: what is real is level ground alone,
/// and the model has stayed upright on it.
fn goes_along(scene: &Scene, motion: RigidTransform) -> bool {
    is_level(motion) && solid_phantoms(scene).next().is_none()
}
