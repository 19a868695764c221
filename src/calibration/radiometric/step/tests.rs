use super::*;
use crate::radiometric::synthetic::SyntheticChart;
use crate::step::PictureInput;
use glam::{DVec2, DVec3};
use penumbra_camera::Response;
use penumbra_camera::vignetting::default_frame;
use penumbra_interface::MonotonicTime;
use penumbra_rig_model::RigDocument;
use penumbra_rig_model::radiometric_file::{RADIOMETRIC, apply_radiometric_file};

const SCENE: [(f64, f64); 4] = [
    (120.0, 90.0),
    (370.0, 110.0),
    (360.0, 240.0),
    (130.0, 230.0),
];
const ENVIRONMENT: [(f64, f64); 4] = [
    (300.0, 330.0),
    (310.0, 120.0),
    (430.0, 130.0),
    (420.0, 340.0),
];

fn synthetic(corners: [(f64, f64); 4], gains: DVec3, seed: u64) -> SyntheticChart {
    SyntheticChart {
        gains,
        seed,
        ..SyntheticChart::new((640, 480), corners)
    }
}

fn observe(step: &mut Radiometric, camera: CameraRole, picture: &Picture, seconds: f64, ev: f64) {
    step.observe(&StepInput::Picture(PictureInput {
        camera,
        picture,
        captured_at: MonotonicTime::from_nanos((1e9 * seconds) as i64),
        bracket_ev: ev,
        exposure: None,
        seconds,
    }));
}

fn calibrate(scene: &SyntheticChart, environment: &SyntheticChart) -> Finished {
    let mut step = Radiometric::new(RadiometricOptions::default());
    observe(&mut step, CameraRole::Scene, &scene.picture(), 0.0, 0.0);
    observe(
        &mut step,
        CameraRole::Environment,
        &environment.picture(),
        0.0,
        0.0,
    );
    step.finish(&CalibrationProvenance::default())
}

fn apply(found: &Finished) -> RigDocument {
    let mut rig = RigDocument::uncalibrated(640, 480);
    let bytes = found.file.as_ref().unwrap().as_bytes();
    apply_radiometric_file(&mut rig, &|name| (name == RADIOMETRIC).then_some(bytes)).unwrap();
    rig
}

#[test]
fn chart_yields_gains_within_a_percent_through_the_file() {
    let (a, b) = (DVec3::new(0.95, 0.8, 0.7), DVec3::new(0.2, 0.25, 0.3));
    let found = calibrate(&synthetic(SCENE, a, 1), &synthetic(ENVIRONMENT, b, 2));
    assert_eq!(found.grade, Grade::Good, "{found:?}");
    let gains = apply(&found).calibration.gains.unwrap().estimate;
    let error = gains.percent_from(a / b);
    assert!(error.abs().max_element() < 1.0, "{error}");
    for c in 0..3 {
        assert!(
            error[c].abs() < 400.0 * gains.relative_sd[c],
            "{error} {gains:?}"
        );
    }
    assert!(found.report.contains("data:image/png") && found.report.contains("ΔE2000 before"));
}

#[test]
fn reports_bad_light_and_missing_charts() {
    let good = synthetic(SCENE, DVec3::splat(0.9), 1);
    let mut mixed = synthetic(ENVIRONMENT, DVec3::splat(0.5), 2);
    mixed.light = |p| DVec3::new(1.0 + 0.12 * p.x, 1.0, 1.0 - 0.08 * p.x);
    let clipped = synthetic(ENVIRONMENT, DVec3::splat(9.0), 2);
    let none = synthetic(
        [(-900.0, 0.0), (-800.0, 0.0), (-800.0, 60.0), (-900.0, 60.0)],
        DVec3::ONE,
        1,
    );
    for (scene, environment, grade, message) in [
        (&good, &mixed, Grade::Usable, "mixed light"),
        (&good, &clipped, Grade::Usable, "correct its exposure"),
        (
            &good,
            &none,
            Grade::Refused,
            "environment camera sees no chart",
        ),
        (&none, &none, Grade::Refused, "neither camera sees a chart"),
    ] {
        let found = calibrate(scene, environment);
        let text = format!("{:?}", found.findings);
        assert!(text.contains(message), "{message}: {text}");
        assert_eq!(found.grade, grade, "{text}");
        assert_eq!(found.file.is_none(), grade == Grade::Refused);
    }
}

