//! The same lights in one mirrored ball, seen by both cameras: the turn between them to a fraction
//! of what one pixel of the smaller picture shows.
//!
//! A pixel at the rim shows far more of the surroundings than one in the middle, and a bright light
//! spills over its neighbours. So directions from the smaller picture would be off to one side. Instead
//! what the larger picture shows is foretold in the smaller one, pixels are compared with pixels,
//! and the turn is found by which their middles fall together.

use super::bright::Light;
use super::rays::tukey;
use crate::environment_camera_calibration::light_directions::LEAST_COSINE;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_numerics::{NormalEquations, median_absolute, minimise};

/// Samples of a light that are foretold.
const MOST_SAMPLES: usize = 150;
/// A light's middle may be off by this in every picture alike, pixels: where the pose puts the ball, and
/// how bright light spills.
const COMMON: f64 = 0.3;
/// Lights are the same ones up to this angle, radians.
const SAME: f64 = 0.3;

/// A picture of the scene camera.
pub(super) struct Shown {
    /// World to camera.
    pub camera_from_world: DQuat,
    /// Middle of the ball, camera's frame, metres.
    pub centre: DVec3,
    /// Lights that the ball shows, directions in the camera's frame.
    pub lights: Vec<Light>,
}

/// A turn.
pub(super) struct MirrorTurn {
    /// `world_from_camera`.
    pub turn: DQuat,
    /// Standard deviation, radians, about the axis that is known least.
    pub sigma: f64,
}

/// The samples nearest to each light.
pub(super) fn divided(samples: &[(DVec3, f64)], lights: &[DVec3]) -> Vec<Vec<(DVec3, f64)>> {
    let mut out = vec![Vec::new(); lights.len()];
    for sample in samples {
        let apart = |k: &usize| lights[*k].angle_between(sample.0);
        let nearest = (0..lights.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)));
        if let Some(k) = nearest.filter(|k| apart(k) < SAME) {
            out[k].push(*sample);
        }
    }
    for light in &mut out {
        let stride = light.len().div_ceil(MOST_SAMPLES).max(1);
        *light = light.iter().step_by(stride).copied().collect();
    }
    out
}

/// The turn by which `lights` (samples: direction in the environment camera's frame, solid angle) fall
/// on what was `shown`, from a `start`; `None` where too little was.
pub(super) fn mirror_turn(
    camera: &PinholeCamera,
    radius: f64,
    lights: &[Vec<(DVec3, f64)>],
    shown: &[Shown],
    start: DQuat,
) -> Option<MirrorTurn> {
    let mirror = Mirror { camera, radius };
    let seen = pairs(lights, shown, start);
    if seen.len() < 4 {
        return None;
    }
    let off = |turn: DQuat, s: &Seen| {
        let total = s.shown.camera_from_world * turn;
        Some(mirror.middle(&lights[s.light], total, s.shown.centre)? - s.pixel)
    };
    let mut turn = start;
    let mut answer = None;
    for _ in 0..3 {
        let offs = seen.iter().filter_map(|s| off(turn, s)).map(DVec2::length);
        let spread = (1.2 * median_absolute(offs)).max(0.05);
        let linearise = |t: &DQuat| {
            let mut normal = NormalEquations::new(3);
            for s in &seen {
                let Some(r) = off(*t, s) else { continue };
                let weight = tukey(r.length() / (6.0 * spread));
                let rows = slopes(|by| off(*t * by, s))?;
                normal.add(r.x, &rows.map(|c| c.x), weight);
                normal.add(r.y, &rows.map(|c| c.y), weight);
                normal.cost += 36.0 * spread * spread * (1.0 - weight);
            }
            Some(normal)
        };
        let found = minimise(turn, 8, linearise, |t, by| {
            (*t * DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2]))).normalize()
        })?;
        turn = found.state;
        answer = Some((found.normal, spread));
    }
    let (normal, spread) = answer?;
    let inverse = normal.hessian.cholesky()?.inverse();
    let worst = (0..3).map(|i| inverse[(i, i)]).fold(0.0, f64::max);
    let pictures = seen.len() as f64 / lights.len().max(1) as f64;
    let variance = worst * (spread * spread + COMMON * COMMON * pictures);
    Some(MirrorTurn {
        turn,
        sigma: variance.sqrt(),
    })
}

/// By small turns about the three axes.
fn slopes(at: impl Fn(DQuat) -> Option<DVec2>) -> Option<[DVec2; 3]> {
    const STEP: f64 = 1e-3;
    let slope = |axis: DVec3| {
        let by = DQuat::from_scaled_axis(axis * STEP);
        Some((at(by)? - at(by.inverse())?) / (2.0 * STEP))
    };
    Some([slope(DVec3::X)?, slope(DVec3::Y)?, slope(DVec3::Z)?])
}

