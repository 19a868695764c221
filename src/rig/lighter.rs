//! What a picture of the scene camera and the environment's beside it make of the light,
//! on whichever thread that happens.

use super::light::{LightStation, SceneView, SphereAt};
use super::prepare::LightState;
use super::scene_light::SceneLight;
use glam::Quat;
use penumbra_config::Technique;
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_lighting::{Lighting, cube};
use penumbra_picture::Picture;
use penumbra_status::{Settings, environment_preview};
use penumbra_sync::{EnvironmentSet, RigFrame};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Rows of the environment's preview.
const PREVIEW_ROWS: u32 = 128;
/// Time between two previews.
const PREVIEW_EVERY: Duration = Duration::from_secs(1);

/// What the light is worked out from, beside the scene camera's pixels.
#[derive(Clone)]
pub(super) struct Seen {
    /// Arrival of the scene camera's picture.
    pub arrived_at: MonotonicTime,
    /// Middle of its exposure.
    pub captured_at: MonotonicTime,
    /// The same, seconds after the session began.
    pub seconds: f64,
    /// As the camera reports it.
    pub exposure: Option<Exposure>,
    /// Its pose, if it is known.
    pub world_from_camera: Option<RigidTransform>,
    /// Where the mirrored sphere is.
    pub ball: SphereAt,
    /// The environment, as it was a little before.
    pub environment: Option<Arc<EnvironmentSet>>,
}

impl Seen {
    /// Of a paired picture; its pose may have been refused.
    pub fn new(frame: &RigFrame, seconds: f64, world_from_camera: Option<RigidTransform>) -> Self {
        Self {
            arrived_at: frame.scene.arrived_at,
            captured_at: frame.captured_at,
            seconds,
            exposure: frame.scene.exposure,
            world_from_camera,
            ball: SphereAt::Calibrated,
            environment: frame.environment.as_ref().map(|e| Arc::clone(&e.set)),
        }
    }
}

/// A picture's light, worked out.
pub(super) struct WorkedOut {
    /// Arrival of the picture.
    pub of: MonotonicTime,
    /// The light, if it is another than before.
    pub state: Option<LightState>,
    /// How long it took.
    pub took: Duration,
    /// An environment picture that could not be read, and why.
    pub unseen: Option<String>,
    /// A new preview of the environment, now and then.
    pub preview: Option<Arc<Picture>>,
}

/// What the light has to know of a changed scene: the newest that nobody has taken yet.
#[derive(Clone, Default)]
pub(super) struct SceneNews(Arc<Mutex<SceneChange>>);

#[derive(Default)]
struct SceneChange {
    scene: Option<Box<SceneLight>>,
    turn: Option<Quat>,
}

impl SceneNews {
    /// Another scene is shown.
    pub fn tell_scene(&self, scene: SceneLight) {
        self.change(|news| {
            let scene = match news.scene.take() {
                Some(older) => scene.over(*older),
                None => scene,
            };
            news.scene = Some(Box::new(scene));
        });
    }

    /// The model and with it the dome of the planes' lights were turned.
    pub fn tell_turn(&self, world_from_dome: Quat) {
        self.change(|news| news.turn = Some(world_from_dome));
    }

    fn change(&self, change: impl FnOnce(&mut SceneChange)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn take(&self) -> Option<SceneChange> {
        let mut news = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let any = news.scene.is_some() || news.turn.is_some();
        any.then(|| std::mem::take(&mut *news))
    }
}

/// Works out light as the dashboard wishes it.
pub(super) struct Lighter {
    light: LightStation,
    wished: watch::Receiver<Settings>,
    /// Of the geodesic dome, where planes are the technique.
    frequency: u32,
    technique: Technique,
    news: SceneNews,
    turn: Quat,
    generation: Option<u64>,
    previewed: Option<Instant>,
}

impl Lighter {
    /// `technique` is what the rig begins with; `frequency` that of the geodesic dome.
    pub fn new(
        light: LightStation,
        wished: watch::Receiver<Settings>,
        technique: Technique,
        frequency: u32,
        news: SceneNews,
    ) -> Self {
        let mut lighter = Self {
            light,
            wished,
            frequency,
            technique,
            news,
            turn: Quat::IDENTITY,
            generation: None,
            previewed: None,
        };
        lighter.choose();
        lighter
    }

    /// The light of a picture. An environment picture that cannot be read leaves it as it
    /// was.
    pub fn work_out(&mut self, seen: &Seen, picture: &Picture) -> WorkedOut {
        let begun = Instant::now();
        self.take_scene();
        self.take_settings();
        let view = SceneView {
            picture,
            world_from_camera: seen.world_from_camera,
            ball: seen.ball,
            captured_at: seen.captured_at,
            exposure: seen.exposure,
        };
        self.light.set_time(seen.seconds);
        let result = self.light.update(seen.environment.as_deref(), &view);
        let generation = self.light.lighting().map(|l| l.generation);
        let changed = generation != self.generation;
        self.generation = generation;
        WorkedOut {
            of: seen.arrived_at,
            state: changed.then(|| self.light.state()),
            took: begun.elapsed(),
            unseen: result.err().map(|error| error.to_string()),
            preview: self.preview(),
        }
    }

    fn take_settings(&mut self) {
        if !self.wished.has_changed().unwrap_or(false) {
            return;
        }
        let settings = self.wished.borrow_and_update().clone();
        self.light
            .set_lights(settings.light_placement, settings.light_count as usize);
        self.light.set_reflections(settings.reflections);
        self.technique = settings.technique;
        self.choose();
    }

    /// Shadowing planes want the faces of a geodesic dome lit, turned with their model.
    fn choose(&mut self) {
        let wanted = self.technique == Technique::ShadowingPlanes;
        self.light.set_faces(wanted.then_some(self.frequency));
        self.light.turn_faces(self.turn);
    }

    /// Another scene, or another place of its model.
    fn take_scene(&mut self) {
        let Some(change) = self.news.take() else {
            return;
        };
        if let Some(scene) = change.scene {
            self.light.take_scene(*scene);
            self.generation = None;
            // A new estimator does not know what is wished.
            self.wished.mark_changed();
        }
        if let Some(turn) = change.turn {
            self.turn = turn;
            self.choose();
        }
    }

    fn preview(&mut self) -> Option<Arc<Picture>> {
        let lighting: &Lighting = self.light.lighting()?;
        let recent = |at: Instant| at.elapsed() < PREVIEW_EVERY;
        if self.previewed.is_some_and(recent) {
            return None;
        }
        self.previewed = Some(Instant::now());
        let radiance = |d| cube::sample(&lighting.radiance, 0, d);
        let picture = environment_preview(PREVIEW_ROWS, radiance, &lighting.lights);
        Some(Arc::new(picture))
    }
}
