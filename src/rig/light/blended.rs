//! Blends two states of the light for a frame.

use crate::light::state::LightState;
use penumbra_interface::MonotonicTime;
use penumbra_lighting::{Blender, Lighting};
use penumbra_scene::IndirectLightBlender;
use std::sync::Arc;

/// Maximum time between two environment pictures between which light is interpolated,
/// nanoseconds. After a longer pause the light jumps.
pub(crate) const MAX_INTERVAL_NANOS: i64 = 2_000_000_000;

/// The lights between which a frame's light is interpolated.
#[derive(Clone)]
pub struct LightSpan {
    /// The light at weight 0.
    pub from: Arc<Lighting>,
    /// The light at weight 1.
    pub to: Arc<Lighting>,
    /// Share of `to`, 0 to 1.
    pub weight: f32,
    /// Time between the environment pictures of both, nanoseconds; `None` where the light is not
    /// interpolated: there is one, it jumps, or newer pictures are missing.
    pub interval_nanos: Option<i64>,
}

impl LightSpan {
    /// Returns both ends for the compositor.
    #[must_use]
    pub fn ends(&self) -> penumbra_compositor::LightSpan<'_> {
        penumbra_compositor::LightSpan {
            from: &self.from,
            to: &self.to,
            weight: self.weight,
        }
    }
}

/// Two states and a weight.
#[derive(Clone, Copy)]
pub(crate) struct Blend<'a> {
    pub from: &'a LightState,
    pub to: &'a LightState,
    pub weight: f32,
    pub interval_nanos: Option<i64>,
}

impl<'a> Blend<'a> {
    /// One state alone.
    pub const fn single(state: &'a LightState) -> Self {
        Self {
            from: state,
            to: state,
            weight: 1.0,
            interval_nanos: None,
        }
    }
}

/// Blends states into recycled buffers.
#[derive(Default)]
pub(crate) struct LightMixer {
    lighting: Blender,
    indirect: IndirectLightBlender,
}

impl LightMixer {
    /// Returns the light of a frame. Everything that is not interpolated (sources and white
    /// balance, for the status) is that of the later state, as soon as it has any share.
    pub fn mix(&mut self, blend: Blend<'_>) -> LightState {
        let Blend {
            from,
            to,
            weight,
            interval_nanos,
        } = blend;
        let (Some(a), Some(b)) = (&from.lighting, &to.lighting) else {
            return to.clone();
        };
        let indirect = match (&from.indirect, &to.indirect) {
            (Some(a), Some(b)) => Some(self.indirect.blend(a, b, weight)),
            _ => to.indirect.clone(),
        };
        LightState {
            lighting: Some(self.lighting.blend(a, b, weight)),
            indirect,
            span: Some(LightSpan {
                from: Arc::clone(a),
                to: Arc::clone(b),
                weight,
                interval_nanos,
            }),
            ..if weight > 0.0 { to } else { from }.clone()
        }
    }
}

/// Returns the time between the environment pictures of two lights, nanoseconds, if the light may
/// be interpolated between them: the second is later, not by more than [`MAX_INTERVAL_NANOS`],
/// both have the same structure, and the real light has not jumped.
pub(crate) fn interval(from: &LightState, to: &LightState) -> Option<i64> {
    let (from, to) = (from.lighting.as_deref()?, to.lighting.as_deref()?);
    let nanos = to.captured_at.nanos_since(from.captured_at);
    let is_gradual = (1..=MAX_INTERVAL_NANOS).contains(&nanos)
        && penumbra_lighting::blend::can_blend(from, to)
        && !penumbra_lighting::blend::has_jumped(from, to);
    is_gradual.then_some(nanos)
}

/// Share of an interval that has passed at `at`, 0 to 1; 1 for an interval without length.
pub(crate) fn share(at: MonotonicTime, [starts, ends]: [MonotonicTime; 2]) -> f32 {
    let length = ends.nanos_since(starts);
    if length <= 0 {
        return 1.0;
    }
    (at.nanos_since(starts) as f64 / length as f64).clamp(0.0, 1.0) as f32
}
