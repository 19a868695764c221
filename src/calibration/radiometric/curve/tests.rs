use super::*;
use crate::radiometric::synthetic::normal;
use penumbra_camera::Response;
use penumbra_picture::Picture;

/// A scene of uniform patches from black to ten times white, under an exposure.
fn picture(response: &Response, exposure: f64, noise: f64, seed: u64) -> Picture {
    let (width, height) = (320u32, 240u32);
    let mut rgba = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let patch = (x / 8) + 40 * (y / 8);
            let light = 0.002 * (0.0072 * f64::from(patch)).exp();
            for c in 0..3u32 {
                let i = u64::from(4 * (y * width + x) + c);
                let value = exposure * light * (1.0 + 0.2 * f64::from(c));
                let noise = noise * normal(seed, i);
                rgba.push(response.code_from_linear((value + noise) as f32));
            }
            rgba.push(255);
        }
    }
    Picture {
        width,
        height,
        rgba,
    }
}

fn gathered(response: &Response, stops: &[f64], stated: &[f64], noise: f64) -> SeriesGatherer {
    let mut gatherer = SeriesGatherer::default();
    let pictures: Vec<Picture> = stops
        .iter()
        .enumerate()
        .map(|(i, ev)| picture(response, ev.exp2(), noise, i as u64))
        .collect();
    let series: Vec<(&Picture, f64)> = pictures
        .iter()
        .zip(stated)
        .map(|(p, ev)| (p, ev * std::f64::consts::LN_2))
        .collect();
    gatherer.add(&series);
    gatherer
}

fn max_error(curve: &Curve, ground_truth: &Response) -> f64 {
    let ratio = |z: usize| {
        let ratio = curve.response.linear_from_code()[z] / ground_truth.linear_from_code()[z];
        f64::from(ratio).ln()
    };
    // A factor is part of the exposure.
    (16..=250)
        .map(|z| (ratio(z) - ratio(128)).abs())
        .fold(0.0, f64::max)
}

fn film_like() -> Response {
    // A film-like curve: contrast in the middle, a soft shoulder.
    let curve = |z: f64| z.powf(2.0) * (0.55 + 0.45 * z.powi(6));
    let table: Vec<f32> = (0..256)
        .map(|z| curve(f64::from(z) / 255.0) as f32)
        .collect();
    Response::from_table(&table).unwrap()
}

#[test]
fn recovers_known_curves_within_their_error() {
    let stops = [0.0, -1.0, -2.0, -3.0, -4.0];
    for ground_truth in [
        Response::srgb(),
        Response::gamma(2.2),
        Response::linear(),
        film_like(),
    ] {
        let curve = fit(&gathered(&ground_truth, &stops, &stops, 0.001), 0.01).unwrap();
        let error = max_error(&curve, &ground_truth);
        assert!(error < 0.04, "{error} {}", curve.rms);
        let (apart, sigmas) = curve.difference(&ground_truth);
        assert!(apart < 0.02 && sigmas < 4.0, "{apart} {sigmas}");
    }
}

#[test]
fn brackets_four_stops_apart_suffice() {
    let stops = [0.0, -4.0, -8.0];
    for ground_truth in [Response::srgb(), Response::gamma(2.2)] {
        let curve = fit(&gathered(&ground_truth, &stops, &stops, 0.001), 0.01).unwrap();
        let (apart, sigmas) = curve.difference(&ground_truth);
        assert!(apart < 0.05 && sigmas < 4.0, "{apart} {sigmas}");
        // They distinguish sRGB from a gamma.
        let other = if ground_truth == Response::srgb() {
            Response::linear()
        } else {
            Response::gamma(1.6)
        };
        assert!(curve.difference(&other).1 > 5.0);
    }
}

#[test]
fn corrects_approximate_exposures_within_their_uncertainty() {
    let (stops, stated) = ([0.0, -1.0, -2.0, -3.0], [0.0, -1.1, -2.0, -2.9]);
    let ground_truth = Response::srgb();
    let curve = fit(&gathered(&ground_truth, &stops, &stated, 0.001), 0.08).unwrap();
    let (apart, sigmas) = curve.difference(&ground_truth);
    assert!(apart < 0.08 && sigmas < 3.0, "{apart} {sigmas}");
    assert!(curve.largest_sigma() > 0.01);
}

#[test]
fn refuses_invalid_series() {
    let srgb = Response::srgb();
    let error = |stops: &[f64], stated: &[f64]| {
        fit(&gathered(&srgb, stops, stated, 0.001), 0.01)
            .map(|_| ())
            .unwrap_err()
    };
    assert_eq!(error(&[0.0, 0.0], &[0.0, 0.0]), NoCurve::OneExposure);
    assert_eq!(
        error(&[0.0, 0.0, 0.0], &[0.0, -2.0, -4.0]),
        NoCurve::Unchanged
    );
    assert_eq!(
        error(&[-2.0, -1.0, 0.0], &[0.0, -1.0, -2.0]),
        NoCurve::Reversed
    );
    assert!(matches!(
        error(&[0.0, -14.0], &[0.0, -14.0]),
        NoCurve::TooFew { .. }
    ));
    let text = error(&[0.0, -1.0, -2.0], &[0.0, -3.0, -3.5]).to_string();
    assert!(text.contains("inconsistent"), "{text}");
}
