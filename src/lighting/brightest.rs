//! The brightest light of the real scene, and how dominant it is.
//!
//! DiVerdi and Höllerer (2004, section 4.2) read the small bumps of a surface from its picture:
//! with one light source the picture is the relief lit from that source's side. With several
//! sources, or with uniform light, the picture shows no direction, and "the result is equivalent to
//! normal blending" (section 4.4). The dominance says how far this interpretation of a picture
//! holds.

use super::{DomeLight, LightKind, sources::LUMINANCE};
use glam::Vec3;
use penumbra_numerics::smoothstep;
use std::f32::consts::TAU;

/// The direction from which relief in the picture is lit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BrightestLight {
    /// Unit vector to it, world; zero if no light stands out.
    pub direction: Vec3,
    /// How much brighter it is than light from elsewhere, as a share of all light: 1 for the sun
    /// alone, 0 for two equal lamps and for uniform light.
    pub dominance: f32,
}

/// Lights up to this angle apart, radians, belong to one group.
const SAME_GROUP_RADIANS: f32 = 0.52;
/// Lights at least this angle apart, radians, belong to two groups.
const TWO_GROUPS_RADIANS: f32 = 1.05;
/// Mean-shift iterations towards the group's centre.
const STEPS: usize = 8;

impl BrightestLight {
    /// Finds the brightest of the dome lights `lights`.
    ///
    /// ```text
    ///   F_i = luminance of C_i, less the uniform light: Ω_i · median radiance of the cells
    ///   S(d) = Σ F_i · max(d·l_i, 0)⁸          light from around d
    ///   direction = d₁, where S is largest     (mean shift from the brightest light)
    ///   dominance = (S(d₁) − max S(l_j) · apart(l_j, d₁)) / Σ luminance of C_i
    /// ```
    ///
    /// When another light, well apart, becomes the brightest, both have the same S, so the
    /// dominance is 0 and the result is continuous.
    #[must_use]
    pub fn from_lights(lights: &[DomeLight]) -> Self {
        let total: f32 = lights.iter().map(luminance).sum();
        let ambient = ambient_radiance(lights);
        let light_around = |d: Vec3| -> f32 {
            let parts = lights.iter().map(|l| excess(l, ambient) * lobe(d, l));
            parts.sum()
        };
        let distinct = || lights.iter().filter(|l| excess(l, ambient) > 0.0);
        let best = distinct()
            .map(|l| (light_around(l.direction), l.direction))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, start)) = best.filter(|_| total > 0.0) else {
            return Self::default();
        };
        let direction = (0..STEPS).fold(start, |d, _| shifted(d, lights, ambient));
        let second = distinct()
            .map(|l| light_around(l.direction) * apart(direction, l.direction))
            .fold(0.0, f32::max);
        Self {
            direction,
            dominance: ((light_around(direction) - second) / total).clamp(0.0, 1.0),
        }
    }

    /// Direction times dominance: its dot product with the direction to a lamp is the paper's
    /// weight of the multiplicative factor, scaled by the dominance.
    #[must_use]
    pub fn vector(&self) -> Vec3 {
        self.direction * self.dominance
    }
}

impl From<Vec3> for BrightestLight {
    /// The light with this [`BrightestLight::vector`].
    fn from(vector: Vec3) -> Self {
        Self {
            direction: vector.normalize_or_zero(),
            dominance: vector.length().min(1.0),
        }
    }
}

fn luminance(light: &DomeLight) -> f32 {
    light.irradiance.dot(LUMINANCE).max(0.0)
}

fn solid_angle(light: &DomeLight) -> f32 {
    TAU * (1.0 - light.angular_radius.cos())
}

/// Luminance of a light in excess of its share of the uniform light.
fn excess(light: &DomeLight, ambient: f32) -> f32 {
    match light.kind {
        LightKind::Compact => luminance(light),
        LightKind::Cell => (luminance(light) - ambient * solid_angle(light)).max(0.0),
    }
}

/// Median radiance of the cells, by solid angle; 0 if there are none.
fn ambient_radiance(lights: &[DomeLight]) -> f32 {
    let cells = || {
        let lit = |l: &&DomeLight| {
            l.kind == LightKind::Cell && l.angular_radius > 0.0 && luminance(l) > 0.0
        };
        let cells = lights.iter().filter(lit);
        cells.map(|l| (luminance(l) / solid_angle(l), solid_angle(l)))
    };
    let half = 0.5 * cells().map(|c| c.1).sum::<f32>();
    // No sorting, hence no allocation: there are a few hundred lights at most.
    let up_to = |radiance: f32| {
        let darker = cells().filter(|c| c.0 <= radiance);
        darker.map(|c| c.1).sum::<f32>()
    };
    let upper = cells().map(|c| c.0).filter(|r| up_to(*r) >= half);
    upper.min_by(f32::total_cmp).unwrap_or(0.0)
}

