//! Status of shadowing planes.

use serde::Serialize;

/// State of baking and synthesis.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum PlanesState {
    /// Another technique is active.
    #[default]
    Off,
    /// Basis images are being rendered; meanwhile the light dome casts the shadows.
    Baking {
        /// Lights whose basis images are rendered.
        done: u32,
        /// Total number of lights; 0 while the planes are being chosen.
        total: u32,
    },
    /// Basis images are summed in every frame.
    Ready,
    /// Baking failed; the light dome casts the shadows.
    Failed {
        /// What, where, what to do.
        reason: String,
    },
}

impl PlanesState {
    /// Returns the name in `/status` and in metric labels.
    #[must_use]
    pub const fn label(&self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Baking { .. } => "baking",
            Self::Ready => "ready",
            Self::Failed { .. } => "failed",
        }
    }
}

/// Shadowing planes and their basis images.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlanesStatus {
    /// State, as the fields `state`, `done`, `total` and `reason`.
    #[serde(flatten, serialize_with = "all_fields")]
    pub state: PlanesState,
    /// Number of baked planes.
    pub planes: u32,
    /// Number of planes that face the viewer in the newest picture.
    pub planes_seen: u32,
    /// Number of lights: faces of the geodesic dome.
    pub lights: u32,
    /// Lights skipped in the newest picture, because they contribute too little.
    pub lights_skipped: u32,
    /// Number of compact sources that cast shadows from their true directions.
    pub sources: u32,
    /// Basis images rendered for them since the start.
    pub source_images: u64,
    /// Number of non-black basis images.
    pub basis_images: u32,
    /// Number of black basis images, which are neither stored nor summed.
    pub basis_images_dropped: u32,
    /// Basis images summed for the newest picture.
    pub images_summed: u32,
    /// Basis images summed since the start.
    pub images_total: u64,
    /// Basis images that would have been summed if every picture had summed all of them.
    pub images_possible: u64,
    /// Share of these that was saved, 0..=1; `None` before the first picture.
    pub work_saved: Option<f64>,
    /// Planes whose sums were recomputed or updated, since the start.
    pub planes_recomputed: u64,
    /// Pictures for which nothing had to be summed.
    pub frames_without_work: u64,
    /// Duration of baking, seconds; `None` before it is complete.
    pub bake_seconds: Option<f64>,
    /// Size of the bake, bytes.
    pub bake_bytes: u64,
    /// Whether the bake was read from the cache.
    pub from_cache: bool,
}

impl PlanesStatus {
    /// Counts the work of a picture: basis images summed, planes whose sums were recomputed or updated.
    pub fn count_picture(&mut self, images_summed: u32, planes_recomputed: u32) {
        self.images_summed = images_summed;
        self.images_total += u64::from(images_summed);
        self.images_possible += u64::from(self.basis_images);
        self.planes_recomputed += u64::from(planes_recomputed);
        self.frames_without_work += u64::from(images_summed == 0);
        let (total, possible) = (self.images_total as f64, self.images_possible as f64);
        self.work_saved = (possible > 0.0).then(|| (1.0 - total / possible).max(0.0));
    }
}

/// Writes every field in every state, so that readers need not test for their presence.
fn all_fields<S: serde::Serializer>(state: &PlanesState, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Fields<'a> {
        state: &'static str,
        done: Option<u32>,
        total: Option<u32>,
        reason: Option<&'a str>,
    }
    let (done, total) = match state {
        PlanesState::Baking { done, total } => (Some(*done), Some(*total)),
        _ => (None, None),
    };
    let reason = match state {
        PlanesState::Failed { reason } => Some(reason.as_str()),
        _ => None,
    };
    let state = state.label();
    Fields {
        state,
        done,
        total,
        reason,
    }
    .serialize(serializer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_work_is_averaged_over_all_pictures() {
        let mut planes = PlanesStatus {
            basis_images: 100,
            ..PlanesStatus::default()
        };
        planes.count_picture(100, 8);
        assert_eq!(planes.work_saved, Some(0.0));
        planes.count_picture(0, 0);
        planes.count_picture(20, 0);
        planes.count_picture(0, 0);
        assert_eq!(planes.work_saved, Some(0.7));
        let counts = (
            planes.images_summed,
            planes.images_total,
            planes.planes_recomputed,
        );
        assert_eq!(counts, (0, 120, 8));
        assert_eq!(planes.frames_without_work, 2);
        let mut nothing = PlanesStatus::default();
        nothing.count_picture(0, 0);
        assert_eq!(nothing.work_saved, None);
    }

    #[test]
    fn every_state_has_every_field() {
        let baking = PlanesState::Baking { done: 3, total: 40 };
        let failed = PlanesState::Failed {
            reason: "no model".to_owned(),
        };
        for state in [PlanesState::Off, baking, PlanesState::Ready, failed] {
            let status = PlanesStatus {
                state: state.clone(),
                ..PlanesStatus::default()
            };
            let json = serde_json::to_value(status).unwrap();
            assert_eq!(json["state"], state.label());
            let baking = matches!(state, PlanesState::Baking { .. });
            assert_eq!(json["done"].is_u64() && json["total"].is_u64(), baking);
            let failed = matches!(state, PlanesState::Failed { .. });
            assert_eq!(json["reason"].is_string(), failed);
            assert!(json.as_object().unwrap().contains_key("reason"));
        }
    }
}
