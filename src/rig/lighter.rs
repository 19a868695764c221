//! What a picture of the scene camera and the environment's beside it make of the light,
//! on whichever thread that happens.

use super::light::{LightStation, SceneView, placement};
use super::prepare::LightState;
use crate::config::LightPlacement;
use crate::environment::{Lighting, cube};
use crate::picture::Picture;
use crate::status::{LightsMode, Settings, Technique, environment_preview};
use crate::sync::{EnvironmentSet, RigFrame};
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use std::sync::Arc;
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
    /// As the camera reports it.
    pub exposure: Option<Exposure>,
    /// Its pose, if it is known.
    pub world_from_camera: Option<RigidTransform>,
    /// The environment, as it was a little before.
    pub environment: Option<Arc<EnvironmentSet>>,
}

impl Seen {
    /// Of a paired picture; its pose may have been refused.
    pub fn new(frame: &RigFrame, world_from_camera: Option<RigidTransform>) -> Self {
        Self {
            arrived_at: frame.scene.arrived_at,
            captured_at: frame.captured_at,
            exposure: frame.scene.exposure,
            world_from_camera,
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

/// Works out light as the dashboard wishes it.
pub(super) struct Lighter {
    light: LightStation,
    wished: watch::Receiver<Settings>,
    /// Of the geodesic dome, where planes are the technique.
    frequency: u32,
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
    ) -> Self {
        let mut lighter = Self {
            light,
            wished,
            frequency,
            generation: None,
            previewed: None,
        };
        lighter.choose(technique);
        lighter
    }

    /// The light of a picture. An environment picture that cannot be read leaves it as it
    /// was.
    pub fn work_out(&mut self, seen: &Seen, picture: &Picture) -> WorkedOut {
        let begun = Instant::now();
        self.take_settings();
        let view = SceneView {
            picture,
            world_from_camera: seen.world_from_camera,
            captured_at: seen.captured_at,
            exposure: seen.exposure,
        };
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
        let lights = match settings.lights_mode {
            LightsMode::Adaptive => LightPlacement::Adaptive,
            LightsMode::Grid => LightPlacement::Grid,
        };
        self.light
            .set_lights(placement(lights), settings.light_count as usize);
        self.choose(settings.technique);
    }

    /// Shadowing planes want the faces of a geodesic dome lit.
    fn choose(&mut self, technique: Technique) {
        let wanted = technique == Technique::ShadowingPlanes;
        self.light.set_faces(wanted.then_some(self.frequency));
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