fn lobe(d: Vec3, light: &DomeLight) -> f32 {
    d.dot(light.direction).max(0.0).powi(8)
}

/// Moves `d` towards the centre of the group around it.
fn shifted(d: Vec3, lights: &[DomeLight], ambient: f32) -> Vec3 {
    let weighed = |l: &DomeLight| l.direction * (excess(l, ambient) * lobe(d, l));
    let sum: Vec3 = lights.iter().map(weighed).sum();
    sum.try_normalize().unwrap_or(d)
}

/// 0 for directions of one group, 1 for those of two.
fn apart(a: Vec3, b: Vec3) -> f32 {
    let angle = a.dot(b).clamp(-1.0, 1.0).acos();
    smoothstep(SAME_GROUP_RADIANS, TWO_GROUPS_RADIANS, angle)
}

/// Time constant of the smoothing, seconds.
const TIME_CONSTANT_SECONDS: f64 = 0.4;
/// Maximum time step, seconds: longer ones are a pause or another recording.
const MAX_STEP_SECONDS: f64 = 1.0;

/// Follows the brightest light smoothly, in the recording's time.
///
/// The vector is smoothed, so the effect fades out and in again when another light becomes the
/// brightest, instead of sweeping over the directions between.
#[derive(Clone, Debug, Default)]
pub struct BrightestFollower {
    vector: Vec3,
    wanted: Vec3,
    generation: Option<u64>,
    last_seconds: Option<f64>,
}

impl BrightestFollower {
    /// Returns the brightest light for a picture taken at `seconds` in the light of this
    /// `generation`; `lights` are analysed only if that is new. The first light is taken
    /// unsmoothed.
    pub fn follow(
        &mut self,
        generation: u64,
        lights: &[DomeLight],
        seconds: f64,
    ) -> BrightestLight {
        if self.generation != Some(generation) {
            self.wanted = BrightestLight::from_lights(lights).vector();
            if self.generation.is_none() {
                self.vector = self.wanted;
            }
            self.generation = Some(generation);
        }
        let last = self.last_seconds.replace(seconds).unwrap_or(seconds);
        let passed = (seconds - last).clamp(0.0, MAX_STEP_SECONDS);
        let left = (-passed / TIME_CONSTANT_SECONDS).exp() as f32;
        self.vector = self.wanted + (self.vector - self.wanted) * left;
        self.vector.into()
    }
}

#[cfg(test)]
mod tests {
    use super::super::LightPlace;
    use super::*;
    use proptest::prelude::*;

    fn lamp(direction: Vec3, strength: f32) -> DomeLight {
        DomeLight {
            direction: direction.normalize(),
            irradiance: Vec3::splat(strength),
            angular_radius: 0.01,
            kind: LightKind::Compact,
            place: LightPlace::FAR,
        }
    }

