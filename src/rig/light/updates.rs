//! Passes scene changes to the light worker, and their real surfaces to the registration.

use crate::light::scene_tables::SceneLight;
use glam::Quat;
use penumbra_scene::RayCaster;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The newest scene change that has not been applied yet.
#[derive(Clone, Default)]
pub(crate) struct SceneUpdates {
    change: Arc<Mutex<SceneChange>>,
    /// Real surfaces that the registration has not taken yet.
    surfaces: Arc<Mutex<Option<Arc<RayCaster>>>>,
}

#[derive(Default)]
pub(crate) struct SceneChange {
    pub scene: Option<Box<SceneLight>>,
    pub dome_rotation: Option<Quat>,
}

impl SceneUpdates {
    /// Sets the scene that is shown now.
    pub fn set_scene(&self, scene: SceneLight) {
        if let Some(real) = &scene.real {
            *locked(&self.surfaces) = Some(real.rays.clone());
        }
        self.modify(|change| {
            let scene = match change.scene.take() {
                Some(older) => scene.over(*older),
                None => scene,
            };
            change.scene = Some(Box::new(scene));
        });
    }

    /// Sets the rotation of the model and, with it, of the dome of the planes' lights.
    pub fn set_dome_rotation(&self, world_from_dome: Quat) {
        self.modify(|change| change.dome_rotation = Some(world_from_dome));
    }

    fn modify(&self, modify: impl FnOnce(&mut SceneChange)) {
        modify(&mut locked(&self.change));
    }

    /// Takes the real surfaces, if they have changed.
    pub fn take_surfaces(&self) -> Option<Arc<RayCaster>> {
        locked(&self.surfaces).take()
    }

    /// Takes the newest change, if there is one.
    pub fn take(&self) -> Option<SceneChange> {
        let mut change = locked(&self.change);
        let any = change.scene.is_some() || change.dome_rotation.is_some();
        any.then(|| std::mem::take(&mut *change))
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
