//! Pictures in another exposure than the camera's: closed forms, the twin, and the camera's
//! unchanged codes where nothing is to change.

use crate::comparison::{Rule, assert_like};
use crate::stage::{Stage, even_sky, flat, lighting, matt, noise, painted, spiral};
use glam::{DVec3, Vec3};
use penumbra_camera::Response;
use penumbra_compositor::Exposure;
use penumbra_compositor::exposure::ActiveExposure;
use penumbra_compositor::reference::exposure::exposed;
use penumbra_picture::Picture;
use penumbra_scene::Highlights;
use penumbra_scene::ShadowMode;
use penumbra_scene::{Material, Part, primitives};

fn cube() -> Part {
    painted(
        primitives::cuboid(Vec3::splat(0.1)),
        DVec3::ZERO,
        matt(Vec3::new(0.8, 0.3, 0.2)),
    )
}

/// A table under an even light with a cube on it.
pub fn table() -> Stage {
    Stage::new(96, 72)
        .with_virtual(cube())
        .lit(lighting(spiral(8, 2.0), 0.2))
}

/// A stage without virtual objects.
fn bare(picture: Picture) -> Stage {
    let mut stage = Stage::new(picture.width, picture.height);
    stage.picture = picture;
    stage
}

/// `picture` with an ellipse of `codes` in it.
fn with_disc(mut picture: Picture, (x, y): (f32, f32), radius: f32, codes: [u8; 3]) -> Picture {
    for v in 0..picture.height {
        for u in 0..picture.width {
            if (u as f32 - x).hypot(v as f32 - y) <= radius {
                let at = 4 * (v * picture.width + u) as usize;
                picture.rgba[at..at + 3].copy_from_slice(&codes);
            }
        }
    }
    picture
}

fn greatest_difference(a: &Picture, b: &Picture) -> u8 {
    let pairs = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    let off = pairs.flat_map(|(a, b)| (0..3).map(move |c| a[c].abs_diff(b[c])));
    off.max().unwrap()
}

#[test]
fn unchanged_exposure_keeps_every_code_and_adds_no_pass() {
    let mut stage = Stage::new(101, 67);
    stage.picture = noise(101, 67);
    let mut stage = stage.lit(lighting(spiral(8, 2.0), 0.5));
    let mut compositor = stage.compositor();
    let exact = [
        Exposure::Camera,
        Exposure::Stops(0.0),
        Exposure::Stops(-0.0),
        Exposure::Stops(f32::NAN),
    ];
    for exposure in exact {
        // After a frame in another exposure, so that leftovers would show.
        stage.exposure = Exposure::Stops(-2.0);
        assert!(stage.compose_with(&mut compositor) != stage.picture);
        stage.exposure = exposure;
        assert!(stage.compose_with(&mut compositor) == stage.picture);
        let passes = compositor.pass_times();
        assert!(
            passes.iter().all(|(name, _)| !name.starts_with("exposure")),
            "{passes:?}"
        );
        assert_eq!(compositor.exposure(), ActiveExposure::default());
    }
    // With virtual objects, too, the picture is the same as before.
    let mut full = table();
    let before = full.compose();
    let mut compositor = full.compositor();
    full.exposure = Exposure::Stops(-1.0);
    assert!(full.compose_with(&mut compositor) != before);
    full.exposure = Exposure::Camera;
    assert!(full.compose_with(&mut compositor) == before);
}

#[test]
fn uniform_picture_is_scaled_through_the_response() {
    for response in [Response::srgb(), Response::linear(), Response::gamma(2.2)] {
        for stops in [-6.0, -2.0, -1.0, -0.1, 0.3, 1.0] {
            let mut stage = bare(flat(70, 50, [200, 120, 3]));
            stage.response = response.clone();
            stage.exposure = Exposure::Stops(stops);
            let out = stage.compose();
            let linear = response.linear_from_rgb([200, 120, 3]);
            let expected = linear.map(|v| response.code_from_linear(v * stops.exp2()));
            let expected_picture = flat(70, 50, expected);
            assert!(
                greatest_difference(&out, &expected_picture) <= 1,
                "{stops}: {expected:?}"
            );
        }
    }
}

