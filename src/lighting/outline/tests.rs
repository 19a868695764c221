use super::*;
use glam::DVec3;
use penumbra_camera::SphereInCamera;

fn camera() -> PinholeCamera {
    PinholeCamera {
        width: 320,
        height: 240,
        focal: DVec2::splat(400.0),
        centre: DVec2::new(160.3, 118.8),
        distortion: [0.0; 5],
    }
}

fn ground_truth() -> SphereInCamera {
    SphereInCamera {
        centre: DVec3::new(0.03, -0.02, 0.5),
        radius: 0.045,
        sigma: 0.0,
    }
}

/// A sphere that mirrors stripes, before a background of this colour by pixel.
fn draw(background: impl Fn(f64, f64) -> [f64; 3]) -> Picture {
    let (camera, ball) = (camera(), ground_truth());
    let mut rgba = Vec::new();
    for (y, x) in (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (y, x))) {
        let mut sum = [0.0; 3];
        for k in 0..16 {
            let at = DVec2::new(
                f64::from(x) + f64::from(k % 4) / 4.0 - 0.375,
                f64::from(y) + f64::from(k / 4) / 4.0 - 0.375,
            );
            let ray = camera.unproject(at);
            let along = ray.dot(ball.centre);
            let inside = ball.radius.powi(2) - (ball.centre.length_squared() - along * along);
            let shown = if inside > 0.0 {
                let normal = (ray * (along - inside.sqrt()) - ball.centre) / ball.radius;
                let seen = ray - 2.0 * ray.dot(normal) * normal;
                let stripe = (7.0 * seen.x).sin() * (5.0 * seen.y).cos();
                [
                    90.0 + 60.0 * stripe,
                    100.0 - 50.0 * stripe,
                    110.0 + 30.0 * seen.z,
                ]
            } else {
                background(at.x, at.y)
            };
            for c in 0..3 {
                sum[c] += shown[c] / 16.0;
            }
        }
        rgba.extend(sum.map(|v| v.round().clamp(0.0, 255.0) as u8));
        rgba.push(255);
    }
    Picture {
        width: camera.width,
        height: camera.height,
        rgba,
    }
}

/// The true sphere displaced by the error of a pose, pixels.
fn displaced(error_pixels: DVec2, sigma: f64) -> SphereInCamera {
    let pixel = camera().project(ground_truth().centre).unwrap();
    SphereInCamera {
        centre: camera().unproject(pixel + error_pixels) * ground_truth().centre.length(),
        sigma,
        ..ground_truth()
    }
}

fn error_pixels(ball: &SphereInCamera) -> f64 {
    let camera = camera();
    camera
        .project(ball.centre)
        .unwrap()
        .distance(camera.project(ground_truth().centre).unwrap())
}

#[test]
fn rim_corrects_jitter_of_pose() {
    let picture = draw(|x, _| [200.0, 170.0 + 0.1 * x, 120.0]);
    for k in 0..12 {
        let error = 2.5 * DVec2::from_angle(0.7 * f64::from(k)) * f64::from(k) / 11.0;
        let found = refine(&picture, &camera(), &displaced(error, 1.0));
        // A twelfth of the pose's error remains: its share in the mean.
        assert!(
            error_pixels(&found) < 0.05 + 0.1 * error.length(),
            "{error} -> {}",
            error_pixels(&found)
        );
        assert!(found.sigma < 0.35 && found.radius == 0.045);
    }
}

#[test]
fn pose_is_kept_without_visible_rim() {
    // The background equals the colours at the sphere's rim: no edge is visible.
    let grey = Picture {
        width: 320,
        height: 240,
        rgba: [100, 100, 100, 255].repeat(320 * 240),
    };
    let before = displaced(DVec2::new(0.4, -0.2), 0.5);
    assert_eq!(refine(&grey, &camera(), &before), before);
    let mut state = 7_u32;
    let noise = Picture {
        rgba: (0..320 * 240)
            .flat_map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let v = (state >> 24) as u8;
                [v, v, v, 255]
            })
            .collect(),
        ..grey.clone()
    };
    let found = refine(&noise, &camera(), &before);
    assert!(error_pixels(&found) < 1.0, "{}", error_pixels(&found));
    // Truncated, or out of sight.
    let short = Picture {
        rgba: vec![0; 5],
        ..grey.clone()
    };
    assert_eq!(refine(&short, &camera(), &before), before);
    let beside = SphereInCamera {
        centre: DVec3::new(3.0, 0.0, 0.5),
        ..before
    };
    assert_eq!(refine(&grey, &camera(), &beside), beside);
}

#[test]
fn half_a_rim_corrects_only_the_constrained_direction() {
    // The lower half blends into its background; the upper one is distinct.
    let picture = draw(|_, y| {
        if y < 100.0 {
            [230.0, 220.0, 200.0]
        } else {
            [100.0, 100.0, 100.0]
        }
    });
    let before = displaced(DVec2::new(0.0, 1.2), 0.6);
    let found = refine(&picture, &camera(), &before);
    assert!(error_pixels(&found) < 0.5, "{}", error_pixels(&found));
}

/// A grey table with a printed line through it.
fn table(x: f64, y: f64) -> [f64; 3] {
    if (y - 0.2 * x - 100.0).abs() < 1.0 {
        [40.0; 3]
    } else {
        [190.0; 3]
    }
}

#[test]
fn sphere_that_a_hand_placed_is_found_many_pixels_off() {
    let picture = draw(table);
    for error in [(12.0, -9.0), (-15.0, 4.0), (0.5, 0.0)] {
        let predicted = displaced(DVec2::from(error), 6.0);
        let found = locate(&picture, &camera(), &predicted).unwrap();
        assert!(
            error_pixels(&found.sphere) < 0.6,
            "{error:?}: {}",
            error_pixels(&found.sphere)
        );
        assert!(found.support > 0.8, "{error:?}: {}", found.support);
    }
}

#[test]
fn place_without_a_sphere_has_hardly_any_rim() {
    let camera = camera();
    let rgba = (0..camera.height)
        .flat_map(|y| (0..camera.width).map(move |x| table(f64::from(x), f64::from(y))))
        .flat_map(|c| [c[0] as u8, c[1] as u8, c[2] as u8, 255])
        .collect();
    let picture = Picture {
        width: camera.width,
        height: camera.height,
        rgba,
    };
    let found = locate(&picture, &camera, &displaced(DVec2::ZERO, 6.0));
    assert!(found.is_none_or(|f| f.support < 0.3), "{found:?}");
}
