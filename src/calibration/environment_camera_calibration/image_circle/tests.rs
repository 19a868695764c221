use super::super::synthetic::{render, room};
use super::*;

const CENTRE: DVec2 = DVec2::new(243.3, 236.8);

fn fisheye(
    size: (usize, usize),
    radius: f64,
    noise: f64,
    seen: impl Fn(DVec2) -> f64,
) -> (Grey, Grey) {
    render(size, noise, |p| {
        let r = p.distance(CENTRE);
        // An edge one pixel wide.
        let inside = (radius + 0.5 - r).clamp(0.0, 1.0);
        inside * seen(p) + 0.0004
    })
}

#[test]
fn finds_circle_in_noise_within_a_fifth_of_a_pixel() {
    let (codes, linear) = fisheye((480, 480), 221.4, 3.0, room);
    let found = image_circle(&codes, &linear).unwrap();
    assert!(found.centre.distance(CENTRE) < 0.15, "{found:?}");
    assert!((found.radius - 221.4).abs() < 0.2, "{found:?}");
    assert!(found.centre_sigma.max_element() < 0.1 && found.radius_sigma < 0.5);
    assert!(
        found.stretch.0.abs() < 3.0 * found.stretch.1.max(1e-3),
        "{:?}",
        found.stretch
    );
}

#[test]
fn finds_circle_with_dark_half_and_flare() {
    let (codes, linear) = render((480, 480), 2.0, |p| {
        let inside = (200.5 - p.distance(CENTRE)).clamp(0.0, 1.0);
        let lit = if p.x < 200.0 { 0.0 } else { 0.2 };
        let flare = 0.05 * (-p.distance_squared(DVec2::new(440.0, 60.0)) / 800.0).exp();
        inside * lit + flare + 0.0004
    });
    let found = image_circle(&codes, &linear).unwrap();
    assert!(
        found.centre.distance(CENTRE) < 0.5 && (found.radius - 200.0).abs() < 0.5,
        "{:?} {}",
        found.centre,
        found.radius
    );
    assert!(found.seen < 0.75, "{}", found.seen);
}

#[test]
fn finds_circle_cut_off_by_the_frame() {
    let (codes, linear) = fisheye((480, 360), 230.0, 2.0, |_| 0.3);
    let found = image_circle(&codes, &linear).unwrap();
    assert!(
        found.centre.distance(CENTRE) < 0.6 && (found.radius - 230.0).abs() < 0.6,
        "{:?} {}",
        found.centre,
        found.radius
    );
}

#[test]
fn detects_stretched_picture() {
    let (codes, linear) = render((480, 480), 2.0, |p| {
        let d = (p - CENTRE) / DVec2::new(1.01, 1.0);
        (200.5 - d.length()).clamp(0.0, 1.0) * 0.3
    });
    let (stretch, sigma) = image_circle(&codes, &linear).unwrap().stretch;
    assert!(
        (stretch - 0.01).abs() < 0.003 && stretch > 3.0 * sigma,
        "{stretch} {sigma}"
    );
}

#[test]
fn refuses_picture_without_circle() {
    let (codes, linear) = render((480, 480), 2.0, room);
    assert!(image_circle(&codes, &linear).is_err());
    let (codes, linear) = render((480, 360), 2.0, |_| 0.2);
    assert_eq!(image_circle(&codes, &linear), Err(NoCircle::None));
    // A round lamp shade before a patterned wall.
    let (codes, linear) = render((480, 480), 2.0, |p| {
        let wall = 0.1 + 0.1 * (0.2 * p.x).sin() * (0.17 * p.y).cos();
        if p.distance(CENTRE) < 150.0 {
            0.6
        } else {
            wall
        }
    });
    let refused = image_circle(&codes, &linear);
    assert!(
        matches!(refused, Err(NoCircle::PictureBeyond { .. })),
        "{refused:?}"
    );
    let tiny = Grey {
        width: 3,
        height: 2,
        data: vec![0.0; 6],
    };
    assert!(image_circle(&tiny, &tiny).is_err());
}
