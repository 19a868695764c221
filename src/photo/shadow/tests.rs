use super::*;
use crate::{ASSUMED_REFLECTANCE, BallPicture, ExposuresFrom, FoundBall, Photograph, Tone};
use glam::DVec2;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_lighting::Circle;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::place::LampDistance;
use penumbra_numerics::Random;
use std::path::PathBuf;
use std::sync::Arc;

const RADIUS_METRES: f64 = 0.04;
/// Irradiance by the sky.
const SKY: f32 = 0.3;

fn lamp(direction: [f32; 3], irradiance: f32) -> SeenLamp {
    let direction = Vec3::from(direction).normalize();
    SeenLamp {
        source: CompactSource {
            id: 1,
            viewpoint: Vec3::ZERO,
            direction,
            irradiance: Vec3::splat(irradiance),
            angular_radius: 0.02,
            distance: LampDistance::FAR,
            position: None,
            clipped: 1.0,
            lights: 1,
            is_unseen: false,
        },
        parts: vec![direction],
        is_energy_unknown: false,
    }
}

/// A sky that is the same everywhere.
fn sky() -> Harmonics {
    let mut coefficients = [Vec3::ZERO; 9];
    coefficients[0] = Vec3::splat(SKY);
    Harmonics { coefficients }
}

/// The light of the ground, 1 is white under full light, at a point that a ray from the camera meets; `with` the
/// ball, or without.
fn light_at(placement: &Placement, ray: DVec3, lamps: &[SeenLamp], with: bool) -> f64 {
    let at = placement.world_from_camera.translation;
    let at = at - ray * (at.z / ray.z);
    let is_changed = with && ray.z < 0.0;
    // The form factor of a sphere above the horizon of a surface.
    let hidden = (RADIUS_METRES / (placement.ball - at).length()).powi(3);
    let hidden = hidden * f64::from(u8::from(is_changed));
    let reflectance = f64::from(ASSUMED_REFLECTANCE);
    let sky = f64::from(SKY) * (1.0 - hidden * (1.0 - reflectance));
    let by_lamp = |lamp: &SeenLamp| {
        let to = lamp.source.direction.as_dvec3();
        // Distance of the ball's centre from the ray to the lamp.
        let apart = (placement.ball - at).reject_from_normalized(to).length();
        let is_dark = is_changed && apart < RADIUS_METRES;
        let direct = if is_dark { 0.0 } else { to.z };
        // A mirrored sphere scatters evenly.
        f64::from(lamp.source.irradiance.x) * (direct + 0.25 * reflectance * hidden)
    };
    sky + lamps.iter().map(by_lamp).sum::<f64>()
}

/// Two photographs of a ball on a speckled ground under a sky and lamps, the first without it.
fn drawn(
    camera: &PinholeCamera,
    placement: &Placement,
    lamps: &[SeenLamp],
) -> [Arc<Photograph>; 2] {
    let (width, height) = (camera.width, camera.height);
    let mut random = Random::new(11);
    let speckles: Vec<f64> = (0..width * height)
        .map(|_| random.between(0.3, 0.6))
        .collect();
    let response = Response::srgb();
    let mut draw = |with: bool| {
        let rgba = (0..width * height).flat_map(|i| {
            let pixel = DVec2::new(f64::from(i % width), f64::from(i / width));
            let ray = placement.world_from_camera.rotation * camera.unproject(pixel);
            let light = light_at(placement, ray, lamps, with);
            let value = light * speckles[i as usize] + 2e-3 * random.normal();
            let code = response.code_from_linear(value as f32);
            [code, code, code, 255]
        });
        Arc::new(Photograph {
            path: PathBuf::from("drawn.png"),
            picture: Picture {
                width,
                height,
                rgba: rgba.collect(),
            },
            exposure_ev: None,
            focal: None,
            profile: None,
        })
    };
    [draw(false), draw(true)]
}

/// What such photographs tell, taken by a camera that looks down by `tilt` degrees.
fn photographs(tilt: f64, lamps: &[SeenLamp]) -> Analysis {
    let camera = PinholeCamera {
        width: 320,
        height: 240,
        focal: DVec2::splat(280.0),
        centre: DVec2::new(160.0, 110.0),
        distortion: [0.0; 5],
    };
    let distance = 0.5;
    let ball = FoundBall {
        circle: Circle {
            centre: camera.centre,
            radius: camera.focal.x * (RADIUS_METRES / distance),
        },
        direction: DVec3::Z,
        half_angle: (RADIUS_METRES / distance).asin(),
        support: 1.0,
        is_fitted: true,
    };
    let placement = by_tilt(&ball, RADIUS_METRES, tilt, GroundFrom::Assumed).unwrap();
    let [empty, photograph] = drawn(&camera, &placement, lamps);
    let with = BallPicture {
        photograph,
        shift: IVec2::ZERO,
        turned_degrees: None,
        ev: 0.0,
        circle: ball.circle,
    };
    Analysis {
        empty,
        balls: vec![with],
        camera,
        is_lens_assumed: false,
        exposures_from: ExposuresFrom::Stated,
        ball,
        placement,
        tone: Tone {
            response: Response::srgb(),
            exposures: 0,
            from_srgb: 0.0,
            refused: None,
        },
        ball_radius: RADIUS_METRES,
        reflectance: [ASSUMED_REFLECTANCE; 3],
        raised: Vec::new(),
    }
}

