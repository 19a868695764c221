#![allow(clippy::unwrap_used)]
use super::*;

#[test]
fn rays_from_several_places_cross_at_the_light() {
    let light = DVec3::new(2.0, 1.0, 1.5);
    let rays: Vec<Ray> = (0..9)
        .map(|i| {
            let from = DVec3::new(0.05 * f64::from(i), 0.1 * f64::from(i % 3), 0.2);
            let wobble = DVec3::new(f64::from(i % 2), f64::from(i % 4) - 1.5, 0.0) * 1e-3;
            let direction = ((light - from).normalize() + wobble).normalize();
            Ray {
                from,
                direction,
                radius: 0.05,
            }
        })
        .collect();
    let found = agreed(&rays, 9, DVec3::ZERO, 0.1);
    assert_eq!(found.len(), 1);
    let off = found[0].beam.direction.angle_between(light);
    assert!(
        off < 4.0 * found[0].beam.sigma && found[0].beam.sigma < 0.02,
        "{off} {found:?}"
    );
    // Elsewhere a light whose distance is open lies anywhere.
    let still: Vec<Ray> = rays
        .iter()
        .map(|r| Ray {
            from: DVec3::ZERO,
            direction: light.normalize(),
            ..*r
        })
        .collect();
    assert!(
        agreed(&still, 9, DVec3::new(0.5, 0.0, 0.0), 0.1)[0]
            .beam
            .sigma
            > 0.1
    );
    assert!(agreed(&still, 9, DVec3::ZERO, 0.1)[0].beam.sigma < 0.01);
}

#[test]
fn a_mirrored_ball_shows_what_is_behind_the_camera_in_its_middle() {
    let centre = DVec3::new(0.0, 0.0, 0.5);
    let seen = mirrored(DVec3::Z, centre, 0.1).unwrap();
    assert!(seen.distance(-DVec3::Z) < 1e-12);
    let ray = DVec3::new(0.05, 0.0, 0.5).normalize();
    let seen = mirrored(ray, centre, 0.1).unwrap();
    assert!(seen.x > 0.5 && (seen.length() - 1.0).abs() < 1e-12);
    assert_eq!(mirrored(DVec3::X, centre, 0.1), None);
}
