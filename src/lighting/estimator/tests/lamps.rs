//! Lamps of which something real hides a part, and lamps side by side.

use super::*;

const RADIUS: f32 = 0.1;
const RADIANCE: f32 = 40.0;

fn lamp() -> Vec3 {
    Vec3::new(0.6, 0.3, 0.74).normalize()
}

/// The light of a shape (radiance by direction) on a surface that faces it, of which everything below a plane
/// through the observer, turned by `angle` from the lamp's middle, is hidden; and the direction of its middle.
fn seen(shape: &dyn Fn(Vec3) -> f32, angle: f32) -> (f32, Vec3) {
    let right = lamp().cross(Vec3::Z).normalize();
    let normal = right.cross(lamp()) * angle.cos() - lamp() * angle.sin();
    let is_hidden = |d: Vec3| d.dot(normal) < 0.0 && d.dot(lamp()) > 0.8;
    let hidden = |_: DVec3, to: DVec3| is_hidden(to.as_vec3().normalize());
    let mut rig = Rig::new(&fisheye(0.0), EnvironmentSettings::default());
    rig.estimator = EnvironmentEstimator::new(
        &fisheye(0.0),
        &Response::srgb(),
        EnvironmentSettings::default(),
        Some(&hidden),
    )
    .unwrap();
    let room = |d: Vec3| Vec3::splat(if is_hidden(d) { 0.05 } else { 0.2 + shape(d) });
    rig.observe(&room, Vec3::splat(0.1));
    let source = rig.estimator.sources()[0];
    (source.irradiance.x, source.direction)
}

#[test]
fn round_lamp_is_complete_although_most_of_it_is_hidden() {
    let shape = |d: Vec3| disc(d, lamp(), RADIUS, RADIANCE);
    let all = PI * RADIUS.sin().powi(2) * RADIANCE;
    for angle in [-0.06, -0.02, 0.02, 0.04] {
        let (light, direction) = seen(&shape, angle);
        assert!((light / all - 1.0).abs() < 0.08, "{angle}: {light} {all}");
        let error = direction.distance(lamp());
        assert!(error < 0.006, "{angle}: {error}");
    }
    // A sliver tells nothing of the rest.
    let (light, _) = seen(&shape, 0.09);
    assert!(light < 0.1 * all, "{light} {all}");
}

#[test]
fn window_that_is_half_hidden_is_not_taken_for_a_lamp() {
    let right = lamp().cross(Vec3::Z).normalize();
    let up = right.cross(lamp());
    let shape = |d: Vec3| {
        let is_inside = d.dot(right).abs() < 0.12 && d.dot(up).abs() < 0.1;
        if is_inside && d.dot(lamp()) > 0.0 {
            RADIANCE
        } else {
            0.0
        }
    };
    let (light, _) = seen(&shape, 0.0);
    let half = 0.5 * 0.24 * 0.2 * RADIANCE;
    assert!((light / half - 1.0).abs() < 0.06, "{light} {half}");
}

/// The sources in a room with a shape.
fn sources(shape: &dyn Fn(Vec3) -> f32) -> Vec<CompactSource> {
    let mut rig = Rig::new(&fisheye(0.0), EnvironmentSettings::default());
    rig.observe(&|d| Vec3::splat(0.2 + shape(d)), Vec3::splat(0.1));
    rig.estimator.sources()
}

#[test]
fn lamps_side_by_side_are_two_and_the_panes_of_a_window_are_one() {
    let right = lamp().cross(Vec3::Z).normalize();
    let up = right.cross(lamp());
    // Two pixels lie between them.
    let other = (lamp() + 0.162 * right).normalize();
    let lamps = |d: Vec3| disc(d, lamp(), 0.1, 10.0) + disc(d, other, 0.045, 60.0);
    let found = sources(&lamps);
    assert_eq!(found.len(), 2, "{found:?}");
    for (source, (at, radius, radiance)) in found
        .iter()
        .zip([(other, 0.045f32, 60.0), (lamp(), 0.1, 10.0)])
    {
        let light = PI * radius.sin().powi(2) * radiance;
        assert!(
            (source.irradiance.x / light - 1.0).abs() < 0.06,
            "{source:?} {light}"
        );
        assert!(source.direction.distance(at) < 0.003, "{source:?}");
    }
    let window = |d: Vec3| {
        let (x, y) = (d.dot(right), d.dot(up));
        let is_bar = x.abs() < 0.007 || (y - 0.01).abs() < 0.007;
        let is_inside = x.abs() < 0.12 && y.abs() < 0.1 && d.dot(lamp()) > 0.0;
        if is_inside && !is_bar { RADIANCE } else { 0.0 }
    };
    assert_eq!(sources(&window).len(), 1);
}

#[test]
fn near_lamps_side_by_side_are_reflected_once_each() {
    let other = (lamp() + 0.17 * lamp().cross(Vec3::Z).normalize()).normalize();
    let room =
        |d: Vec3| Vec3::splat(0.2 + disc(d, lamp(), 0.1, 30.0) + disc(d, other, 0.045, 60.0));
    let mut rig = Rig::new(&fisheye(0.0), EnvironmentSettings::default());
    rig.observe(&room, Vec3::splat(0.1));
    let near = |s: &CompactSource| {
        let distance = LampDistance {
            inverse: 2.0,
            sigma: 0.0,
        };
        (s.id, distance)
    };
    let distances: Vec<_> = rig.estimator.sources().iter().map(near).collect();
    rig.estimator.set_distances(&distances);
    rig.estimator.set_reference(DVec3::new(0.1, 0.0, 0.05));
    let light = rig.observe(&room, Vec3::splat(0.1));
    let lamps = light.lights.iter().filter(|l| l.kind == LightKind::Compact);
    let all: f32 = lamps.map(|l| l.irradiance.x).sum();
    let reflected = &light.radiance.compact_sources;
    let sum: f32 = reflected.iter().map(|s| s.flux.x).sum();
    assert_eq!(reflected.len(), 2);
    assert!((sum / all - 1.0).abs() < 0.1, "{sum} {all}");
}
