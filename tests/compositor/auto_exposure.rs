//! Automatic exposure, which adapts to the light of virtual lamps.

use crate::exposure::table;
use crate::stage::{Stage, cell, lighting, noise};
use glam::Vec3;
use penumbra_camera::Response;
use penumbra_compositor::Exposure;
use penumbra_compositor::exposure::{ActiveExposure, AutoLimits};
use penumbra_picture::Picture;
use penumbra_scene::{LampResponse, PlacedLamp};

fn lamp(intensity: f32) -> PlacedLamp {
    PlacedLamp {
        position: Vec3::new(0.0, 0.0, 0.4),
        direction: Vec3::NEG_Z,
        intensity: Vec3::splat(intensity),
        cone: None,
        area: None,
    }
}

const LIMITS: AutoLimits = AutoLimits {
    darkest: -3.0,
    brightest: 0.0,
    key: 0.01,
    adaptation_seconds: 0.3,
};

/// A table lit by a lamp, or by none if `intensity` is 0.
fn lamp_stage(intensity: f32) -> Stage {
    let mut stage = Stage::new(160, 120).lit(lighting(vec![cell(Vec3::Z, Vec3::splat(2.0))], 0.0));
    stage.picture = noise(160, 120);
    let pixels = stage.picture.rgba.iter_mut();
    pixels.for_each(|v| *v = 60 + *v / 8);
    if intensity > 0.0 {
        stage.lamps = vec![lamp(intensity)];
    }
    stage
}

fn mean_luminance(picture: &Picture) -> f64 {
    let response = Response::srgb();
    let pixels = picture.rgba.chunks_exact(4);
    let sum: f64 = pixels
        .map(|p| {
            let [r, g, b] = response.linear_from_rgb([p[0], p[1], p[2]]).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        })
        .sum();
    sum / f64::from(picture.width * picture.height)
}

/// Exposures and pictures of a lamp that is switched on after 10 pictures and off after 110.
fn switched(frames: u32) -> Vec<(ActiveExposure, Picture)> {
    let (mut on, mut off) = (lamp_stage(0.6), lamp_stage(0.0));
    let mut compositor = on.compositor();
    let frame = |i: u32| {
        let stage = if (10..110).contains(&i) {
            &mut on
        } else {
            &mut off
        };
        stage.exposure = Exposure::Automatic {
            limits: LIMITS,
            seconds: f64::from(i) / 30.0,
        };
        let picture = stage.compose_with(&mut compositor);
        (compositor.exposure(), picture)
    };
    (0..frames).map(frame).collect()
}

#[test]
fn automatic_exposure_keeps_the_mean_changes_smoothly_and_returns_exactly() {
    let frames = switched(230);
    let stops: Vec<f32> = frames.iter().map(|f| f.0.stops).collect();
    assert!(stops[..12].iter().all(|s| *s == 0.0), "{stops:?}");
    assert!(stops[12..110].is_sorted_by(|a, b| a >= b), "{stops:?}");
    assert!(stops[112..].is_sorted(), "{stops:?}");
    let steps = stops.array_windows().map(|[a, b]| (b - a).abs());
    assert!(steps.fold(0.0, f32::max) < 0.15, "{stops:?}");
    assert!((stops[109] - stops[105]).abs() < 1e-3);
    assert_eq!(stops.last(), Some(&0.0));
    // Closed form: the camera's mean over that of the picture with the lamp.
    let camera = lamp_stage(0.0);
    let lit = mean_luminance(&lamp_stage(0.6).compose());
    let expected = (mean_luminance(&camera.picture) / lit).log2() as f32;
    assert!(
        expected < -0.3,
        "the lamp is too weak for the test: {expected}"
    );
    assert!(
        (stops[109] - expected).abs() < 0.03,
        "{} {expected}",
        stops[109]
    );
    let kept = mean_luminance(&frames[109].1) / mean_luminance(&camera.picture);
    assert!((kept - 1.0).abs() < 0.03, "{kept}");
    for untouched in [0, 9, 229] {
        assert!(frames[untouched].1 == camera.picture, "{untouched}");
    }
}

#[test]
fn same_pictures_get_the_same_exposures() {
    assert!(switched(40) == switched(40));
}

#[test]
fn shadows_alone_brighten_only_dark_pictures_and_within_limits() {
    let mut stage = table();
    let settle = |stage: &mut Stage, key: f32, brightest: f32| {
        let limits = AutoLimits {
            brightest,
            key,
            adaptation_seconds: 0.0,
            ..LIMITS
        };
        let mut compositor = stage.compositor();
        for i in 0..4 {
            stage.exposure = Exposure::Automatic {
                limits,
                seconds: f64::from(i),
            };
            stage.compose_with(&mut compositor);
        }
        compositor.exposure()
    };
    let none = settle(&mut stage, 0.01, 1.0);
    let brightness = none.brightness.unwrap();
    assert_eq!(none.stops, 0.0);
    assert!(brightness.taken > 0.001 && brightness.added == 0.0);
    let key = 1.5 * brightness.lit();
    let up = settle(&mut stage, key, 1.0);
    assert!((up.stops - 1.5_f32.log2()).abs() < 0.01, "{up:?}");
    assert_eq!(settle(&mut stage, key, 0.25).stops, 0.25);
    assert_eq!(settle(&mut stage, key, 0.0).stops, 0.0);
    // Without virtual objects nothing changes.
    stage.scene.virtual_parts.clear();
    assert_eq!(settle(&mut stage, key, 1.0).stops, 0.0);
}

/// The light of lamps is measured both as a factor and as separate light.
#[test]
fn light_of_both_responses_is_measured() {
    for response in [LampResponse::Intrinsic, LampResponse::Paper] {
        let mut stage = lamp_stage(0.3);
        stage.lamp_response = response;
        stage.brightest = Vec3::new(0.0, 0.3, 0.4);
        let lit = mean_luminance(&stage.compose());
        let mut compositor = stage.compositor();
        for i in 0..4 {
            stage.exposure = Exposure::Automatic {
                limits: LIMITS,
                seconds: f64::from(i) / 30.0,
            };
            stage.compose_with(&mut compositor);
        }
        let measured = compositor.exposure().brightness.unwrap();
        let added = lit - mean_luminance(&stage.picture);
        assert!(added > 0.02, "{added}");
        assert!(
            (f64::from(measured.added) / added - 1.0).abs() < 0.03,
            "{response:?}: {measured:?}, {added}"
        );
    }
}
