//! The rotation between two cameras that see the same lights in one mirrored sphere, with sub-pixel
//! accuracy in the smaller image of the sphere.
//!
//! A pixel at the rim covers a far larger solid angle than one at the centre, and bright lights bleed
//! into neighbouring pixels, so that directions from the smaller image would be biased. Instead, the
//! lights of the larger image are predicted in the smaller one, and the rotation minimises the
//! distances between predicted and observed centres, in pixels.

use super::bright_pixels::Light;
use super::light_directions::MIN_COSINE;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_numerics::{NormalEquations, median_absolute, minimise, tukey_weight};

/// Maximum number of samples of a light.
const MAX_SAMPLES: usize = 150;
/// Systematic error of a light's centre in all pictures, pixels: from the sphere's predicted position
/// and the bleeding of bright light.
const SYSTEMATIC: f64 = 0.3;
/// Maximum angle between corresponding lights, radians.
const MAX_ANGLE: f64 = 0.3;

/// A picture of the scene camera.
pub(super) struct SphereView {
    /// World to camera.
    pub camera_from_world: DQuat,
    /// Centre of the sphere, camera's frame, metres.
    pub centre: DVec3,
    /// Lights that the sphere reflects, directions in the camera's frame.
    pub lights: Vec<Light>,
}

/// A rotation and its uncertainty.
pub(super) struct MirrorRotation {
    /// `world_from_camera`.
    pub rotation: DQuat,
    /// Standard deviation about the least certain axis, radians.
    pub sigma: f64,
}

/// Assigns the samples to the nearest lights.
pub(super) fn assign_samples(samples: &[(DVec3, f64)], lights: &[DVec3]) -> Vec<Vec<(DVec3, f64)>> {
    let mut out = vec![Vec::new(); lights.len()];
    for sample in samples {
        let apart = |k: &usize| lights[*k].angle_between(sample.0);
        let nearest = (0..lights.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)));
        if let Some(k) = nearest.filter(|k| apart(k) < MAX_ANGLE) {
            out[k].push(*sample);
        }
    }
    for light in &mut out {
        let stride = light.len().div_ceil(MAX_SAMPLES).max(1);
        *light = light.iter().step_by(stride).copied().collect();
    }
    out
}

/// Finds the rotation that maps `lights` (samples: direction in the environment camera's frame, solid
/// angle) to those in the pictures `shown`, from an initial rotation; `None` for fewer than four
/// correspondences.
pub(super) fn rotation_from_mirror(
    camera: &PinholeCamera,
    radius: f64,
    lights: &[Vec<(DVec3, f64)>],
    shown: &[SphereView],
    start: DQuat,
) -> Option<MirrorRotation> {
    let mirror = Mirror { camera, radius };
    let seen = correspondences(lights, shown, start);
    if seen.len() < 4 {
        return None;
    }
    let residual = |rotation: DQuat, s: &Seen| {
        let total = s.shown.camera_from_world * rotation;
        Some(mirror.light_centre(&lights[s.light], total, s.shown.centre)? - s.pixel)
    };
    let mut rotation = start;
    let mut answer = None;
    for _ in 0..3 {
        let residuals = seen.iter().filter_map(|s| residual(rotation, s));
        let spread = (1.2 * median_absolute(residuals.map(DVec2::length))).max(0.05);
        let linearise = |t: &DQuat| {
            let mut normal = NormalEquations::new(3);
            for s in &seen {
                let Some(r) = residual(*t, s) else { continue };
                let weight = tukey_weight(r.length() / (6.0 * spread));
                let rows = derivatives(|by| residual(*t * by, s))?;
                normal.add(r.x, &rows.map(|c| c.x), weight);
                normal.add(r.y, &rows.map(|c| c.y), weight);
                normal.cost += 36.0 * spread * spread * (1.0 - weight);
            }
            Some(normal)
        };
        let found = minimise(rotation, 8, linearise, |t, by| {
            (*t * DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2]))).normalize()
        })?;
        rotation = found.state;
        answer = Some((found.normal, spread));
    }
    let (normal, spread) = answer?;
    let inverse = normal.hessian.cholesky()?.inverse();
    let worst = (0..3).map(|i| inverse[(i, i)]).fold(0.0, f64::max);
    let pictures = seen.len() as f64 / lights.len().max(1) as f64;
    let variance = worst * (spread * spread + SYSTEMATIC * SYSTEMATIC * pictures);
    Some(MirrorRotation {
        rotation,
        sigma: variance.sqrt(),
    })
}

/// Returns the derivatives by rotations about the three axes, per radian.
fn derivatives(at: impl Fn(DQuat) -> Option<DVec2>) -> Option<[DVec2; 3]> {
    const STEP: f64 = 1e-3;
    let slope = |axis: DVec3| {
        let by = DQuat::from_scaled_axis(axis * STEP);
        Some((at(by)? - at(by.inverse())?) / (2.0 * STEP))
    };
    Some([slope(DVec3::X)?, slope(DVec3::Y)?, slope(DVec3::Z)?])
}

/// A light in a picture of the scene camera.
struct Seen<'a> {
    shown: &'a SphereView,
    light: usize,
    pixel: DVec2,
}

