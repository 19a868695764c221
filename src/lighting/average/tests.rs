use super::*;
use crate::light::{CubeMap, DomeLight, Harmonics, LightKind};
use crate::place::LightPlace;
use glam::Vec3;
use penumbra_interface::MonotonicTime;

/// Light of a picture `number`, 15 a second: a lamp of a height and a flux, and a sky.
fn lighting(number: u64, height: f32, flux: f32) -> Arc<Lighting> {
    let light = |direction: Vec3, flux, kind| DomeLight {
        direction: direction.normalize(),
        irradiance: Vec3::splat(flux),
        angular_radius: 0.05,
        kind,
        place: LightPlace::FAR,
    };
    Arc::new(Lighting {
        captured_at: MonotonicTime::from_nanos(number as i64 * 66_000_000),
        generation: number,
        radiance: Arc::new(CubeMap::default()),
        irradiance: Harmonics::default(),
        lights: vec![
            light(Vec3::new(1.0, 0.0, height), flux, LightKind::Compact),
            light(Vec3::Z, 1.0, LightKind::Cell),
        ],
        ground_radiance: Vec3::ZERO,
        faces: None,
    })
}

/// Noise of a mean of 0 and a standard deviation of 1.
fn noise(number: u64) -> f32 {
    let hash = |k: u64| {
        let mut x = (2 * number + k + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^= x >> 31;
        (x >> 40) as f32 / (1 << 24) as f32
    };
    (hash(0) + hash(1) - 1.0) * 6.0_f32.sqrt()
}

fn flux(lighting: &Lighting) -> f32 {
    lighting.lights[0].irradiance.x
}

fn standard_deviation(values: &[f32]) -> f32 {
    let n = values.len() as f32;
    let mean = values.iter().sum::<f32>() / n;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n).sqrt()
}

#[test]
fn noise_of_constant_light_is_averaged() {
    let mut average = LightAverage::default();
    let estimates: Vec<f32> = (0..100).map(|k| 1.0 + 0.004 * noise(k)).collect();
    let averaged: Vec<f32> = (0..)
        .zip(&estimates)
        .map(|(k, f)| flux(&average.add(lighting(k, 1.0, *f))))
        .collect();
    let before = standard_deviation(&estimates[30..]);
    let after = standard_deviation(&averaged[30..]);
    assert!(before > 0.003 && after < 0.3 * before, "{before} {after}");
    let step = averaged[30..].windows(2).map(|w| (w[1] - w[0]).abs());
    let largest = step.fold(0.0, f32::max);
    // Of 70 estimates one or two exceed 2.5 σ and count for a little more.
    assert!(largest < 0.4 * before, "{largest}");
}

#[test]
fn change_beyond_the_noise_is_followed_at_once() {
    let mut average = LightAverage::default();
    for k in 0..40 {
        average.add(lighting(k, 1.0, 1.0 + 0.004 * noise(k)));
    }
    let after = average.add(lighting(40, 1.0, 1.1));
    assert!((flux(&after) - 1.1).abs() < 1e-6);
    // A new average: it weighs both estimates equally.
    let next = average.add(lighting(41, 1.0, 1.101));
    assert!((flux(&next) - 1.1005).abs() < 1e-5);
}

#[test]
fn light_that_switches_all_the_time_is_not_averaged() {
    let mut average = LightAverage::default();
    for k in 0..100 {
        let actual = if k % 2 == 0 { 1.0 } else { 3.0 };
        let shown = flux(&average.add(lighting(k, 1.0, actual)));
        assert!((shown - actual).abs() < 1e-6, "{shown} at {k}");
    }
}

/// Repeated and late pictures hold as they are.
#[test]
fn picture_that_is_not_later_starts_again() {
    let mut average = LightAverage::default();
    average.add(lighting(5, 1.0, 1.0));
    average.add(lighting(6, 1.0, 1.001));
    for (k, actual) in [(6, 1.002), (4, 1.001)] {
        let shown = flux(&average.add(lighting(k, 1.0, actual)));
        assert!((shown - actual).abs() < 1e-6, "{shown} at {k}");
    }
}

#[test]
fn slow_change_is_followed_within_the_noise() {
    let mut average = LightAverage::default();
    for k in 0..200 {
        let actual = 1.0 + 0.001 * k as f32;
        let shown = flux(&average.add(lighting(k, 1.0, actual + 0.002 * noise(k))));
        assert!(
            (shown / actual - 1.0).abs() < 0.015,
            "{shown} of {actual} at {k}"
        );
    }
}

#[test]
fn directions_are_those_of_the_estimate() {
    let mut average = LightAverage::default();
    for k in 0..10 {
        let estimate = lighting(k, 1.0 + 0.002 * k as f32, 1.0);
        let shown = average.add(Arc::clone(&estimate));
        assert!(
            shown.lights[0]
                .direction
                .distance(estimate.lights[0].direction)
                < 1e-6
        );
        assert_eq!(shown.captured_at, estimate.captured_at);
        assert_eq!(shown.generation, k);
    }
}

#[test]
fn pause_or_other_dome_starts_again() {
    let mut average = LightAverage::default();
    for k in 0..10 {
        average.add(lighting(k, 1.0, 1.0));
    }
    let later = average.add(lighting(100, 1.0, 1.001));
    assert!((flux(&later) - 1.001).abs() < 1e-6);
    let mut other = Lighting::clone(&lighting(101, 1.0, 1.002));
    other.lights.truncate(1);
    assert!((flux(&average.add(Arc::new(other))) - 1.002).abs() < 1e-6);
}
