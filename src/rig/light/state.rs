//! The data between the frame loop and the light worker: request, result, active light.

use crate::light::view::SphereAt;
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::{LightKind, Lighting, ProbeMap};
use penumbra_picture::Picture;
use penumbra_scene::IndirectLight;
use penumbra_sync::{EnvironmentSet, RigFrame};
use penumbra_white_balance::MatchStatus;
use std::sync::Arc;
use std::time::Duration;

/// What the light is worked out from, beside the scene camera's pixels.
#[derive(Clone)]
pub(crate) struct LightRequest {
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

impl LightRequest {
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
pub(crate) struct LightResult {
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

/// The light in force and how it was found. Shared: it changes less often than frames.
#[derive(Clone, Default)]
pub struct LightState {
    /// The light far away.
    pub lighting: Option<Arc<Lighting>>,
    /// The light close by.
    pub near: Option<Arc<IndirectLight>>,
    /// The match between the cameras.
    pub white_balance: Option<Arc<MatchStatus>>,
    /// Compact sources found.
    pub sources: Arc<Vec<CompactSource>>,
    /// Share of the sphere that every exposure clips.
    pub clipped: f32,
    /// What a mirrored sphere in the scene camera's picture has shown, where there is one.
    pub probe: Option<ProbeMap>,
}

impl LightState {
    /// Dome lights, and those of compact sources among them.
    #[must_use]
    pub fn count(&self) -> (u32, u32) {
        let lights = self.lighting.as_ref().map_or(&[][..], |l| &l.lights);
        let compact = lights.iter().filter(|l| l.kind == LightKind::Compact);
        (lights.len() as u32, compact.count() as u32)
    }
}

/// The light in force.
#[derive(Default)]
pub(crate) struct ActiveLight {
    /// It.
    pub state: LightState,
    /// Arrival of the picture that it is of.
    pub of: Option<MonotonicTime>,
    /// How long it took.
    pub took: Duration,
    /// What was wrong with its environment picture, to be told once.
    pub unseen: Option<String>,
    /// A new preview of the environment, to be shown once.
    pub preview: Option<Arc<Picture>>,
}

impl ActiveLight {
    pub fn enter(&mut self, worked_out: LightResult) {
        self.of = Some(worked_out.of);
        self.took = worked_out.took;
        if let Some(state) = worked_out.state {
            self.state = state;
        }
        self.unseen = worked_out.unseen.or(self.unseen.take());
        self.preview = worked_out.preview.or(self.preview.take());
    }

    /// Without any light there is nothing to show meanwhile.
    pub const fn is_dark(&self) -> bool {
        self.state.lighting.is_none()
    }
}
