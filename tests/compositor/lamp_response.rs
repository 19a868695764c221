//! The response of real surfaces to lamps: that of the paper (DiVerdi and Höllerer 2004, section
//! 4.2) against its twin and closed forms.

use crate::comparison::{Rule, assert_like};
use crate::golden::{assert_golden, golden_stage};
use crate::stage::{Stage, cell, flat, lighting, looking_from, noise, part, sun};
use glam::{DVec3, Vec3};
use penumbra_compositor::Exposure;
use penumbra_lighting::{BrightestLight, DomeLight};
use penumbra_picture::Picture;
use penumbra_scene::{LampResponse, Part, PlacedLamp, ShadowMode, primitives};
use std::f32::consts::PI;

fn point(position: Vec3, intensity: Vec3) -> PlacedLamp {
    PlacedLamp {
        position,
        direction: Vec3::NEG_Z,
        intensity,
        cone: None,
        area: None,
    }
}

/// Chooses the paper's response under `lights`.
fn respond_by_paper(stage: &mut Stage, lights: &[DomeLight]) {
    stage.lamp_response = LampResponse::Paper;
    stage.brightest = BrightestLight::from_lights(lights).vector();
}

/// A uniform table of code values `codes` under `lights`, seen from above.
fn table(codes: [u8; 3], lights: Vec<DomeLight>, lamps: Vec<PlacedLamp>) -> Stage {
    let mut stage = Stage::new(96, 72);
    respond_by_paper(&mut stage, &lights);
    stage = stage.lit(lighting(lights, 0.0));
    stage.picture = flat(96, 72, codes);
    stage.pose = Some(looking_from(DVec3::new(0.0, -0.01, 0.8), DVec3::ZERO));
    stage.lamps = lamps;
    stage
}

fn cuboid(size: Vec3, at: DVec3) -> Part {
    part(primitives::cuboid(size), at)
}

fn code_at(stage: &Stage, picture: &Picture, world: Vec3) -> [u8; 3] {
    let inverse = stage.pose.unwrap().inverse();
    let seen = inverse.rotation * world.as_dvec3() + inverse.translation;
    let pixel = stage.camera.project(seen).unwrap().round();
    picture.rgb(pixel.x as u32, pixel.y as u32)
}

/// A distant lamp towards `to`, whose irradiance on the table's centre, facing the lamp, is
/// `facing`.
fn far(to: Vec3, facing: Vec3) -> PlacedLamp {
    point(to.normalize() * 40.0, facing * 1600.0)
}

#[track_caller]
fn assert_adds(stage: &Stage, response: f32, facing: Vec3) {
    let picture = stage.compose();
    let video = Vec3::from(stage.response.linear_from_rgb(stage.picture.rgb(0, 0)));
    let expected = video + facing * (response / PI);
    let codes = expected
        .to_array()
        .map(|v| stage.response.code_from_linear(v));
    let found = code_at(stage, &picture, Vec3::ZERO);
    let off = (0..3).map(|c| found[c].abs_diff(codes[c])).max().unwrap();
    assert!(off <= 1, "{found:?}, expected {codes:?}");
    // The twin has it too.
    let twin = code_at(stage, &stage.twin().picture, Vec3::ZERO);
    let off = (0..3).map(|c| twin[c].abs_diff(codes[c])).max().unwrap();
    assert!(off <= 1, "twin {twin:?}, expected {codes:?}");
}

const TO_SUN: Vec3 = Vec3::new(0.6, 0.0, 0.8);
const CODES: [u8; 3] = [150, 120, 90];
const FACING: Vec3 = Vec3::new(0.9, 0.6, 0.3);