    /// A uniform dome of 200 cells with an irradiance of `strength` on the ground.
    fn sky(strength: f32) -> Vec<DomeLight> {
        let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
        let cell = |i: u16| {
            let z = 1.0 - (f32::from(i) + 0.5) / 200.0;
            let (sin, cos) = (golden * f32::from(i)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            DomeLight {
                direction: Vec3::new(r * cos, r * sin, z),
                irradiance: Vec3::splat(2.0 * strength / 200.0),
                angular_radius: (1.0 - 1.0 / 200.0_f32).acos(),
                kind: LightKind::Cell,
                place: LightPlace::FAR,
            }
        };
        (0..200).map(cell).collect()
    }

    fn dominance(lights: &[DomeLight]) -> f32 {
        BrightestLight::from_lights(lights).dominance
    }

    #[test]
    fn single_sun_has_full_dominance() {
        let to = Vec3::new(0.3, -0.5, 0.8).normalize();
        let found = BrightestLight::from_lights(&[lamp(to, 4.0)]);
        assert!((found.dominance - 1.0).abs() < 1e-5, "{found:?}");
        assert!(found.direction.angle_between(to) < 1e-3);
    }

    #[test]
    fn uniform_light_has_no_direction() {
        assert!(dominance(&sky(3.0)) < 1e-4);
        assert_eq!(dominance(&[]), 0.0);
        assert_eq!(
            BrightestLight::from_lights(&[lamp(Vec3::Z, 0.0)]).vector(),
            Vec3::ZERO
        );
    }

    #[test]
    fn sun_in_uniform_sky_has_its_share_as_dominance() {
        // Each cell of the sky facing its light: twice the irradiance on the ground.
        let to = Vec3::new(-0.6, 0.0, 0.8);
        let mut lights = sky(1.0);
        lights.push(lamp(to, 5.0));
        let found = BrightestLight::from_lights(&lights);
        assert!((found.dominance - 5.0 / 7.0).abs() < 0.01, "{found:?}");
        assert!(found.direction.angle_between(to) < 0.01);
    }

    #[test]
    fn equal_lamps_cancel_if_far_apart_and_combine_if_close() {
        let at = |degrees: f32, strength| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            lamp(Vec3::new(sin, 0.0, cos), strength)
        };
        assert!(dominance(&[at(-45.0, 2.0), at(45.0, 2.0)]) < 1e-4);
        // The second has half the light: 1 − ½ of 1½.
        assert!((dominance(&[at(-45.0, 2.0), at(45.0, 1.0)]) - 1.0 / 3.0).abs() < 0.01);
        let pair = BrightestLight::from_lights(&[at(10.0, 2.0), at(20.0, 2.0)]);
        assert!(pair.dominance > 0.95, "{pair:?}");
        assert!(pair.direction.angle_between(at(15.0, 1.0).direction) < 0.02);
    }

    #[test]
    fn vector_is_continuous_where_brightest_light_changes() {
        for between in [70.0_f32, 90.0, 120.0] {
            let (sin, cos) = (between.to_radians() * 0.5).sin_cos();
            let vector = |share: f32| {
                let lights = [
                    lamp(Vec3::new(sin, 0.0, cos), share),
                    lamp(Vec3::new(-sin, 0.0, cos), 1.0 - share),
                ];
                BrightestLight::from_lights(&lights).vector()
            };
            for k in 0..200 {
                let (a, b) = (vector(k as f32 / 200.0), vector((k + 1) as f32 / 200.0));
                assert!(a.distance(b) < 0.02, "{between}°, {k}: {a} {b}");
            }
        }
    }

    #[test]
    fn change_is_followed_with_time_constant() {
        let (a, b) = ([lamp(Vec3::X, 1.0)], [lamp(Vec3::Z, 1.0)]);
        let mut follower = BrightestFollower::default();
        assert!(follower.follow(1, &a, 3.0).vector().distance(Vec3::X) < 1e-5);
        assert!(follower.follow(2, &b, 3.0).vector().distance(Vec3::X) < 1e-5);
        let after = follower.follow(2, &b, 3.0 + TIME_CONSTANT_SECONDS).vector();
        let left = (-1.0_f32).exp();
        assert!(after.distance(Vec3::X * left + Vec3::Z * (1.0 - left)) < 1e-5);
        // A time before the last one counts as no time, long pauses as one second.
        assert!(follower.follow(2, &b, 0.0).vector().distance(after) < 1e-5);
        let later = follower.follow(2, &b, 1e6).vector();
        assert!(later.distance(Vec3::Z) < 0.1 && later.distance(Vec3::Z) > 0.01);
    }

    proptest! {
        #[test]
        fn vector_is_never_longer_than_one(
            lights in proptest::collection::vec(
                ((-1.0f32..1.0, -1.0f32..1.0, 0.01f32..1.0), 0.0f32..1e6, 0.0f32..1.5, any::<bool>()),
                0..40,
            ),
        ) {
            let lights: Vec<DomeLight> = lights
                .into_iter()
                .map(|((x, y, z), strength, angular_radius, cell)| DomeLight {
                    angular_radius,
                    kind: if cell { LightKind::Cell } else { LightKind::Compact },
                    ..lamp(Vec3::new(x, y, z), strength)
                })
                .collect();
            let found = BrightestLight::from_lights(&lights);
            prop_assert!(found.vector().is_finite());
            prop_assert!((0.0..=1.0).contains(&found.dominance));
            let unit = found.direction.length();
            prop_assert!(unit == 0.0 || (unit - 1.0).abs() < 1e-3);
        }
    }
}
