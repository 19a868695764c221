//! The data between the frame loop and the light worker: request, result, active light.

use crate::light::agreement::PictureAgreement;
use crate::light::blended::{Blend, LightMixer};
use crate::light::bracket_response::ExposureAgreement;
use crate::light::timeline::LightTimeline;
use crate::light::transition::LightTransition;
use crate::light::view::SphereAt;
use penumbra_camera::PinholeCamera;
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::{LightKind, Lighting, ProbeMap};
use penumbra_picture::Picture;
use penumbra_scene::IndirectLight;
use penumbra_sync::{EnvironmentSet, RigFrame};
use penumbra_white_balance::MatchStatus;
use std::sync::Arc;
use std::time::Duration;

/// Inputs of a light estimate besides the scene camera's pixels.
#[derive(Clone)]
pub(crate) struct LightRequest {
    /// Arrival of the scene camera's picture.
    pub arrived_at: MonotonicTime,
    /// Middle of its exposure.
    pub captured_at: MonotonicTime,
    /// Middle of its exposure, seconds after the session began.
    pub seconds: f64,
    /// Exposure as reported by the camera.
    pub exposure: Option<Exposure>,
    /// Pose of the scene camera, if it is known.
    pub world_from_camera: Option<RigidTransform>,
    /// The scene camera's lens.
    pub camera: PinholeCamera,
    /// Position of the mirrored sphere.
    pub sphere: SphereAt,
    /// The environment set paired with the picture.
    pub environment: Option<Arc<EnvironmentSet>>,
}

impl LightRequest {
    /// Creates the request of a paired picture; its pose may have been rejected.
    pub fn new(
        frame: &RigFrame,
        seconds: f64,
        world_from_camera: Option<RigidTransform>,
        camera: &PinholeCamera,
    ) -> Self {
        Self {
            arrived_at: frame.scene.arrived_at,
            captured_at: frame.captured_at,
            seconds,
            exposure: frame.scene.exposure,
            world_from_camera,
            camera: camera.clone(),
            sphere: SphereAt::Calibrated,
            environment: frame.environment.as_ref().map(|e| Arc::clone(&e.set)),
        }
    }
}

/// The result of a light estimate.
pub(crate) struct LightResult {
    /// Arrival of the picture.
    pub picture_arrived_at: MonotonicTime,
    /// The light, if it has changed.
    pub state: Option<LightState>,
    /// Duration of the estimate.
    pub took: Duration,
    /// Why an environment picture could not be read.
    pub picture_error: Option<String>,
    /// A new preview of the environment, if one was due.
    pub preview: Option<Arc<Picture>>,
}

/// The instant of light that is stated, not measured: no later picture changes it.
pub(crate) const STATED_AT: MonotonicTime = MonotonicTime::from_nanos(i64::MAX);

/// Light and its provenance. Shared, because it changes less often than frames.
#[derive(Clone, Default)]
pub struct LightState {
    /// Light of the distant environment.
    pub lighting: Option<Arc<Lighting>>,
    /// Number of its environment picture; 0 without one.
    pub number: u64,
    /// Indirect light: light that virtual objects reflect onto the scene and each other.
    pub indirect: Option<Arc<IndirectLight>>,
    /// State of the white balance between the cameras.
    pub white_balance: Option<Arc<MatchStatus>>,
    /// Compact sources found.
    pub sources: Arc<Vec<CompactSource>>,
    /// Share of the sphere of directions that is clipped in every exposure.
    pub clipped: f32,
    /// Whether the environment camera's exposures agree under its tone curve; `None` if too little is
    /// well exposed twice.
    pub exposures: Option<ExposureAgreement>,
    /// How well the light explains the real shadows in the scene camera's picture; `None` if none was
    /// compared.
    pub picture: Option<Arc<PictureAgreement>>,
    /// Observations of a mirrored sphere in the scene camera's picture, if there is one.
    pub probe: Option<ProbeMap>,
}

impl LightState {
    /// Returns the middle of the exposure of its environment picture; `None` without light.
    pub(crate) fn captured_at(&self) -> Option<MonotonicTime> {
        self.lighting.as_ref().map(|l| l.captured_at)
    }