fn intensity(stage: &Stage) -> f32 {
    let video = Vec3::from(stage.response.linear_from_rgb(CODES));
    video.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

#[test]
fn lamp_beside_the_sun_scales_the_video() {
    let stage = table(
        CODES,
        vec![sun(TO_SUN, Vec3::splat(2.0))],
        vec![far(TO_SUN, FACING)],
    );
    let response = intensity(&stage);
    assert_adds(&stage, response, FACING);
}

#[test]
fn lamp_at_a_right_angle_to_the_sun_is_shaded_by_the_cosine() {
    let to = Vec3::new(-0.8, 0.0, 0.6);
    let stage = table(
        CODES,
        vec![sun(TO_SUN, Vec3::splat(2.0))],
        vec![far(to, FACING)],
    );
    assert_adds(&stage, 0.6, FACING);
}

/// No visible surface can face two opposite lights, but a low sun and a low lamp are nearly
/// opposite.
#[test]
fn lamp_opposite_to_the_sun_scales_the_inverted_video() {
    let (low, opposite) = (Vec3::new(0.96, 0.0, 0.28), Vec3::new(-0.96, 0.0, 0.28));
    let stage = table(
        CODES,
        vec![sun(low, Vec3::splat(2.0))],
        vec![far(opposite, FACING)],
    );
    let alpha = low.dot(opposite);
    assert!(alpha < -0.8);
    let response = (1.0 + alpha) * 0.28 - alpha * (1.0 - intensity(&stage));
    assert_adds(&stage, response, FACING);
}

#[test]
fn two_equal_suns_and_a_uniform_sky_use_the_cosine_alone() {
    let second = Vec3::new(-0.6, 0.0, 0.8);
    let two = vec![sun(TO_SUN, Vec3::ONE), sun(second, Vec3::ONE)];
    for lights in [two, crate::stage::spiral(64, 2.0)] {
        // The spiral's cells differ in strength and have no solid angle: both are set.
        let cells = lights.len() as f32;
        let lights: Vec<_> = lights
            .into_iter()
            .map(|l| DomeLight {
                irradiance: Vec3::splat(l.irradiance.y),
                angular_radius: (1.0 - 1.0 / cells).acos(),
                ..l
            })
            .collect();
        let stage = table(CODES, lights, vec![far(TO_SUN, FACING)]);
        assert_adds(&stage, 0.8, FACING);
    }
}

/// A white surface that faces the lamp shows its irradiance over π, by both responses.
#[test]
fn both_responses_agree_on_white() {
    let daylight = Vec3::splat(0.6 * PI);
    let lights = vec![
        sun(Vec3::X + Vec3::Z * 1e-3, Vec3::ZERO),
        cell(Vec3::Z, daylight),
    ];
    let mut stage = table([0; 3], lights, vec![far(Vec3::new(0.3, 0.2, 0.9), FACING)]);
    // White shows irradiance / π.
    let code = stage.response.code_from_linear(0.6);
    stage.picture = flat(96, 72, [code; 3]);
    stage.lamp_response = LampResponse::Paper;
    stage.brightest = Vec3::ZERO;
    let paper = stage.compose();
    stage.lamp_response = LampResponse::Intrinsic;
    let intrinsic = stage.compose();
    for at in [Vec3::ZERO, Vec3::new(0.2, 0.1, 0.0)] {
        let (a, b) = (code_at(&stage, &paper, at), code_at(&stage, &intrinsic, at));
        assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 1), "{a:?} {b:?}");
        assert!(a != [code; 3]);
    }
}

#[test]
fn added_light_is_tinted_by_the_phantoms_albedo() {
    let albedo = Vec3::new(0.8, 0.4, 0.2);
    let to = Vec3::new(-0.8, 0.0, 0.6);
    let mut stage = table(
        CODES,
        vec![sun(TO_SUN, Vec3::splat(2.0))],
        vec![far(to, FACING)],
    );
    stage.scene.phantom_parts[0].albedo = Some(albedo);
    assert_adds(&stage, 0.6, FACING * albedo);
}

/// Real and virtual boxes, two lamps, a sun.
fn furnished() -> Stage {
    let lights = vec![
        sun(Vec3::new(0.5, -0.2, 0.8), Vec3::new(1.2, 1.1, 1.0)),
        cell(Vec3::Z, Vec3::new(0.5, 0.6, 0.7)),
    ];
    let mut stage = Stage::new(128, 96)
        .with_virtual(cuboid(
            Vec3::new(0.06, 0.06, 0.08),
            DVec3::new(-0.05, 0.0, 0.0),
        ))
        .with_phantom(cuboid(
            Vec3::new(0.05, 0.08, 0.06),
            DVec3::new(0.1, 0.05, 0.0),
        ));
    stage.scene.phantom_parts[1].albedo = Some(Vec3::new(0.3, 0.6, 0.9));
    respond_by_paper(&mut stage, &lights);
    stage = stage.lit(lighting(lights, 0.0));
    let mut spot = point(Vec3::new(0.15, -0.2, 0.3), Vec3::new(0.2, 0.15, 0.1));
    spot.direction = Vec3::new(-0.5, 0.6, -1.0).normalize();
    spot.cone = Some((0.3, 0.7));
    stage.lamps = vec![
        point(Vec3::new(-0.25, 0.15, 0.2), Vec3::new(0.02, 0.04, 0.08)),
        spot,
    ];
    stage
}

