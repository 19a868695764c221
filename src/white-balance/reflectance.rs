//! Gains from surfaces of known reflectance, whose colour the measured light predicts.

use super::chart::Photograph;
use super::gains::GainEstimate;
use super::robust_mean::{LogRatio, RobustMean, robust_mean};
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_lighting::{LightKind, Lighting};
use penumbra_scene::{Hit, RayCaster};
use std::f64::consts::PI;

/// A diffuse surface in the scene camera's picture whose albedo and irradiance are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownSurface {
    /// Mean in the scene camera's picture, linear.
    pub scene: DVec3,
    /// Diffuse reflectance.
    pub albedo: DVec3,
    /// Irradiance with shadows, in the environment camera's units (see [`irradiance_at`]).
    pub irradiance: DVec3,
    /// Expected variance of ln(scene / irradiance), from noise and texture.
    pub variance: f64,
    /// Neighbours on one surface share a cluster.
    pub cluster: u32,
}

/// Relative standard deviations of albedo and irradiance; the error is the same for all surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReflectanceOptions {
    /// Albedo: 0.02 for a grey card, 0.1 for a guess.
    pub albedo_sd: f64,
    /// Irradiance: clipped sources and indirect light.
    pub irradiance_sd: f64,
}

impl Default for ReflectanceOptions {
    fn default() -> Self {
        Self {
            albedo_sd: 0.05,
            irradiance_sd: 0.08,
        }
    }
}

/// Minimum number of surfaces.
const MIN_SURFACES: usize = 4;

// ┌ A diffuse surface shows  scene = gain · albedo · E / π  (Lambert), so                ┐
// └ ln gain = ln(π scene / (albedo E)), E in environment units.                          ┘

/// Estimates the gains that explain the surfaces' colours; `None` with fewer than four usable
/// surfaces.
#[must_use]
pub fn estimate_reflectance(
    surfaces: &[KnownSurface],
    options: &ReflectanceOptions,
) -> Option<GainEstimate> {
    let channel = |c: usize| {
        let ratios: Vec<LogRatio> = surfaces
            .iter()
            .map(|s| LogRatio {
                value: (PI * s.scene[c] / (s.albedo[c] * s.irradiance[c])).ln(),
                variance: s.variance,
                cluster: s.cluster,
            })
            .collect();
        robust_mean(&ratios).filter(|m| m.inliers >= MIN_SURFACES)
    };
    let channels = [channel(0)?, channel(1)?, channel(2)?];
    let by_channel =
        |f: fn(&RobustMean) -> f64| DVec3::from_array([0, 1, 2].map(|c| f(&channels[c])));
    let systematic = options.albedo_sd.hypot(options.irradiance_sd);
    // A single cluster has no scatter between clusters: its robust standard deviation is used.
    let error = |m: &RobustMean| if m.sd.is_finite() { m.sd } else { m.spread };
    Some(GainEstimate {
        gains: by_channel(|m| m.mean).exp(),
        relative_sd: DVec3::from_array(channels.map(|m| error(&m).hypot(systematic))),
    })
}

/// The reverse check: the albedo that a surface must have under these gains, per channel.
/// A value above 1, or far from the surface's apparent reflectance, indicates wrong gains or light.
#[must_use]
pub fn implied_albedo(scene: DVec3, irradiance: DVec3, gains: DVec3) -> DVec3 {
    PI * scene / (gains * irradiance)
}

/// Mean albedo of everyday surfaces and its relative standard deviation.
const TYPICAL_ALBEDO: f64 = 0.3;
const TYPICAL_ALBEDO_SD: f64 = 0.5;

/// Estimates gains from the assumption that the surfaces in view are grey on average and reflect
/// 30 % (grey world, Buchsbaum 1980); relative standard error 0.5. `None` where a gain would not be
/// positive.
#[must_use]
pub fn grey_world(mean_scene: DVec3, irradiance: DVec3) -> Option<GainEstimate> {
    let gains = PI * mean_scene / (TYPICAL_ALBEDO * irradiance);
    let usable = gains.is_finite() && gains.min_element() > 0.0;
    usable.then_some(GainEstimate {
        gains,
        relative_sd: DVec3::splat(TYPICAL_ALBEDO_SD),
    })
}

/// Irradiance with shadows on a surface with unit `normal` (world), in the units of `lighting`.
///
/// `visibility` gives, for a unit direction towards a light, the fraction of the light
/// that nothing blocks (0..=1). Compact sources are shadowed one by one; the rest is the
/// unshadowed irradiance times the visible share of the dome's cells. If gains have already been
/// applied to `lighting`, an estimate from the result is the remaining correction
/// ([`GainEstimate::after`]).
#[must_use]
pub fn irradiance_at(lighting: &Lighting, normal: Vec3, visibility: impl Fn(Vec3) -> f32) -> DVec3 {
    let (mut compact, mut reached, mut all) = (Vec3::ZERO, 0.0f32, 0.0f32);
    for light in &lighting.lights {
        let facing = light.irradiance * normal.dot(light.direction).max(0.0);
        let seen = visibility(light.direction);
        match light.kind {
            LightKind::Compact => compact += seen * facing,
            LightKind::Cell => {
                all += facing.element_sum();
                reached += seen * facing.element_sum();
            }
        }
    }
    let visible = if all > 0.0 { reached / all } else { 1.0 };
    (compact + visible * lighting.irradiance.irradiance(normal)).as_dvec3()
}