#[test]
fn contradicting_exposures_alone_are_refused() {
    let chart = |brightness: f64, seed| {
        let gains = DVec3::splat(brightness);
        synthetic(
            [(-900.0, 0.0), (-800.0, 0.0), (-800.0, 60.0), (-900.0, 60.0)],
            gains,
            seed,
        )
        .picture()
    };
    let calibrated = |stated: [f64; 4]| {
        let pictures = [0.1, 0.2, 0.4, 0.8].map(|b: f64| (chart(b, 1), b.ln()));
        let mut step = Radiometric::new(RadiometricOptions::default());
        let series = pictures.iter().zip(stated);
        let series: Vec<(&Picture, f64)> = series
            .map(|((picture, log), factor)| (picture, log + factor.ln()))
            .collect();
        step.add_series(CameraRole::Scene, &series);
        step.finish(&CalibrationProvenance::default())
    };
    let found = calibrated([1.0, 1.6, 0.6, 1.5]);
    assert_eq!(found.grade, Grade::Refused, "{found:?}");
    assert!(found.file.is_none() && !found.findings.is_empty());
}

#[test]
fn single_camera_yields_its_colours() {
    let mut step = Radiometric::new(RadiometricOptions::default());
    let picture = synthetic(SCENE, DVec3::new(0.95, 0.8, 0.7), 1).picture();
    observe(&mut step, CameraRole::Scene, &picture, 0.0, 0.0);
    let found = step.finish(&CalibrationProvenance::default());
    let file: serde_json::Value = serde_json::from_str(found.file.as_ref().unwrap()).unwrap();
    let colours = &file["scene_camera"]["colours"];
    let matrix = colours["matrix"][0][0].as_f64().unwrap();
    assert!((matrix * 0.95 - 1.0).abs() < 0.05, "{colours}");
    let balanced = colours["delta_e_balanced"].as_f64().unwrap();
    assert!(balanced > 0.0 && balanced < 2.0, "{colours}");
    apply(&found);
}

#[test]
fn reads_the_larger_of_two_charts() {
    let gains = DVec3::splat(0.9);
    let scene = synthetic(SCENE, gains, 1);
    let mut both = scene.picture();
    let apart = [
        (400.0, 300.0),
        (600.0, 300.0),
        (600.0, 420.0),
        (400.0, 420.0),
    ];
    synthetic(apart, gains, 2).draw_over(&mut both);
    let mut step = Radiometric::new(RadiometricOptions::default());
    observe(&mut step, CameraRole::Scene, &both, 0.0, 0.0);
    observe(
        &mut step,
        CameraRole::Environment,
        &scene.picture(),
        0.0,
        0.0,
    );
    let found = step.finish(&CalibrationProvenance::default());
    assert_eq!(found.grade, Grade::Usable);
    assert!(
        found.findings[0].1.contains("2 charts"),
        "{:?}",
        found.findings
    );
    let gains = apply(&found).calibration.gains.unwrap().estimate;
    assert!(gains.percent_from(DVec3::ONE).abs().max_element() < 1.0);
}

#[test]
fn detects_swapped_cameras() {
    let mut step = Radiometric::new(RadiometricOptions {
        sizes: [Some((640, 480)), Some((480, 480))],
        ..RadiometricOptions::default()
    });
    let mut square = synthetic(SCENE, DVec3::splat(0.9), 1);
    square.size = (480, 480);
    observe(&mut step, CameraRole::Scene, &square.picture(), 0.0, 0.0);
    let wide = synthetic(ENVIRONMENT, DVec3::splat(0.9), 1).picture();
    observe(&mut step, CameraRole::Environment, &wide, 0.0, 0.0);
    let found = step.finish(&CalibrationProvenance::default());
    assert_eq!(found.grade, Grade::Refused);
    assert!(
        found.findings[0].1.contains("swapped"),
        "{:?}",
        found.findings
    );
}

