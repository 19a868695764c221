//! Estimates the energy of sources that even the shortest exposure clips.

use super::resample::PixelDirections;
use super::settings::{ClippedEnergy, EnvironmentInput};
use glam::Vec3;
use std::f32::consts::PI;

/// Multiplies clipped pixels of `radiance` (environment camera units).
pub(super) fn boost(
    method: &ClippedEnergy,
    pixels: &PixelDirections,
    radiance: &mut [Vec3],
    clipped: &[u32],
    input: &EnvironmentInput,
    from_shadows: Option<f32>,
) {
    if clipped.is_empty() {
        return;
    }
    let factor = match *method {
        ClippedEnergy::Keep => return,
        ClippedEnergy::Factor {
            factor,
            max_solid_angle,
        } => {
            let size: f32 = clipped
                .iter()
                .map(|&i| pixels.solid_angles[i as usize])
                .sum();
            Vec3::splat(if size <= max_solid_angle {
                factor.max(1.0)
            } else {
                1.0
            })
        }
        ClippedEnergy::Measured { max_factor } => match input.measured_ground_irradiance {
            Some(measured) => required_factor(pixels, radiance, clipped, input, measured)
                .min(Vec3::splat(max_factor)),
            None => match from_shadows {
                Some(factor) => Vec3::splat(factor.min(max_factor)),
                None => return,
            },
        },
    };
    for &i in clipped {
        radiance[i as usize] *= factor;
    }
}

/// Largest angle between a clipped pixel and the source to which it belongs, radians.
const NEAR_SOURCE: f32 = 0.35;

/// Multiplies each clipped pixel of `radiance` by the factor of the source nearest to it.
pub(super) fn raise(
    factors: &[(Vec3, Vec3)],
    pixels: &PixelDirections,
    radiance: &mut [Vec3],
    clipped: &[u32],
) {
    for &i in clipped {
        if let Some(factor) = nearest_factor(factors, pixels.directions[i as usize]) {
            radiance[i as usize] *= factor;
        }
    }
}

/// The factor on a clipped pixel in `direction`: that of the nearest source, if it is near enough.
/// `factors`: unit vectors towards sources, and their factors.
#[must_use]
pub fn nearest_factor(factors: &[(Vec3, Vec3)], direction: Vec3) -> Option<Vec3> {
    let apart = |(source, _): &&(Vec3, Vec3)| source.distance(direction);
    let nearest = factors
        .iter()
        .min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
    (apart(&nearest) < NEAR_SOURCE).then_some(nearest.1)
}

/// Returns the factor on clipped pixels for which the ground receives `measured`, per channel.
///
/// ```text
///  E = s (E_rest + f E_clipped)  ⇒  f = (E/s − E_rest) / E_clipped,   s = π / ∫ cos⁺ dω
/// ```
/// where s compensates for directions that are not seen.
fn required_factor(
    pixels: &PixelDirections,
    radiance: &[Vec3],
    clipped: &[u32],
    input: &EnvironmentInput,
    measured: Vec3,
) -> Vec3 {
    let cosine = |i: usize| pixels.directions[i].z.max(0.0) * pixels.solid_angles[i];
    let (mut all, mut seen) = (Vec3::ZERO, 0.0);
    for (i, l) in radiance.iter().enumerate() {
        all += *l * cosine(i);
        seen += cosine(i);
    }
    let bright: Vec3 = clipped
        .iter()
        .map(|&i| radiance[i as usize] * cosine(i as usize))
        .sum();
    let scale = PI / seen.max(1e-3);
    let wanted = input.gains.inverse() * measured;
    let factor = (wanted / scale - (all - bright)) / bright.max(Vec3::splat(1e-9));
    Vec3::select(
        bright.cmpgt(Vec3::splat(1e-6)),
        factor.max(Vec3::ONE),
        Vec3::ONE,
    )
}
