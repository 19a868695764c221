//! Estimates the energy of sources that even the shortest exposure clips.

use super::resample::PixelDirections;
use super::settings::{ClippedEnergy, EnvironmentInput};
use super::sources::LUMINANCE;
use glam::Vec3;
use penumbra_numerics::smoothstep;
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

/// Share of a picture in the mean energy of a source's clipped pixels.
const SHARE: f32 = 0.1;
/// Change of that energy, logarithm, up to which it is noise: one pixel more or fewer of a small source
/// clips; and from which it is the source's own.
const NOISE: (f32, f32) = (0.3, 0.6);

/// A source whose clipped pixels are raised.
#[derive(Clone, Copy, Debug)]
struct RaisedSource {
    /// Unit vector from the observer.
    direction: Vec3,
    /// Factor on its mean energy.
    factor: Vec3,
    /// Mean luminance times solid angle of its clipped pixels, before they are raised.
    energy: f32,
    /// The same in the newest picture.
    newest: f32,
    /// Number of pictures in the mean.
    pictures: f32,
}

impl RaisedSource {
    /// Takes the newest picture into the mean.
    fn follow(&mut self) {
        if self.newest <= 0.0 {
            return;
        }
        let change = (self.newest / self.energy.max(f32::MIN_POSITIVE))
            .ln()
            .abs();
        let share = SHARE.max((self.pictures + 1.0).recip());
        let share = share + (1.0 - share) * smoothstep(NOISE.0, NOISE.1, change);
        self.energy += (self.newest - self.energy) * share;
        self.pictures = (self.pictures + 1.0).min(share.recip());
    }

    /// The factor on the clipped pixels of the newest picture.
    fn on_pixels(&self) -> Vec3 {
        self.factor * (self.energy / self.newest.max(f32::MIN_POSITIVE))
    }
}

/// The sources whose clipped pixels are raised to the energy that shadows tell.
#[derive(Clone, Debug, Default)]
pub(super) struct RaisedSources {
    all: Vec<RaisedSource>,
}

impl RaisedSources {
    /// Replaces them by sources in directions (unit vectors from the observer) with factors on their
    /// clipped pixels. One that was here before keeps its mean.
    pub fn set(&mut self, factors: impl Iterator<Item = (Vec3, Vec3)>) {
        let before = std::mem::take(&mut self.all);
        self.all.extend(factors.map(|(direction, factor)| {
            let known = nearest(before.iter().map(|s| s.direction), direction).map(|k| before[k]);
            RaisedSource {
                direction,
                factor,
                energy: known.map_or(0.0, |s| s.energy),
                newest: 0.0,
                pictures: known.map_or(0.0, |s| s.pictures),
            }
        }));
    }

    /// Multiplies each clipped pixel of `radiance` by the factor of the source nearest to it.
    pub fn raise(&mut self, pixels: &PixelDirections, radiance: &mut [Vec3], clipped: &[u32]) {
        self.all.iter_mut().for_each(|source| source.newest = 0.0);
        for &i in clipped {
            let i = i as usize;
            if let Some(k) = self.nearest(pixels.directions[i]) {
                self.all[k].newest += radiance[i].dot(LUMINANCE) * pixels.solid_angles[i];
            }
        }
        self.all.iter_mut().for_each(RaisedSource::follow);
        for &i in clipped {
            if let Some(factor) = self.factor_at(pixels.directions[i as usize]) {
                radiance[i as usize] *= factor;
            }
        }
    }

    /// The factor on a clipped pixel in `direction` of the newest picture.
    pub fn factor_at(&self, direction: Vec3) -> Option<Vec3> {
        let nearest = self.nearest(direction)?;
        Some(self.all[nearest].on_pixels())
    }

    fn nearest(&self, direction: Vec3) -> Option<usize> {
        nearest(self.all.iter().map(|s| s.direction), direction)
    }
}

/// The number of the direction that is nearest to another, if it is near enough.
fn nearest(all: impl Iterator<Item = Vec3>, direction: Vec3) -> Option<usize> {
    let apart = all.map(|d| d.distance_squared(direction)).enumerate();
    let (nearest, apart) = apart.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (apart < NEAR_SOURCE * NEAR_SOURCE).then_some(nearest)
}

/// The factor on a clipped pixel in `direction`: that of the nearest source, if it is near enough.
/// `factors`: unit vectors towards sources, and their factors.
#[must_use]
pub fn nearest_factor(factors: &[(Vec3, Vec3)], direction: Vec3) -> Option<Vec3> {
    let nearest = nearest(factors.iter().map(|(source, _)| *source), direction)?;
    Some(factors[nearest].1)
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