    /// Returns the number of dome lights and, of these, the number of compact sources.
    #[must_use]
    pub fn count(&self) -> (u32, u32) {
        let lights = self.lighting.as_ref().map_or(&[][..], |l| &l.lights);
        let compact = lights.iter().filter(|l| l.kind == LightKind::Compact);
        (lights.len() as u32, compact.count() as u32)
    }
}

/// The light in which frames are composed.
#[derive(Default)]
pub(crate) struct ActiveLight {
    /// The estimates from which the light of a frame is interpolated.
    pub lights: Lights,
    mixer: LightMixer,
    coming: LightMixer,
    /// Arrival of the picture from which the newest was estimated.
    pub picture_arrived_at: Option<MonotonicTime>,
    /// Duration of the estimate.
    pub took: Duration,
    /// Why an environment picture could not be read; reported once.
    pub picture_error: Option<String>,
    /// A new preview of the environment; published once.
    pub preview: Option<Arc<Picture>>,
}

/// How light is interpolated in time.
pub(crate) enum Lights {
    /// At each picture's instant.
    Exact(LightTimeline),
    /// From one estimate to the next, as they become active.
    Delayed(Box<LightTransition>),
}

impl Default for Lights {
    fn default() -> Self {
        Self::Delayed(Box::default())
    }
}

impl Lights {
    fn push(&mut self, state: LightState, at: MonotonicTime) {
        match self {
            Self::Exact(lights) => lights.push(state),
            Self::Delayed(lights) => lights.push(state, at),
        }
    }

    /// Returns the newest estimate.
    pub fn newest(&self) -> Option<&LightState> {
        match self {
            Self::Exact(lights) => lights.newest(),
            Self::Delayed(lights) => lights.newest(),
        }
    }

    /// Returns whether the light of the picture captured at `at` is known.
    pub fn is_settled(&self, at: MonotonicTime) -> bool {
        match self {
            Self::Exact(lights) => lights.is_settled(at),
            Self::Delayed(_) => true,
        }
    }

    /// Goes on to the picture captured at `at`.
    fn advance(&mut self, at: MonotonicTime) {
        match self {
            Self::Exact(lights) => lights.advance(at),
            Self::Delayed(lights) => lights.advance(at),
        }
    }

    /// Returns the light of a picture captured at `at` or, as far as it is known, later.
    fn blend_at(&self, at: MonotonicTime) -> Option<Blend<'_>> {
        match self {
            Self::Exact(lights) => lights.blend_at(at),
            Self::Delayed(lights) => lights.blend_at(at),
        }
    }
}

impl ActiveLight {
    /// Creates the light of a recording, interpolated at each picture's instant.
    pub fn exact() -> Self {
        Self {
            lights: Lights::Exact(LightTimeline::default()),
            ..Self::default()
        }
    }

    /// Activates a result, with the picture captured at `at`.
    pub fn activate(&mut self, result: LightResult, at: MonotonicTime) {
        self.picture_arrived_at = Some(result.picture_arrived_at);
        self.took = result.took;
        if let Some(state) = result.state {
            self.lights.push(state, at);
        }
        self.picture_error = result.picture_error.or(self.picture_error.take());
        self.preview = result.preview.or(self.preview.take());
    }

    /// Returns whether there is no light yet.
    pub fn is_missing(&self) -> bool {
        self.lights.newest().is_none()
    }

    /// Returns the light of the picture captured at `at`.
    pub fn at(&mut self, at: MonotonicTime) -> LightState {
        self.lights.advance(at);
        let blend = self.lights.blend_at(at);
        blend.map_or_else(LightState::default, |blend| self.mixer.mix(blend))
    }

    /// Returns the light at the later instant `at`, as far as it is known.
    pub fn coming(&mut self, at: MonotonicTime) -> LightState {
        let blend = self.lights.blend_at(at);
        blend.map_or_else(LightState::default, |blend| self.coming.mix(blend))
    }
}
