use super::*;

fn lenses() -> [Lens; 3] {
    let ideal = |model, f| {
        Lens::ideal(
            model,
            (640, 480),
            DVec2::new(f, f * 1.01),
            DVec2::new(322.0, 235.0),
        )
    };
    let mut brown = ideal(LensModel::Brown, 530.0);
    brown.coefficients[..5].copy_from_slice(&[-0.28, 0.1, 0.001, -0.002, 0.03]);
    let mut rational = ideal(LensModel::BrownRational, 530.0);
    rational.coefficients = [0.3, -0.1, 0.001, -0.002, 0.01, 0.5, 0.02, 0.001];
    let mut fisheye = ideal(LensModel::KannalaBrandt, 190.0);
    fisheye.coefficients[..4].copy_from_slice(&[0.0034, 0.0007, -0.002, 0.0002]);
    [brown, rational, fisheye]
}

const POINTS: [DVec3; 5] = [
    DVec3::new(0.3, -0.2, 1.0),
    DVec3::new(-0.5, 0.4, 1.2),
    DVec3::new(0.0, 0.0, 2.0),
    DVec3::new(1e-4, 2e-4, 0.7),
    DVec3::new(-0.45, -0.35, 1.0),
];

#[test]
fn unproject_inverts_project() {
    for lens in lenses() {
        for point in POINTS {
            let pixel = lens.project(point).unwrap();
            let ray = lens.unproject(pixel).unwrap();
            assert!(ray.distance(point.normalize()) < 1e-9, "{lens:?} {point}");
        }
    }
    let [.., fisheye] = lenses();
    let behind = DVec3::new(0.9, 0.2, -0.3);
    let ray = fisheye.unproject(fisheye.project(behind).unwrap()).unwrap();
    assert!(ray.distance(behind.normalize()) < 1e-9);
}

#[test]
fn derivatives_match_finite_differences() {
    let close = |a: DVec2, b: DVec2| a.distance(b) < 1e-4 * (1.0 + b.length());
    for lens in lenses() {
        let behind = DVec3::new(0.9, 0.2, -0.1);
        let fisheye = lens.model == LensModel::KannalaBrandt;
        for point in POINTS.into_iter().chain(fisheye.then_some(behind)) {
            let found = lens.project_with_derivatives(point).unwrap();
            for (axis, by) in [DVec3::X, DVec3::Y, DVec3::Z]
                .into_iter()
                .zip(found.by_point)
            {
                let h = 1e-6;
                let ahead = lens.project(point + axis * h).unwrap();
                let behind = lens.project(point - axis * h).unwrap();
                let by_step = (ahead - behind) / (2.0 * h);
                assert!(
                    close(by, by_step),
                    "{lens:?} {point} {axis}: {by} {by_step}"
                );
            }
            for i in 0..lens.parameter_count() {
                let moved = |h: f64| {
                    let mut p = lens.parameters();
                    p[i] += h;
                    lens.with_parameters(&p).project(point).unwrap()
                };
                let by_step = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                assert!(
                    close(found.by_parameter[i], by_step),
                    "{lens:?} parameter {i}"
                );
            }
        }
    }
}

#[test]
fn brown_lens_projects_as_pinhole_camera() {
    let [brown, rational, fisheye] = lenses();
    let camera = brown.as_pinhole().unwrap();
    for point in POINTS {
        let d = camera.project(point).unwrap() - brown.project(point).unwrap();
        assert!(d.length() < 1e-9);
    }
    assert_eq!(Lens::from(&camera), brown);
    assert!(rational.as_pinhole().is_none() && fisheye.as_pinhole().is_none());
    assert!(brown.project(DVec3::new(0.1, 0.1, -1.0)).is_none());
}

#[test]
fn no_ray_beyond_the_fold_of_the_distortion() {
    let [mut brown, _, mut fisheye] = lenses();
    brown.coefficients = [0.0; 8];
    brown.coefficients[0] = -0.4;
    // r (1 − 0.4 r²) has its maximum 0.6086 at r = 0.9129.
    let at = |r: f64| brown.centre + DVec2::new(r * brown.focal.x, 0.0);
    assert!(brown.unproject(at(0.60)).is_some());
    assert!(brown.unproject(at(0.62)).is_none());
    fisheye.coefficients[..4].copy_from_slice(&[-0.1, 0.0, 0.0, 0.0]);
    // θ − 0.1 θ³ has its maximum 1.217 at θ = 1.826.
    let at = |r: f64| fisheye.centre + DVec2::new(r * fisheye.focal.x, 0.0);
    assert!(fisheye.unproject(at(1.21)).is_some());
    assert!(fisheye.unproject(at(1.23)).is_none());
    assert!(!fisheye.is_invertible_within(300.0) && fisheye.is_invertible_within(200.0));
}
