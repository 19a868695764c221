//! Shorter exposures by the paper's rule (DiVerdi and Höllerer 2004, section 4.3): every pixel's
//! factor rises with the mean intensity of the region around it.

use crate::stage::{Stage, flat, noise, sun};
use glam::Vec3;
use penumbra_compositor::Exposure;
use penumbra_picture::Picture;
use penumbra_scene::Highlights;
use penumbra_scene::primitives;

/// A table under one sun, in another exposure by the paper's rule.
fn shown(picture: Picture, stops: f32) -> Stage {
    let mut stage = Stage::new(picture.width, picture.height).lit(crate::stage::lighting(
        vec![sun(Vec3::Z, Vec3::splat(2.0))],
        0.0,
    ));
    stage.picture = picture;
    stage.exposure = Exposure::Stops(stops);
    stage.highlights = Highlights::Paper;
    // Only a picture with virtual objects is exposed.
    stage.with_virtual(crate::stage::part(
        primitives::cuboid(Vec3::splat(0.01)),
        glam::DVec3::new(5.0, 5.0, 0.0),
    ))
}

fn code(stage: &Stage, linear: f32) -> u8 {
    stage.response.code_from_linear(linear)
}

#[test]
fn factor_of_a_uniform_picture_lies_between_the_exposures_and_one() {
    for (value, stops) in [(90, -1.0), (180, -1.0), (180, -3.0), (230, -8.0)] {
        let stage = shown(flat(64, 48, [value; 3]), stops);
        let m = stage.response.linear_from_rgb([value; 3])[0];
        let f = stops.exp2();
        let expected = code(&stage, m * (f + (1.0 - f) * m));
        let found = stage.compose();
        assert!(
            found
                .rgba
                .iter()
                .step_by(4)
                .all(|v| v.abs_diff(expected) <= 1),
            "{value}, {stops}: {} instead of {expected}",
            found.rgba[0]
        );
    }
}

#[test]
fn white_stays_white_and_every_code_stays_without_darkening() {
    let white = shown(flat(64, 48, [255; 3]), -4.0);
    assert!(white.compose().rgba.iter().all(|v| *v == 255));
    let untouched = shown(noise(101, 67), 0.0);
    assert!(untouched.compose() == untouched.picture);
    // A longer exposure is the same under both rules.
    let mut longer = shown(noise(101, 67), 0.7);
    let ours = longer.compose();
    longer.highlights = Highlights::Estimated;
    assert!(ours == longer.compose());
}

/// "The center of overexposed regions will remain bright while the edges fade with the rest."
#[test]
fn large_white_disc_stays_bright_in_the_centre_and_fades_at_its_edge() {
    let mut picture = flat(160, 120, [60; 3]);
    for (i, pixel) in (0_u32..).zip(picture.rgba.chunks_exact_mut(4)) {
        let (x, y) = ((i % 160) as f32 - 80.0, (i / 160) as f32 - 60.0);
        if x.hypot(y) < 35.0 {
            pixel[..3].fill(255);
        }
    }
    let found = shown(picture, -1.0).compose();
    let at = |x: u32| found.rgb(x, 60)[0];
    assert!(at(80) >= 250, "{}", at(80));
    assert!(at(80 + 33) < 240, "{}", at(80 + 33));
    assert!(at(80) > at(80 + 28) && at(80 + 28) > at(80 + 33));
}

#[test]
fn gpu_matches_the_twin() {
    for (width, height, stops) in [(101, 67, -0.3), (160, 120, -1.0), (64, 48, -3.0)] {
        let stage = shown(noise(width, height), stops);
        let (ours, twin) = (stage.compose(), stage.twin().picture);
        let off = ours
            .rgba
            .chunks_exact(4)
            .zip(twin.rgba.chunks_exact(4))
            .flat_map(|(a, b)| (0..3).map(|c| a[c].abs_diff(b[c])))
            .max();
        assert!(off.is_some_and(|off| off <= 1), "{width}×{height}: {off:?}");
    }
}