#[test]
fn every_pixel_matches_the_twin() {
    for (name, mode) in [
        ("response", ShadowMode::Ratio),
        ("response-subtract", ShadowMode::Subtract),
    ] {
        for paper in [true, false] {
            let mut stage = furnished();
            stage.mode = mode;
            if !paper {
                stage.lamp_response = LampResponse::Intrinsic;
            }
            let rule = Rule {
                slack: 3,
                ..Rule::within(3)
            };
            assert_like(name, &stage.compose(), &stage.twin(), rule);
        }
    }
}

#[test]
fn light_is_added_in_the_shown_exposure() {
    let mut stage = furnished();
    stage.exposure = Exposure::Stops(-1.0);
    let rule = Rule {
        slack: 3,
        ..Rule::within(3)
    };
    assert_like("response-exposed", &stage.compose(), &stage.twin(), rule);
}

#[test]
fn every_code_stays_without_active_lamps() {
    let mut full = furnished();
    full.scene.virtual_parts.clear();
    full.picture = noise(128, 96);
    let mut compositor = full.compositor();
    assert!(full.compose_with(&mut compositor) != full.picture);
    type Case = (&'static str, fn(&mut Stage));
    let cases: [Case; 6] = [
        ("hidden", |s| s.show_virtual = false),
        ("no pose", |s| s.pose = None),
        ("no light", |s| s.lighting = None),
        ("dark", |s| {
            s.lamps.iter_mut().for_each(|l| l.intensity = Vec3::ZERO)
        }),
        ("far", |s| {
            s.lamps.iter_mut().for_each(|l| l.position.z = 1e4)
        }),
        ("gone", |s| s.lamps.clear()),
    ];
    for (what, change) in cases {
        let mut stage = full.clone();
        change(&mut stage);
        assert!(
            stage.compose_with(&mut compositor) == stage.picture,
            "{what}"
        );
    }
}

#[test]
fn switching_the_response_leaves_no_trace() {
    let mut stage = furnished();
    let paper = stage.compose();
    let mut compositor = stage.compositor();
    let there = stage.lamp_response;
    stage.lamp_response = LampResponse::Intrinsic;
    let intrinsic = stage.compose_with(&mut compositor);
    assert!(intrinsic != paper);
    stage.lamp_response = there;
    assert!(stage.compose_with(&mut compositor) == paper);
    stage.lamp_response = LampResponse::Intrinsic;
    assert!(stage.compose_with(&mut compositor) == intrinsic);
    // A direction with NaN counts as none.
    stage.lamp_response = LampResponse::Paper;
    stage.brightest = Vec3::NAN;
    let wrong = stage.compose_with(&mut compositor);
    stage.lamp_response = LampResponse::Paper;
    stage.brightest = Vec3::ZERO;
    assert!(stage.compose_with(&mut compositor) == wrong);
}

/// The painted table with a box, two lamps on either side.
#[test]
fn golden_lamps_by_the_papers_response() {
    let mut stage = golden_stage().with_virtual(cuboid(
        Vec3::new(0.08, 0.08, 0.1),
        DVec3::new(-0.02, 0.02, 0.0),
    ));
    let lights = stage.lighting.as_ref().map(|l| l.lights.clone());
    respond_by_paper(&mut stage, &lights.unwrap_or_default());
    stage.lamps = vec![
        point(Vec3::new(0.3, -0.05, 0.15), Vec3::new(0.06, 0.05, 0.03)),
        point(Vec3::new(-0.3, -0.05, 0.15), Vec3::new(0.02, 0.04, 0.08)),
    ];
    assert_golden("lamp-response", &stage.compose());
}
