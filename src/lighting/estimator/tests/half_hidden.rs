//! Lamps of which something real hides a part.

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