/// [`irradiance_at`] a surface point that only the phantoms shadow.
#[must_use]
pub fn irradiance_past(caster: &RayCaster, lighting: &Lighting, hit: &Hit) -> DVec3 {
    // Lifted off the surface, so that it does not shadow itself.
    let origin = hit.point + 1e-4 * hit.normal;
    irradiance_at(lighting, hit.normal.as_vec3(), |direction| {
        f32::from(caster.nearest(origin, direction.as_dvec3()).is_none())
    })
}

/// The scene camera's picture and pose.
#[derive(Clone, Copy, Debug)]
pub struct SceneView<'a> {
    /// The picture.
    pub photograph: Photograph<'a>,
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// The camera's pose.
    pub world_from_camera: RigidTransform,
}

/// Side of the blocks that [`gather_known`] reads, pixels.
const BLOCK: u32 = 16;
/// Relative standard deviation of a textured surface's albedo about its stated mean.
const TEXTURE: f64 = 0.2;

/// Averages every surface with a stated albedo in the scene camera's picture, in blocks `spacing`
/// pixels apart. `irradiance` returns the irradiance at a hit; see [`irradiance_past`].
pub fn gather_known(
    view: &SceneView,
    caster: &RayCaster,
    spacing: u32,
    irradiance: impl Fn(&Hit) -> DVec3,
) -> Vec<KnownSurface> {
    let picture = view.photograph.picture;
    if (picture.width, picture.height) != (view.camera.width, view.camera.height) {
        return Vec::new();
    }
    let steps = |length: u32| {
        (BLOCK / 2..length.saturating_sub(BLOCK / 2)).step_by(spacing.max(1) as usize)
    };
    steps(picture.height)
        .flat_map(|y| steps(picture.width).map(move |x| (x, y)))
        .filter_map(|(x, y)| known_at(view, caster, &irradiance, x, y))
        .collect()
}

fn known_at(
    view: &SceneView,
    caster: &RayCaster,
    irradiance: &impl Fn(&Hit) -> DVec3,
    x: u32,
    y: u32,
) -> Option<KnownSurface> {
    let cast = |dx: f64, dy: f64| {
        let pixel = DVec2::new(f64::from(x) + dx, f64::from(y) + dy);
        let direction = view.world_from_camera.rotation * view.camera.unproject(pixel);
        caster.nearest(view.world_from_camera.translation, direction)
    };
    let hit = cast(0.0, 0.0)?;
    let albedo = caster.albedo(hit.surface).filter(|_| !hit.mirror)?;
    let edge = f64::from(BLOCK) * 0.5;
    for (dx, dy) in [(-edge, -edge), (edge, -edge), (-edge, edge), (edge, edge)] {
        let corner = cast(dx, dy)?;
        if corner.surface != hit.surface || corner.normal.dot(hit.normal) < 0.95 {
            return None;
        }
    }
    Some(KnownSurface {
        scene: mean_of_block(view.photograph, x, y)?,
        albedo,
        irradiance: irradiance(&hit),
        variance: TEXTURE * TEXTURE,
        cluster: hit.surface.wrapping_mul(0x9E37_79B1) ^ ((y / 96) << 8) ^ (x / 96),
    })
}

/// Mean of a block, linear; `None` where a pixel is clipped, which would bias the mean.
fn mean_of_block(photograph: Photograph, x: u32, y: u32) -> Option<DVec3> {
    let half = BLOCK / 2;
    let block = (y - half..y + half).flat_map(|v| (x - half..x + half).map(move |u| (u, v)));
    let mut sum = DVec3::ZERO;
    for (u, v) in block {
        let codes = photograph.picture.rgb(u, v);
        if codes.iter().any(|&code| code >= SATURATED) {
            return None;
        }
        let linear = photograph.response.linear_from_rgb(codes);
        sum += DVec3::from_array(linear.map(f64::from));
    }
    Some(sum / f64::from(BLOCK * BLOCK))
}

/// Lowest code that counts as clipped.
const SATURATED: u8 = 250;

#[cfg(test)]
mod tests {