#[test]
fn shadows_tell_how_bright_each_lamp_is() {
    let lamps = [lamp([0.7, 0.1, 0.7], 0.6), lamp([-0.6, 0.3, 0.9], 0.3)];
    let seen = photographs(30.0, &lamps);
    let mut known = lamps.to_vec();
    known[0].source.irradiance /= 20.0;
    known[1].source.irradiance /= 3.0;
    let light = KnownLight {
        lamps: &known,
        irradiance: &sky(),
        unknown: &[(1, 1.0), (0, 1.0)],
    };
    let told = seen.factors_by_shadow(&light).unwrap();
    for (told, truth) in told.iter().zip([3.0, 20.0]) {
        let error = told.rgb / truth - 1.0;
        assert!(error.abs().max_element() < 0.12, "{told:?} for {truth}");
        assert!(told.sigma < 0.1 * truth, "{told:?}");
    }
}

#[test]
fn lamp_that_is_as_bright_as_it_looks_is_left_alone() {
    let lamps = [lamp([0.7, 0.1, 0.7], 0.6)];
    let seen = photographs(30.0, &lamps);
    let light = KnownLight {
        lamps: &lamps,
        irradiance: &sky(),
        unknown: &[(0, 1.0)],
    };
    let told = seen.factors_by_shadow(&light).unwrap();
    assert!(told[0].rgb.max_element() < 1.1, "{told:?}");
    // Nor is one that throws no shadow where one would be.
    let none = photographs(30.0, &[]);
    let told = none.factors_by_shadow(&light).unwrap();
    assert_eq!(told[0].rgb, Vec3::ONE);
}

#[test]
fn shadow_tells_how_far_the_camera_looks_down() {
    for tilt in [18.0, 33.0, 55.0] {
        let lamps = [lamp([0.7, 0.5, 0.7], 0.6), lamp([-0.6, -0.5, 0.7], 0.3)];
        let mut seen = photographs(tilt, &lamps);
        let truth = seen.placement.world_from_camera.rotation;
        seen.placement = by_tilt(&seen.ball, RADIUS_METRES, 30.0, GroundFrom::Assumed).unwrap();
        let known_from_truth = seen.placement.world_from_camera.rotation * truth.inverse();
        let turned = |lamp: &SeenLamp| known_from_truth.as_quat() * lamp.source.direction;
        let known = lamps.each_ref().map(|l| lamp(turned(l).to_array(), 0.1));
        let light = KnownLight {
            lamps: &known,
            irradiance: &sky(),
            unknown: &[(0, 1.0), (1, 1.0)],
        };
        let found = seen.placement_by_shadow(&light).unwrap();
        assert!(
            (found.tilt_degrees - tilt).abs() < 2.0,
            "{found:?} for {tilt}"
        );
    }
}

#[test]
fn ground_without_a_shadow_does_not_tell_how_it_lies() {
    let seen = photographs(40.0, &[]);
    let light = KnownLight {
        lamps: &[lamp([0.7, 0.1, 0.7], 0.02)],
        irradiance: &sky(),
        unknown: &[(0, 1.0)],
    };
    assert_eq!(seen.placement_by_shadow(&light), None);
}

#[test]
fn white_sky_in_a_large_picture_is_no_lamp() {
    let mut seen = photographs(30.0, &[]);
    let (width, height) = (4 * seen.camera.width, 4 * seen.camera.height);
    let white = Photograph {
        picture: Picture {
            width,
            height,
            rgba: vec![255; 4 * (width * height) as usize],
        },
        ..(*seen.empty).clone()
    };
    seen.camera.width = width;
    seen.camera.height = height;
    seen.camera.focal *= 4.0;
    seen.camera.centre *= 4.0;
    seen.balls[0].circle.centre *= 4.0;
    seen.balls[0].circle.radius *= 4.0;
    seen.balls[0].photograph = Arc::new(white.clone());
    seen.empty = Arc::new(white);
    assert!(seen.white_lamps().is_empty());
}
