use super::*;

#[test]
fn rays_from_several_positions_intersect_at_the_light() {
    let light = DVec3::new(2.0, 1.0, 1.5);
    let rays: Vec<LightRay> = (0..9)
        .map(|i| {
            let from = DVec3::new(0.05 * f64::from(i), 0.1 * f64::from(i % 3), 0.2);
            let wobble = DVec3::new(f64::from(i % 2), f64::from(i % 4) - 1.5, 0.0) * 1e-3;
            let direction = ((light - from).normalize() + wobble).normalize();
            LightRay {
                from,
                direction,
                radius: 0.05,
            }
        })
        .collect();
    let found = triangulate(&rays, 9, DVec3::ZERO, 0.1);
    assert_eq!(found.len(), 1);
    let error = found[0].seen.direction.angle_between(light);
    assert!(
        error < 4.0 * found[0].seen.sigma && found[0].seen.sigma < 0.02,
        "{error} {found:?}"
    );
    // From another position, the direction of a light at unknown distance is uncertain.
    let still: Vec<LightRay> = rays
        .iter()
        .map(|r| LightRay {
            from: DVec3::ZERO,
            direction: light.normalize(),
            ..*r
        })
        .collect();
    assert!(
        triangulate(&still, 9, DVec3::new(0.5, 0.0, 0.0), 0.1)[0]
            .seen
            .sigma
            > 0.1
    );
    assert!(triangulate(&still, 9, DVec3::ZERO, 0.1)[0].seen.sigma < 0.01);
}

#[test]
fn centre_of_mirrored_sphere_reflects_the_direction_behind_the_camera() {
    let centre = DVec3::new(0.0, 0.0, 0.5);
    let seen = mirrored(DVec3::Z, centre, 0.1).unwrap();
    assert!(seen.distance(-DVec3::Z) < 1e-12);
    let ray = DVec3::new(0.05, 0.0, 0.5).normalize();
    let seen = mirrored(ray, centre, 0.1).unwrap();
    assert!(seen.x > 0.5 && (seen.length() - 1.0).abs() < 1e-12);
    assert_eq!(mirrored(DVec3::X, centre, 0.1), None);
}
