//! Lamps: one shadow ray to each, and both responses of real surfaces.

use super::surface::{Reference, Surface};
use glam::{DVec3, Vec3};
use penumbra_scene::PlacedLamp;
use std::f64::consts::PI;

/// The light of a lamp at a surface.
pub(super) struct LampLight {
    /// Unit vector to the lamp.
    to: DVec3,
    /// Irradiance facing the lamp, with its shadow.
    facing: DVec3,
    /// Whether nothing blocks the lamp.
    pub seen: bool,
}

impl Reference {
    /// Returns the light of each of `lamps`; shadows reduce it by `strength`.
    pub(super) fn lamps(
        &self,
        surface: &Surface,
        lamps: &[PlacedLamp],
        strength: f32,
    ) -> Vec<LampLight> {
        let lamp_light = |lamp: &PlacedLamp| {
            let off = lamp.position - surface.point;
            let (to, distance) = (off.normalize(), off.length());
            let seen = surface.normal.dot(to.as_dvec3()) <= 0.0 || self.sees(surface, to, distance);
            let open = if seen { 1.0 } else { 1.0 - strength };
            LampLight {
                to: to.as_dvec3(),
                facing: (lamp.intensity * lamp.falloff(-to) * open).as_dvec3()
                    / f64::from(distance).powi(2),
                seen,
            }
        };
        lamps.iter().map(lamp_light).collect()
    }
}

/// Irradiance from all lamps.
pub(super) fn irradiance(normal: DVec3, lamps: &[LampLight]) -> DVec3 {
    let each = lamps.iter().map(|l| l.facing * normal.dot(l.to).max(0.0));
    each.sum()
}

/// Below this cosine the light fades to zero, as a surface turns into its own shadow.
const GRAZING: f64 = 0.1;

/// The paper's response to a lamp along the unit vector `to` (DiVerdi and Höllerer 2004, section
/// 4.2), as a fraction of the light of a white surface that faces the lamp: `additive` is N·L,
/// `intensity` that of the video, `brightest` the direction of the brightest physical light times
/// its dominance.
#[must_use]
pub fn response(to: DVec3, additive: f64, intensity: f64, brightest: DVec3) -> f64 {
    let alpha = brightest.dot(to).clamp(-1.0, 1.0);
    let multiplicative = if alpha < 0.0 {
        1.0 - intensity
    } else {
        intensity
    };
    let share = alpha.abs();
    let response = (1.0 - share) * additive.max(0.0) + share * multiplicative;
    response * (additive / GRAZING).clamp(0.0, 1.0)
}

/// Light that lamps add to a real surface of diffuse reflectance `surface.albedo` (white if
/// unknown) which shows `video`, linear.
pub(super) fn added_by_paper(
    surface: &Surface,
    lamps: &[LampLight],
    brightest: Vec3,
    video: DVec3,
) -> DVec3 {
    let intensity = video.dot(DVec3::new(0.2126, 0.7152, 0.0722));
    let brightest = brightest.clamp_length_max(1.0).as_dvec3();
    let each = lamps.iter().map(|l| {
        let additive = surface.normal.dot(l.to);
        l.facing * response(l.to, additive, intensity, brightest)
    });
    surface.albedo * each.sum::<DVec3>() / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(alpha: f64, additive: f64, intensity: f64) -> f64 {
        response(DVec3::X, additive, intensity, DVec3::X * alpha)
    }

    /// The paper: "close to one, most of the contribution is from the multiplicative factor,
    /// close to zero, from the additive factor, and when it is negative one, the inverse of the
    /// multiplicative factor is used".
    #[test]
    fn response_matches_the_papers_three_cases() {
        for additive in [0.2, 0.7, 1.0] {
            for intensity in [0.0, 0.25, 1.0] {
                assert!((at(1.0, additive, intensity) - intensity).abs() < 1e-12);
                assert!((at(0.0, additive, intensity) - additive).abs() < 1e-12);
                assert!((at(-1.0, additive, intensity) - (1.0 - intensity)).abs() < 1e-12);
                let half = 0.5 * (additive + intensity);
                assert!((at(0.5, additive, intensity) - half).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn response_without_dominance_is_the_cosine() {
        for to in [DVec3::X, DVec3::NEG_X, DVec3::Z] {
            assert_eq!(response(to, 0.6, 0.1, DVec3::ZERO), 0.6);
        }
    }

    #[test]
    fn lamp_behind_a_surface_adds_no_light() {
        for alpha in [-1.0, 0.0, 1.0] {
            assert_eq!(at(alpha, -0.2, 0.5), 0.0);
            assert_eq!(at(alpha, 0.0, 0.5), 0.0);
        }
    }
}