    use super::*;
    use penumbra_interface::MonotonicTime;
    use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightPlace};
    use std::sync::Arc;

    fn surfaces(gains: DVec3, albedo: DVec3) -> Vec<KnownSurface> {
        (0..20)
            .map(|i| {
                let irradiance = DVec3::new(0.4, 0.5, 0.6) * (1.0 + 0.1 * f64::from(i));
                KnownSurface {
                    scene: gains * albedo * irradiance / PI,
                    albedo,
                    irradiance,
                    variance: 1e-4,
                    cluster: i,
                }
            })
            .collect()
    }

    #[test]
    fn grey_card_yields_exact_gains() {
        let gains = DVec3::new(4.9, 4.1, 3.2);
        let mut card = surfaces(gains, DVec3::splat(0.18));
        card[3].scene *= 0.2; // in an unknown shadow
        let found = estimate_reflectance(&card, &ReflectanceOptions::default()).unwrap();
        assert!(found.percent_from(gains).abs().max_element() < 1e-6);
        assert!((0.09..0.12).contains(&found.relative_sd.x));
        assert_eq!(
            estimate_reflectance(&card[..3], &ReflectanceOptions::default()),
            None
        );
    }

    #[test]
    fn implied_albedo_inverts_the_prediction() {
        let (gains, albedo) = (DVec3::new(4.9, 4.1, 3.2), DVec3::new(0.4, 0.3, 0.2));
        let surface = surfaces(gains, albedo)[0];
        let implied = implied_albedo(surface.scene, surface.irradiance, gains);
        assert!(implied.distance(albedo) < 1e-12);
    }

    #[test]
    fn grey_world_has_a_large_standard_error() {
        let guess = grey_world(DVec3::splat(0.3 / PI), DVec3::ONE).unwrap();
        assert!(guess.gains.distance(DVec3::ONE) < 1e-12);
        assert!(guess.relative_sd.min_element() >= 0.5);
        assert_eq!(grey_world(DVec3::splat(0.1), DVec3::ZERO), None);
        assert_eq!(grey_world(DVec3::ZERO, DVec3::ONE), None);
    }

    /// Radiance 1 from all directions, plus a lamp overhead of irradiance 2.
    fn lighting() -> Lighting {
        let mut irradiance = Harmonics::default();
        irradiance.coefficients[0] = Vec3::splat(std::f32::consts::PI);
        let light = |direction: Vec3, irradiance: f32, kind| DomeLight {
            direction,
            irradiance: Vec3::splat(irradiance),
            angular_radius: 0.1,
            kind,
            place: LightPlace::FAR,
        };
        Lighting {
            captured_at: MonotonicTime::default(),
            generation: 1,
            radiance: Arc::new(CubeMap {
                size: 1,
                levels: vec![vec![[1.0; 3]; 6]],
                ..CubeMap::default()
            }),
            irradiance,
            lights: vec![
                light(Vec3::Z, 2.0, LightKind::Compact),
                light(Vec3::new(0.6, 0.0, 0.8), 1.0, LightKind::Cell),
                light(Vec3::new(-0.6, 0.0, 0.8), 1.0, LightKind::Cell),
            ],
            ground_radiance: Vec3::ZERO,
            faces: None,
        }
    }

    #[test]
    fn recovers_gains_from_a_picture_of_grey_ground() {
        use glam::{DMat4, DQuat};
        use penumbra_camera::Response;
        use penumbra_picture::Picture;
        use penumbra_scene::primitives;
        use penumbra_scene::{Material, Part, Scene};
        let ground = Part {
            name: "card".into(),
            mesh: Arc::new(primitives::plane(4.0, 4.0)),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::IDENTITY,
            mirror: false,
            albedo: Some(Vec3::splat(0.18)),
        };
        let caster = RayCaster::from_phantoms(&Scene {
            phantom_parts: vec![ground],
            ground_height: Some(0.0),
            ..Scene::default()
        });
        let response = Response::linear();
        let code = 100u8;
        let mut rgba = [code, code, code, 255].repeat(128 * 128);
        rgba[..4 * 128 * 20].fill(255); // clipped glare
        let picture = Picture {
            width: 128,
            height: 128,
            rgba,
        };
        let camera = PinholeCamera {
            width: 128,
            height: 128,
            focal: DVec2::splat(120.0),
            centre: DVec2::splat(63.5),
            distortion: [0.0; 5],
        };
        let view = SceneView {
            photograph: Photograph {
                picture: &picture,
                response: &response,
            },
            camera: &camera,
            // Looks straight down from a metre.
            world_from_camera: RigidTransform::new(
                DQuat::from_rotation_x(PI),
                DVec3::new(0.0, 0.0, 1.0),
            ),
        };
        let lighting = lighting();
        let known = gather_known(&view, &caster, 16, |hit| {
            irradiance_past(&caster, &lighting, hit)
        });
        assert!(known.len() > 20);
        let found = estimate_reflectance(&known, &ReflectanceOptions::default()).unwrap();
        let ground_truth = PI * (100.0 / 255.0) / (0.18 * (PI + 2.0));
        let error = found.percent_from(DVec3::splat(ground_truth));
        assert!(error.abs().max_element() < 0.01, "{error}");
    }

    #[test]
    fn irradiance_counts_only_visible_light() {
        let lighting = lighting();
        let open = irradiance_at(&lighting, Vec3::Z, |_| 1.0);
        assert!((open.x - (PI + 2.0)).abs() < 1e-5);
        let lamp_hidden = irradiance_at(&lighting, Vec3::Z, |d| f32::from(d != Vec3::Z));
        assert!((lamp_hidden.x - PI).abs() < 1e-5);
        let half = irradiance_at(&lighting, Vec3::Z, |d| f32::from(d.x >= 0.0));
        assert!((half.x - (0.5 * PI + 2.0)).abs() < 1e-5);
    }
}
