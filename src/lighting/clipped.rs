//! What is done about sources that even the shortest exposure clips.

use super::resample::PixelDirections;
use super::settings::EnvironmentInput;
use glam::Vec3;
use std::f32::consts::PI;

/// How the energy of clipped pixels is estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClippedEnergy {
    /// They are taken at their clipped value.
    Keep,
    /// They are this many times as bright as their clipped value, up to `most_solid_angle`
    /// steradians in all; a larger clipped region (an overexposed sky) is kept.
    Factor {
        /// At least 1.
        factor: f32,
        /// Steradians.
        most_solid_angle: f32,
    },
    /// As bright as it takes for the ground's irradiance to be what was measured (see
    /// [`EnvironmentInput::measured_ground_irradiance`]); without a measurement, and with
    /// a sphere in the scene camera's picture, as bright as the shadows in that picture
    /// say; else they are kept.
    Measured {
        /// Never more than this factor.
        most: f32,
    },
}

impl Default for ClippedEnergy {
    fn default() -> Self {
        Self::Measured { most: 1e5 }
    }
}

/// Raises clipped pixels of `radiance` (environment camera units).
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
            most_solid_angle,
        } => {
            let size: f32 = clipped
                .iter()
                .map(|&i| pixels.solid_angles[i as usize])
                .sum();
            Vec3::splat(if size <= most_solid_angle {
                factor.max(1.0)
            } else {
                1.0
            })
        }
        ClippedEnergy::Measured { most } => match input.measured_ground_irradiance {
            Some(measured) => {
                missing(pixels, radiance, clipped, input, measured).min(Vec3::splat(most))
            }
            None => match from_shadows {
                Some(factor) => Vec3::splat(factor.min(most)),
                None => return,
            },
        },
    };
    for &i in clipped {
        radiance[i as usize] *= factor;
    }
}

/// The factor by which clipped pixels must be brighter for the ground to receive
/// `measured`, per channel.
///
/// ```text
///  E = s (E_rest + f E_clipped)  ⇒  f = (E/s − E_rest) / E_clipped,   s = π / ∫ cos⁺ dω
/// ```
/// where s makes up for directions that are not seen.
fn missing(
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