struct Seen<'a> {
    shown: &'a Shown,
    light: usize,
    pixel: DVec2,
}

/// Which light is which, by the turn that is known roughly.
fn pairs<'a>(lights: &[Vec<(DVec3, f64)>], shown: &'a [Shown], turn: DQuat) -> Vec<Seen<'a>> {
    let mut out = Vec::new();
    for (light, samples) in lights.iter().enumerate() {
        let sum: DVec3 = samples.iter().map(|s| s.0 * s.1).sum();
        for shown in shown {
            let foretold = shown.camera_from_world * turn * sum;
            let apart = |l: &&Light| l.direction.angle_between(foretold);
            let nearest = shown
                .lights
                .iter()
                .min_by(|a, b| apart(a).total_cmp(&apart(b)));
            if let Some(l) = nearest.filter(|l| apart(l) < SAME) {
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
    /// Pixel of the ball that shows a direction; `None` where it meets the mirror too flatly.
    fn pixel(&self, direction: DVec3, centre: DVec3) -> Option<DVec2> {
        let mut to_eye = -centre.normalize_or_zero();
        let mut point = centre;
        let mut cosine = 0.0;
        for _ in 0..4 {
            // The normal halves the angle between eye and light.
            let normal = (to_eye + direction).normalize_or_zero();
            point = centre + normal * self.radius;
            to_eye = -point.normalize_or_zero();
            cosine = normal.dot(to_eye);
        }
        (cosine > LEAST_COSINE)
            .then(|| self.camera.project(point))
            .flatten()
    }

    /// Middle of a light's picture, pixels.
    fn middle(&self, light: &[(DVec3, f64)], camera_from: DQuat, centre: DVec3) -> Option<DVec2> {
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
    #![allow(clippy::unwrap_used)]
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
    fn a_pixel_of_the_ball_and_what_it_shows_go_there_and_back() {
        let (camera, centre) = (camera(), DVec3::new(0.03, -0.02, 0.6));
        let mirror = Mirror {
            camera: &camera,
            radius: 0.04,
        };
        for off in [
            DVec2::new(0.0, 0.0),
            DVec2::new(20.0, 5.0),
            DVec2::new(-10.0, -25.0),
        ] {
            let p = camera.project(centre).unwrap() + off;
            let d = mirrored(camera.unproject(p), centre, 0.04).unwrap();
            assert!(mirror.pixel(d, centre).unwrap().distance(p) < 0.02, "{off}");
        }
    }

    #[test]
    fn windows_in_a_small_ball_give_the_turn() {
        let camera = camera();
        let window = |middle: DVec3| -> Vec<(DVec3, f64)> {
            let (u, v) = middle.any_orthonormal_pair();
            let at = |k: i32| DVec2::new(f64::from(k % 9) - 4.0, f64::from(k / 9) - 4.0) * 0.04;
            (0..81)
                .map(|k| ((middle + u * at(k).x + v * at(k).y).normalize(), 0.0016))
                .collect()
        };
        let lights = [
            window(DVec3::new(0.2, 0.5, 0.8).normalize()),
            window(DVec3::new(-0.7, 0.1, 0.7).normalize()),
        ];
        let truth = DQuat::from_euler(glam::EulerRot::XYZ, 0.2, 0.1, -0.3);
        let mirror = Mirror {
            camera: &camera,
            radius: 0.04,
        };
        let shown: Vec<Shown> = (0..6)
            .map(|i| {
                let camera_from_world =
                    DQuat::from_euler(glam::EulerRot::XYZ, 2.4, 0.1 * f64::from(i), 0.1);
                let centre = DVec3::new(0.02 * f64::from(i), 0.01, 0.6);
                let light = |samples: &Vec<(DVec3, f64)>| {
                    let total = camera_from_world * truth;
                    let pixel = mirror.middle(samples, total, centre).unwrap();
                    let wobble = DVec2::new(f64::from(i % 3) - 1.0, f64::from(i % 2) - 0.5) * 0.1;
                    Light {
                        direction: total * samples[40].0,
                        solid_angle: 0.1,
                        pixel: pixel + wobble,
                        count: 10.0,
                    }
                };
                Shown {
                    camera_from_world,
                    centre,
                    lights: lights.iter().map(light).collect(),
                }
            })
            .collect();
        let start = truth * DQuat::from_rotation_x(0.05);
        let found = mirror_turn(&camera, 0.04, &lights, &shown, start).unwrap();
        let off = found.turn.angle_between(truth);
        assert!(
            off < 0.004 && off < 4.0 * found.sigma,
            "{off} {}",
            found.sigma
        );
        assert!(mirror_turn(&camera, 0.04, &lights, &shown[..1], start).is_none());
    }
}