#[test]
fn gpu_matches_the_twin() {
    let busy = with_disc(noise(101, 67), (40.0, 30.0), 13.0, [255, 255, 255]);
    let warm = with_disc(
        flat(97, 130, [190, 140, 80]),
        (50.0, 60.0),
        20.0,
        [255, 252, 180],
    );
    let warm = with_disc(warm, (50.0, 60.0), 9.0, [255, 254, 251]);
    let white = flat(33, 35, [255; 3]);
    for picture in [busy, warm, white, noise(5, 3), flat(1, 1, [255; 3])] {
        for stops in [-0.2, -1.0, -2.0, -5.0, 0.7] {
            let mut stage = bare(picture.clone());
            stage.exposure = Exposure::Stops(stops);
            let off = greatest_difference(&stage.compose(), &stage.twin().picture);
            let size = (picture.width, picture.height);
            assert!(off <= 1, "{size:?} {stops}: {off} codes");
        }
    }
}

#[test]
fn virtual_objects_are_shown_in_the_same_exposure() {
    for stops in [-1.5, 0.8] {
        for mode in [ShadowMode::Ratio, ShadowMode::Subtract] {
            let mut stage = table();
            (stage.exposure, stage.mode) = (Exposure::Stops(stops), mode);
            let name = format!("exposed-{stops}-{mode:?}");
            assert_like(&name, &stage.compose(), &stage.twin(), Rule::within(2));
        }
    }
    // Virtual surfaces, without a ground.
    let mut stage = Stage::new(96, 72)
        .without_ground()
        .with_virtual(cube())
        .lit(even_sky(0.7));
    stage.exposure = Exposure::Stops(-2.0);
    let rule = Rule {
        on_virtual: true,
        calm: 0.2,
        ..Rule::within(2)
    };
    assert_like("exposed-virtual", &stage.compose(), &stage.twin(), rule);
}

/// Linear light that the output shows at a pixel.
fn shown(picture: &Picture, (x, y): (u32, u32)) -> Vec3 {
    Vec3::from(Response::srgb().linear_from_rgb(picture.rgb(x, y)))
}

#[test]
fn small_clipped_disc_in_the_dark_stays_white_and_its_surroundings_darken() {
    let dark = with_disc(flat(320, 240, [60; 3]), (160.0, 120.0), 4.0, [255; 3]);
    let mut stage = bare(dark);
    for (stops, still_white) in [(-1.0, true), (-2.0, true), (-3.0, true), (-8.0, false)] {
        stage.exposure = Exposure::Stops(stops);
        let out = stage.compose();
        assert_eq!(out.rgb(160, 120) == [255; 3], still_white, "{stops}");
        let expected = stage.response.linear_from_rgb([60; 3])[0] * stops.exp2();
        let code = stage.response.code_from_linear(expected);
        assert!(out.rgb(10, 10)[0].abs_diff(code) <= 1, "{stops}");
        // No halo: next to the disc the picture is as dark as far away.
        assert!(out.rgb(165, 120)[0].abs_diff(code) <= 1, "{stops}");
    }
}

#[test]
fn brightness_of_a_clipped_disc_follows_the_mean_around_it() {
    // The region has 79 pixels, at −2.5 stops in 288 rows; the disc fills an eighth of it, so that
    // it is taken for a window: 3 (1 − surroundings)² above white.
    for code in [60_u8, 128, 188, 240] {
        let disc = with_disc(flat(320, 288, [code; 3]), (160.0, 144.0), 16.0, [255; 3]);
        let mut stage = bare(disc);
        stage.exposure = Exposure::Stops(-2.5);
        let around = stage.response.linear_from_rgb([code; 3])[0];
        let level = 1.0 + 3.0 * (1.0 - around).powi(2);
        let expected = stage.response.code_from_linear(level * (-2.5_f32).exp2());
        let found = stage.compose().rgb(160, 144)[0];
        // The closed form neglects the small weight of the default surroundings.
        assert!(
            found.abs_diff(expected) <= 2,
            "{code}: {found}, expected {expected}"
        );
    }
}

