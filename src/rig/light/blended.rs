//! Blends two states of the light for a frame.

use crate::light::state::LightState;
use penumbra_interface::MonotonicTime;
use penumbra_lighting::Blender;
use penumbra_lighting::blend::{can_blend, has_jumped};
use penumbra_scene::IndirectLightBlender;

/// Maximum time between two environment pictures between which light is interpolated,
/// nanoseconds. After a longer pause the light jumps.
pub(crate) const MAX_INTERVAL_NANOS: i64 = 2_000_000_000;

/// Two states and a weight.
#[derive(Clone, Copy)]
pub(crate) struct Blend<'a> {
    pub from: &'a LightState,
    pub to: &'a LightState,
    pub weight: f32,
}

impl<'a> Blend<'a> {
    /// One state alone.
    pub const fn single(state: &'a LightState) -> Self {
        Self {
            from: state,
            to: state,
            weight: 1.0,
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
        let Blend { from, to, weight } = blend;
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
            ..if weight > 0.0 { to } else { from }.clone()
        }
    }
}

/// Returns the time between the environment pictures of two lights, nanoseconds, if the light may
/// be interpolated between them: the second is later, not by more than [`MAX_INTERVAL_NANOS`],
/// both have the same structure, and the real light has not jumped. `pictures`: see [`has_jumped`].
pub(crate) fn interval(from: &LightState, to: &LightState, pictures: u32) -> Option<i64> {
    let (from, to) = (from.lighting.as_deref()?, to.lighting.as_deref()?);
    let nanos = to.captured_at.nanos_since(from.captured_at);
    let is_gradual = (1..=MAX_INTERVAL_NANOS).contains(&nanos)
        && can_blend(from, to)
        && !has_jumped(from, to, pictures);
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