#[test]
fn brackets_correct_a_wrong_tone_curve() {
    let ground_truth = Response::gamma(2.2);
    let mut step = Radiometric::new(RadiometricOptions {
        responses: [Response::srgb(), Response::gamma(1.6)],
        ..RadiometricOptions::default()
    });
    for ev in [0.0, -2.0, -4.0] {
        let gains = DVec3::splat(3.0 * f64::exp2(ev));
        let mut picture = synthetic(ENVIRONMENT, gains, 1);
        (picture.response, picture.noise) = (ground_truth.clone(), 0.0005);
        observe(
            &mut step,
            CameraRole::Environment,
            &picture.picture(),
            0.0,
            ev,
        );
    }
    let found = step.finish(&CalibrationProvenance::default());
    assert!(found.file.is_some(), "{found:?}");
    assert!(
        found
            .lines
            .iter()
            .any(|l| l.contains("tone curve gamma 2.2")),
        "{:?}",
        found.lines
    );
}

#[test]
fn refuses_empty_input() {
    let found =
        Radiometric::new(RadiometricOptions::default()).finish(&CalibrationProvenance::default());
    assert_eq!(found.grade, Grade::Refused);
    assert!(found.findings[0].1.contains("nothing to calibrate from"));
}

#[test]
fn measures_noise_of_static_pictures_only() {
    let mut step = Radiometric::new(RadiometricOptions::default());
    for i in 0..4 {
        let mut still = synthetic(SCENE, DVec3::splat(0.9), 10 + i);
        still.noise = 0.003;
        observe(
            &mut step,
            CameraRole::Scene,
            &still.picture(),
            0.2 * i as f64,
            0.0,
        );
        let moved = SCENE.map(|(x, y)| (x + 4.0 * i as f64, y + i as f64));
        let moving = synthetic(moved, DVec3::splat(0.9), 20 + i);
        observe(
            &mut step,
            CameraRole::Environment,
            &moving.picture(),
            0.2 * i as f64,
            0.0,
        );
    }
    assert_eq!(step.data[0].noise.pairs, 3);
    assert_eq!((step.data[1].noise.pairs, step.data[1].moved), (0, 3));
    let noise = step.data[0].noise.finish(&Response::srgb()).unwrap();
    let sigma = (noise.read[1] + 0.2 * noise.shot[1]).sqrt();
    assert!((sigma / 0.003 - 1.0).abs() < 0.1, "{sigma}");
}

#[test]
fn white_wall_determines_vignetting() {
    let wall = |k: f64| {
        let mut picture = Picture {
            width: 640,
            height: 480,
            rgba: Vec::new(),
        };
        let (centre, radius) = default_frame((640, 480), None);
        for i in 0..640 * 480 {
            let p = DVec2::new(f64::from(i % 640), f64::from(i / 640));
            let q = (p - centre).length_squared() / (radius * radius);
            // The wall is lit from the side.
            let light = 0.5 * (1.0 + 0.05 * (p.x - centre.x) / radius) * (1.0 + k * q);
            let code = Response::srgb().code_from_linear(light as f32);
            picture.rgba.extend([code, code, code, 255]);
        }
        picture
    };
    for (k, is_significant) in [(-0.4, true), (0.0, false)] {
        let mut step = Radiometric::new(RadiometricOptions::default());
        step.add_flat(CameraRole::Scene, &wall(k));
        let found = step.finish(&CalibrationProvenance::default());
        let lens = apply(&found).calibration.scene_camera.vignetting;
        assert_eq!(lens.is_some(), is_significant, "{found:?}");
        if let Some(lens) = lens {
            assert!((lens.at(DVec2::ZERO) - (1.0 + k)).abs() < 0.02, "{lens:?}");
        }
    }
}
