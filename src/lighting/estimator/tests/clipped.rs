//! Sources that clip even in the shortest exposure.

use super::*;

#[test]
fn clipped_source_is_raised_to_measured_irradiance() {
    let mut rig = Rig::new(&fisheye(0.0), EnvironmentSettings::default());
    let lamp = Vec3::new(0.5, 0.0, 0.8).normalize();
    let picture = photograph(&rig.placed, Vec3::ONE, 0.0, &|d| {
        Vec3::splat(0.1 + disc(d, lamp, 0.05, 500.0))
    });
    let brackets = [Bracket {
        picture: &picture,
        ev: 0.0,
    }];
    let measured = Vec3::new(3.0, 2.5, 2.0);
    let light = rig
        .estimator
        .update(&EnvironmentInput {
            brackets: &brackets,
            scene: None,
            gains: Mat3::from_diagonal(Vec3::new(1.2, 1.0, 0.9)),
            ground_radiance: None,
            measured_ground_irradiance: Some(measured),
            hidden: None,
            occluder_radiance: None,
            sphere_position: None,
            captured_at: MonotonicTime::default(),
        })
        .unwrap();
    let ratio = ground_sum(&light.lights) / measured;
    assert!((ratio - 1.0).abs().max_element() < 0.02, "{ratio}");
}

/// Radiance of a lamp twelve times as bright as the shortest exposure shows.
const LAMP: f32 = 4e5;
/// Standard deviation of the sun's image, radians: 0.6 pixels.
const SHARPNESS: f32 = 0.004;

/// The sun's light as it moves over the pixels, with a factor on its clipped pixels.
fn seen_suns(directions: impl Iterator<Item = Vec3>) -> Vec<DomeLight> {
    let mut rig = Rig::new(&fisheye(0.0), EnvironmentSettings::default());
    let seen = |direction: Vec3| {
        let sun = |d: Vec3| LAMP * (-0.5 * (d.angle_between(direction) / SHARPNESS).powi(2)).exp();
        let sky = |d: Vec3| Vec3::splat(0.3 + sun(d));
        let factor = (direction, Vec3::splat(12.0));
        rig.estimator.set_clipped_factors(std::iter::once(factor));
        let light = rig.observe(&sky, Vec3::splat(0.1));
        let suns = light.lights.iter().filter(|l| l.kind == LightKind::Compact);
        *suns
            .max_by(|a, b| a.irradiance.x.total_cmp(&b.irradiance.x))
            .unwrap()
    };
    directions.map(seen).collect()
}

fn towards(azimuth: f32) -> Vec3 {
    let (y, x) = azimuth.sin_cos();
    Vec3::new(0.6 * x, 0.6 * y, 0.8)
}

#[test]
fn clipped_sun_is_steady_while_the_number_of_its_clipped_pixels_is_not() {
    let directions = || (0..16).map(|k| towards(0.9 + 0.0007 * k as f32));
    let suns = seen_suns(directions());
    let light = || suns.iter().map(|s| s.irradiance.x);
    let (least, most) = (
        light().fold(f32::MAX, f32::min),
        light().fold(0.0, f32::max),
    );
    assert!(most < 1.06 * least, "{least} {most}");
    for (sun, direction) in suns.iter().zip(directions()) {
        let error = sun.direction.distance(direction);
        assert!(error < 0.001, "{error}");
    }
}

#[test]
fn clipped_lamp_that_is_half_hidden_is_half_as_bright_at_once() {
    let mut rig = Rig::new(&fisheye(0.0), EnvironmentSettings::default());
    let lamp = towards(0.5);
    let mut light = |is_half: bool| {
        let hidden = |d: Vec3| is_half && d.z < lamp.z;
        let room = |d: Vec3| {
            Vec3::splat(if hidden(d) {
                0.1
            } else {
                0.1 + disc(d, lamp, 0.04, LAMP)
            })
        };
        rig.estimator
            .set_clipped_factors(std::iter::once((lamp, Vec3::splat(12.0))));
        ground_sum(&rig.observe(&room, Vec3::splat(0.1)).lights).x
    };
    let whole = (0..6).map(|_| light(false)).last().unwrap();
    let half = light(true) / whole;
    assert!((0.45..0.6).contains(&half), "{half}");
}
