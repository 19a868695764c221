//! Runs the example `estimate_light` and checks its result.

#[path = "../examples/estimate_light.rs"]
#[expect(dead_code, reason = "its `main` prints")]
mod estimate_light;

use estimate_light::{SKY, SUN, SUN_RADIUS, estimate, sun_direction};
use glam::Vec3;
use penumbra_lighting::LightKind;
use std::f32::consts::PI;

#[test]
fn example_finds_sun_and_irradiance() {
    let sun = sun_direction(40.0, 30.0);
    let light = estimate(sun).unwrap();
    let compact = light
        .lights
        .iter()
        .filter(|l| l.kind == LightKind::Compact)
        .map(|l| (l.direction, l.irradiance))
        .fold(
            (Vec3::ZERO, Vec3::ZERO),
            |(d, e), (direction, irradiance)| (d + direction * irradiance.x, e + irradiance),
        );
    let error = compact.0.angle_between(sun).to_degrees();
    assert!(error < 0.5, "{error}°");
    // A disc of this radius has the projected solid angle π sin² r.
    let expected = SUN * PI * SUN_RADIUS.sin().powi(2);
    let relative = (compact.1 - expected).abs() / expected;
    assert!(relative.max_element() < 0.05, "{relative}");
    // A hemisphere of constant radiance L gives the irradiance π L.
    let relative = (light.irradiance.irradiance(Vec3::Z) - SKY * PI).abs() / (SKY * PI);
    assert!(relative.max_element() < 0.05, "{relative}");
}