/// Finds the corresponding lights with an approximate rotation.
fn correspondences<'a>(
    lights: &[Vec<(DVec3, f64)>],
    shown: &'a [SphereView],
    rotation: DQuat,
) -> Vec<Seen<'a>> {
    let mut out = Vec::new();
    for (light, samples) in lights.iter().enumerate() {
        let sum: DVec3 = samples.iter().map(|s| s.0 * s.1).sum();
        for shown in shown {
            let predicted = shown.camera_from_world * rotation * sum;
            let apart = |l: &&Light| l.direction.angle_between(predicted);
            let nearest = shown
                .lights
                .iter()
                .min_by(|a, b| apart(a).total_cmp(&apart(b)));
            if let Some(l) = nearest.filter(|l| apart(l) < MAX_ANGLE) {
                out.push(Seen {
                    shown,
                    light,
                    pixel: l.pixel,
                });
            }
        }
    }
    out
}

struct Mirror<'a> {
    camera: &'a PinholeCamera,
    radius: f64,
}

impl Mirror<'_> {
    /// Returns the pixel in which the sphere reflects a direction; `None` at grazing incidence.
    fn pixel(&self, direction: DVec3, centre: DVec3) -> Option<DVec2> {
        let mut to_eye = -centre.normalize_or_zero();
        let mut point = centre;
        let mut cosine = 0.0;
        for _ in 0..4 {
            // The normal bisects the angle between eye and light.
            let normal = (to_eye + direction).normalize_or_zero();
            point = centre + normal * self.radius;
            to_eye = -point.normalize_or_zero();
            cosine = normal.dot(to_eye);
        }
        (cosine > MIN_COSINE)
            .then(|| self.camera.project(point))
            .flatten()
    }

    /// Returns the centre of a light's image, pixels.
    fn light_centre(
        &self,
        light: &[(DVec3, f64)],
        camera_from: DQuat,
        centre: DVec3,
    ) -> Option<DVec2> {
        const STEP: f64 = 1e-3;
        let (mut sum, mut total) = (DVec2::ZERO, 0.0);
        for (d, area) in light {
            let d = camera_from * *d;
            let (u, v) = d.any_orthonormal_pair();
            let around = (
                self.pixel(d, centre),
                self.pixel((d + u * STEP).normalize(), centre),
                self.pixel((d + v * STEP).normalize(), centre),
            );
            if let (Some(at), Some(a), Some(b)) = around {
                let weight = area * (a - at).perp_dot(b - at).abs();
                sum += at * weight;
                total += weight;
            }
        }
        (total > 0.0).then(|| sum / total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment_camera_calibration::light_directions::mirrored;

    fn camera() -> PinholeCamera {
        PinholeCamera {
            width: 640,
            height: 480,
            focal: DVec2::splat(700.0),
            centre: DVec2::new(320.0, 240.0),
            distortion: [0.0; 5],
        }
    }

    #[test]
    fn reflected_direction_projects_to_its_pixel() {
        let (camera, centre) = (camera(), DVec3::new(0.03, -0.02, 0.6));
        let mirror = Mirror {
            camera: &camera,
            radius: 0.04,
        };
        for offset in [
            DVec2::new(0.0, 0.0),
            DVec2::new(20.0, 5.0),
            DVec2::new(-10.0, -25.0),
        ] {
            let p = camera.project(centre).unwrap() + offset;
            let d = mirrored(camera.unproject(p), centre, 0.04).unwrap();
            assert!(
                mirror.pixel(d, centre).unwrap().distance(p) < 0.02,
                "{offset}"
            );
        }
    }

    #[test]
    fn recovers_rotation_from_windows_in_small_sphere() {
        let camera = camera();
        let window = |centre_direction: DVec3| -> Vec<(DVec3, f64)> {
            let (u, v) = centre_direction.any_orthonormal_pair();
            let at = |k: i32| DVec2::new(f64::from(k % 9) - 4.0, f64::from(k / 9) - 4.0) * 0.04;
            (0..81)
                .map(|k| {
                    (
                        (centre_direction + u * at(k).x + v * at(k).y).normalize(),
                        0.0016,
                    )
                })
                .collect()
        };
        let lights = [
            window(DVec3::new(0.2, 0.5, 0.8).normalize()),
            window(DVec3::new(-0.7, 0.1, 0.7).normalize()),
        ];
        let ground_truth = DQuat::from_euler(glam::EulerRot::XYZ, 0.2, 0.1, -0.3);
        let mirror = Mirror {
            camera: &camera,
            radius: 0.04,
        };
        let shown: Vec<SphereView> = (0..6)
            .map(|i| {
                let camera_from_world =
                    DQuat::from_euler(glam::EulerRot::XYZ, 2.4, 0.1 * f64::from(i), 0.1);
                let centre = DVec3::new(0.02 * f64::from(i), 0.01, 0.6);
                let light = |samples: &Vec<(DVec3, f64)>| {
                    let total = camera_from_world * ground_truth;
                    let pixel = mirror.light_centre(samples, total, centre).unwrap();
                    let wobble = DVec2::new(f64::from(i % 3) - 1.0, f64::from(i % 2) - 0.5) * 0.1;
                    Light {
                        direction: total * samples[40].0,
                        solid_angle: 0.1,
                        pixel: pixel + wobble,
                        count: 10.0,
                    }
                };
                SphereView {
                    camera_from_world,
                    centre,
                    lights: lights.iter().map(light).collect(),
                }
            })
            .collect();
        let start = ground_truth * DQuat::from_rotation_x(0.05);
        let found = rotation_from_mirror(&camera, 0.04, &lights, &shown, start).unwrap();
        let error = found.rotation.angle_between(ground_truth);
        assert!(
            error < 0.004 && error < 4.0 * found.sigma,
            "{error} {}",
            found.sigma
        );
        assert!(rotation_from_mirror(&camera, 0.04, &lights, &shown[..1], start).is_none());
    }
}