#[test]
fn longer_exposure_never_darkens_a_pixel() {
    let warm = with_disc(
        flat(160, 120, [150, 110, 70]),
        (90.0, 60.0),
        17.0,
        [255, 250, 180],
    );
    let mut stage = bare(with_disc(warm, (90.0, 60.0), 11.0, [255; 3]));
    let mut compositor = stage.compositor();
    let mut before: Option<Picture> = None;
    // Up to just below the camera's own exposure, in which a code near white may stand for more
    // light.
    for step in 0..24 {
        stage.exposure = Exposure::Stops(-6.0 + 0.25 * step as f32);
        let out = stage.compose_with(&mut compositor);
        if let Some(before) = before {
            let pairs = before.rgba.iter().zip(&out.rgba);
            let worst = pairs.map(|(b, o)| i32::from(*b) - i32::from(*o)).max();
            assert!(worst <= Some(0), "step {step}: {worst:?} codes darker");
        }
        before = Some(out);
    }
}

#[test]
fn partly_clipped_colour_keeps_its_hue() {
    // A light on a warm wall: only red is clipped, and the wall next to it gives the ratio of red
    // to green.
    let wall = [180, 130, 70];
    let response = Response::srgb();
    let linear = Vec3::from(response.linear_from_rgb(wall));
    let bright = (linear * 2.6)
        .to_array()
        .map(|v| response.code_from_linear(v));
    assert!(bright[0] == 255 && bright[1] < 243);
    let mut stage = bare(with_disc(flat(160, 120, wall), (80.0, 60.0), 12.0, bright));
    stage.exposure = Exposure::Stops(-2.0);
    let found = shown(&stage.compose(), (80, 60));
    let expected = linear * (2.6 / 4.0);
    assert!(
        (found / expected - Vec3::ONE).abs().max_element() < 0.03,
        "{found} {expected}"
    );
    let scaled = Vec3::from(response.linear_from_rgb(bright)) / 4.0;
    assert!(scaled.x < 0.87 * expected.x, "nothing was clipped");
}

#[test]
fn twin_scales_linearly_where_nothing_is_clipped() {
    let mut picture = noise(40, 30);
    picture.rgba.iter_mut().for_each(|v| *v = (*v).min(240));
    let response = Response::srgb();
    for (pixel, linear) in
        picture
            .rgba
            .chunks_exact(4)
            .zip(exposed(&picture, &response, 0.25, Highlights::Estimated))
    {
        let full = response.linear_from_rgb([pixel[0], pixel[1], pixel[2]]);
        assert_eq!(linear.as_vec3(), Vec3::from(full) * 0.25);
    }
}

#[test]
fn reflections_do_not_depend_on_the_exposure() {
    let chrome = Material {
        metallic: 1.0,
        roughness: 0.1,
        ..Material::default()
    };
    let sphere = painted(
        primitives::sphere(0.1, 48, 24),
        DVec3::new(0.0, 0.0, 0.1),
        chrome,
    );
    let mut stage = Stage::new(96, 72)
        .with_virtual(sphere)
        .lit(lighting(spiral(8, 2.0), 0.2));
    // A highlight on the table that the sphere mirrors.
    stage.picture = with_disc(stage.picture, (48.0, 66.0), 3.0, [255; 3]);
    let inside = crate::comparison::virtual_inside(&stage.twin(), 2);
    let before = stage.compose();
    stage.exposure = Exposure::Stops(-1.0);
    let after = stage.compose();
    for i in (0..96 * 72).filter(|i| inside[*i as usize]) {
        let at = (i % 96, i / 96);
        let (full, half) = (shown(&before, at), shown(&after, at));
        if full.max_element() < 0.98 {
            assert!(
                (half * 2.0 - full).abs().max_element() < 0.02,
                "{at:?}: {full} {half}"
            );
        }
    }
}
