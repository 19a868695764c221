#![allow(clippy::unwrap_used)]

use super::*;
use crate::radiometric::drawn::normal;
use penumbra_picture::Picture;

/// A scene of even patches from black to ten times white, under an exposure.
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

fn gathered(response: &Response, stops: &[f64], said: &[f64], noise: f64) -> SeriesGatherer {
    let mut gatherer = SeriesGatherer::default();
    let pictures: Vec<Picture> = stops
        .iter()
        .enumerate()
        .map(|(i, ev)| picture(response, ev.exp2(), noise, i as u64))
        .collect();
    let series: Vec<(&Picture, f64)> = pictures
        .iter()
        .zip(said)
        .map(|(p, ev)| (p, ev * std::f64::consts::LN_2))
        .collect();
    gatherer.add(&series);
    gatherer
}

fn worst(curve: &Curve, truth: &Response) -> f64 {
    let ratio = |z: usize| {
        let ratio = curve.response.linear_from_code()[z] / truth.linear_from_code()[z];
        f64::from(ratio).ln()
    };
    // A factor is part of the exposure.
    (16..=250)
        .map(|z| (ratio(z) - ratio(128)).abs())
        .fold(0.0, f64::max)
}

fn shouldered() -> Response {
    // A film-like curve: contrast in the middle, a soft shoulder.
    let curve = |z: f64| z.powf(2.0) * (0.55 + 0.45 * z.powi(6));
    let table: Vec<f32> = (0..256)
        .map(|z| curve(f64::from(z) / 255.0) as f32)
        .collect();
    Response::from_table(&table).unwrap()
}

#[test]
fn known_curves_come_back_within_their_error() {
    let stops = [0.0, -1.0, -2.0, -3.0, -4.0];
    for truth in [
        Response::srgb(),
        Response::gamma(2.2),
        Response::linear(),
        shouldered(),
    ] {
        let curve = fit(&gathered(&truth, &stops, &stops, 0.001), 0.01).unwrap();
        let off = worst(&curve, &truth);
        assert!(off < 0.04, "{off} {}", curve.rms);
        let (apart, sigmas) = curve.apart(&truth);
        assert!(apart < 0.02 && sigmas < 4.0, "{apart} {sigmas}");
    }
}

#[test]
fn brackets_four_stops_apart_suffice() {
    let stops = [0.0, -4.0, -8.0];
    for truth in [Response::srgb(), Response::gamma(2.2)] {
        let curve = fit(&gathered(&truth, &stops, &stops, 0.001), 0.01).unwrap();
        let (apart, sigmas) = curve.apart(&truth);
        assert!(apart < 0.05 && sigmas < 4.0, "{apart} {sigmas}");
        // And they tell sRGB from a gamma.
        let other = if truth == Response::srgb() {
            Response::linear()
        } else {
            Response::gamma(1.6)
        };
        assert!(curve.apart(&other).1 > 5.0);
    }
}

#[test]
fn rough_exposures_are_corrected_within_what_is_allowed() {
    let (stops, said) = ([0.0, -1.0, -2.0, -3.0], [0.0, -1.1, -2.0, -2.9]);
    let truth = Response::srgb();
    let curve = fit(&gathered(&truth, &stops, &said, 0.001), 0.08).unwrap();
    let (apart, sigmas) = curve.apart(&truth);
    assert!(apart < 0.08 && sigmas < 3.0, "{apart} {sigmas}");
    assert!(curve.largest_sigma() > 0.01);
}

#[test]
fn what_is_no_series_is_said() {
    let srgb = Response::srgb();
    let of = |stops: &[f64], said: &[f64]| {
        fit(&gathered(&srgb, stops, said, 0.001), 0.01)
            .map(|_| ())
            .unwrap_err()
    };
    assert_eq!(of(&[0.0, 0.0], &[0.0, 0.0]), NoCurve::OneExposure);
    assert_eq!(of(&[0.0, 0.0, 0.0], &[0.0, -2.0, -4.0]), NoCurve::Alike);
    assert_eq!(
        of(&[-2.0, -1.0, 0.0], &[0.0, -1.0, -2.0]),
        NoCurve::Reversed
    );
    assert!(matches!(
        of(&[0.0, -14.0], &[0.0, -14.0]),
        NoCurve::TooFew { .. }
    ));
    let text = of(&[0.0, -1.0, -2.0], &[0.0, -3.0, -3.5]).to_string();
    assert!(text.contains("contradict"), "{text}");
}
