//! Passes scene changes to the light worker.

use crate::light::scene_tables::SceneLight;
use glam::Quat;
use std::sync::{Arc, Mutex, PoisonError};

/// The newest scene change that the light worker has not applied yet.
#[derive(Clone, Default)]
pub(crate) struct SceneUpdates(Arc<Mutex<SceneChange>>);

#[derive(Default)]
pub(crate) struct SceneChange {
    pub scene: Option<Box<SceneLight>>,
    pub dome_rotation: Option<Quat>,
}

impl SceneUpdates {
    /// Sets the scene that is shown now.
    pub fn set_scene(&self, scene: SceneLight) {
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
        modify(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Takes the newest change, if there is one.
    pub fn take(&self) -> Option<SceneChange> {
        let mut change = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let any = change.scene.is_some() || change.dome_rotation.is_some();
        any.then(|| std::mem::take(&mut *change))
    }
}
