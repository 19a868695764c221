use super::super::synthetic::render;
use super::*;

fn camera() -> PinholeCamera {
    PinholeCamera {
        width: 480,
        height: 400,
        focal: DVec2::new(700.0, 702.0),
        centre: DVec2::new(238.0, 201.0),
        distortion: [0.0; 5],
    }
}

const CENTRE: DVec3 = DVec3::new(0.02, -0.01, 0.31);
const RADIUS: f64 = 0.06;

/// A mirrored sphere that reflects a horizon, before a tiled floor; `hidden` is covered by a hand.
fn planes(noise: f64, hidden: impl Fn(DVec2) -> bool) -> [Grey; 3] {
    let camera = camera();
    let axis = CENTRE.normalize();
    let half = (RADIUS / CENTRE.length()).asin();
    let light = |p: DVec2| {
        let angle = camera.unproject(p).angle_between(axis);
        if hidden(p) {
            return 0.35;
        }
        let tile = (p.x / 37.0).floor() + (p.y / 41.0).floor();
        if angle > half {
            return if tile.rem_euclid(2.0) == 0.0 {
                0.12
            } else {
                0.25
            };
        }
        let up = (p.y - 190.0) / 100.0;
        let horizon = up + 0.2 * ((p.x - 240.0) / 120.0).powi(2) > 0.2;
        match () {
            () if p.distance(DVec2::new(300.0, 170.0)) < 20.0 => 0.95,
            () if horizon => 0.5 - 0.2 * angle / half,
            () => 0.04,
        }
    };
    let (codes, _) = render((480, 400), noise, light);
    [codes.clone(), codes.clone(), codes]
}

fn check(found: &Outline, max_error: f64) {
    let (centre, sigma) = found.centre(RADIUS);
    let apart = centre.angle_between(CENTRE) * 700.0;
    let size = (found.half_angle - (RADIUS / CENTRE.length()).asin()) * 700.0;
    assert!(
        apart < max_error && size.abs() < max_error,
        "{apart} {size} {found:?}"
    );
    assert!(
        (centre.length() - CENTRE.length()).abs() < 5.0 * sigma[1],
        "{centre} {sigma:?}"
    );
}

#[test]
fn finds_sphere_before_tiles_within_a_fifth_of_a_pixel() {
    let rough = RoughSphere {
        centre: DVec2::new(285.0, 170.0),
        radius: None,
    };
    let planes = planes(2.0, |_| false);
    check(&outline(&planes, &camera(), rough).unwrap(), 0.2);
    let rough = RoughSphere {
        centre: DVec2::new(280.0, 185.0),
        radius: Some(150.0),
    };
    check(&outline(&planes, &camera(), rough).unwrap(), 0.2);
}

#[test]
fn finds_sphere_with_a_third_hidden() {
    let planes = planes(2.0, |p| p.x + 0.4 * p.y < 240.0);
    let rough = RoughSphere {
        centre: DVec2::new(290.0, 180.0),
        radius: None,
    };
    check(&outline(&planes, &camera(), rough).unwrap(), 0.5);
}

#[test]
fn rejects_wall() {
    let (codes, _) = render((480, 400), 2.0, |p| if p.x < 200.0 { 0.2 } else { 0.5 });
    let planes = [codes.clone(), codes.clone(), codes];
    let rough = RoughSphere {
        centre: DVec2::new(240.0, 200.0),
        radius: None,
    };
    assert!(outline(&planes, &camera(), rough).is_err());
    let rough = RoughSphere {
        centre: DVec2::NAN,
        radius: None,
    };
    assert!(outline(&planes, &camera(), rough).is_err());
}

/// A small sphere before a floor with many edges, more than are searched on one ray.
fn small_sphere() -> ([Grey; 3], DVec2, f64) {
    let (centre, radius) = (DVec2::new(250.0, 190.0), 26.0);
    let (codes, _) = render((480, 400), 2.0, |p| {
        let q = p - centre;
        if q.length() < radius {
            return if q.y > 0.3 * q.x { 0.55 } else { 0.75 };
        }
        let tile = (p.x / 9.0).floor() + (p.y / 11.0).floor();
        let ring = if q.length() < 130.0 { 0.0 } else { 0.12 };
        ring + if tile.rem_euclid(2.0) == 0.0 {
            0.1
        } else {
            0.25
        }
    });
    ([codes.clone(), codes.clone(), codes], centre, radius)
}

#[test]
fn finds_a_small_sphere_from_its_centre_alone() {
    let (planes, centre, radius) = small_sphere();
    let click = RoughSphere {
        centre: centre + DVec2::new(3.0, -2.0),
        radius: None,
    };
    let positions = click.candidates(DVec2::new(480.0, 400.0));
    let found = best_outline(&planes, &camera(), positions).unwrap();
    let size = 700.0 * found.half_angle.tan();
    assert!((size - radius).abs() < 1.0, "{size} {found:?}");
    let at = camera().project(found.axis).unwrap();
    assert!(at.distance(centre) < 1.0, "{at}");
}
