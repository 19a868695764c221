//! Scene changes on their way to the light worker.

use crate::light::scene_tables::SceneLight;
use glam::Quat;
use std::sync::{Arc, Mutex, PoisonError};

/// The newest scene change that the light worker has not applied yet.
#[derive(Clone, Default)]
pub(crate) struct SceneUpdates(Arc<Mutex<SceneChange>>);

#[derive(Default)]
pub(crate) struct SceneChange {
    pub scene: Option<Box<SceneLight>>,
    pub turn: Option<Quat>,
}

impl SceneUpdates {
    /// Reports that another scene is shown.
    pub fn tell_scene(&self, scene: SceneLight) {
        self.change(|news| {
            let scene = match news.scene.take() {
                Some(older) => scene.over(*older),
                None => scene,
            };
            news.scene = Some(Box::new(scene));
        });
    }

    /// Reports that the model, and with it the dome of the planes' lights, was rotated.
    pub fn tell_turn(&self, world_from_dome: Quat) {
        self.change(|news| news.turn = Some(world_from_dome));
    }

    fn change(&self, change: impl FnOnce(&mut SceneChange)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    pub fn take(&self) -> Option<SceneChange> {
        let mut news = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let any = news.scene.is_some() || news.turn.is_some();
        any.then(|| std::mem::take(&mut *news))
    }
}
