//! Preview of the environment light.

use glam::{Vec2, Vec3};
use penumbra_camera::srgb_from_linear;
use penumbra_lighting::{DomeLight, LightKind};
use penumbra_picture::Picture;
use std::f32::consts::{FRAC_PI_2, PI};

/// Share of the picture that may be brighter than the picture can show.
const BURNT_SHARE: f32 = 0.05;
/// Value to which that brightness is mapped, linear.
const BRIGHT: f32 = 0.75;
/// Radius of the mark of a light of average irradiance, as a share of the height.
const MARK_SHARE: f32 = 0.016;
const AMBER: Vec3 = Vec3::new(242.0, 184.0, 75.0);
const WHITE: Vec3 = Vec3::new(255.0, 255.0, 255.0);
const DARK: Vec3 = Vec3::new(13.0, 15.0, 19.0);

/// The environment map by longitude and latitude, twice as wide as high, with its dome
/// lights: a white ring for each cell, an amber disc for each compact source, the larger
/// the brighter. World +X is in the middle, +Y to the left, +Z on top: the view from the scene
/// along +X. `radiance` is linear, by world
/// direction.
#[must_use]
pub fn environment_preview(
    height: u32,
    radiance: impl Fn(Vec3) -> Vec3,
    lights: &[DomeLight],
) -> Picture {
    let width = 2 * height;
    let direction =
        |i: u32| direction_of(Vec2::new((i % width) as f32, (i / width) as f32), height);
    let linear: Vec<Vec3> = (0..width * height)
        .map(|i| radiance(direction(i)))
        .collect();
    let scale = exposure(&linear);
    let mut picture = Picture {
        width,
        height,
        rgba: linear.iter().flat_map(|l| encoded(*l * scale)).collect(),
    };
    draw_lights(&mut picture, lights);
    picture
}

/// World direction of a pixel.
fn direction_of(pixel: Vec2, height: u32) -> Vec3 {
    let azimuth = PI - (pixel.x + 0.5) * PI / height as f32;
    let elevation = FRAC_PI_2 - (pixel.y + 0.5) * PI / height as f32;
    let (sin, cos) = elevation.sin_cos();
    Vec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin)
}

/// Pixel of a world direction; the inverse of [`direction_of`].
fn pixel_of(direction: Vec3, height: u32) -> Vec2 {
    let azimuth = direction.y.atan2(direction.x);
    let elevation = direction.z.clamp(-1.0, 1.0).asin();
    let per_radian = height as f32 / PI;
    Vec2::new(
        (PI - azimuth) * per_radian - 0.5,
        (FRAC_PI_2 - elevation) * per_radian - 0.5,
    )
}

/// Returns the factor by which all but the brightest directions are visible.
fn exposure(linear: &[Vec3]) -> f32 {
    let mut peaks: Vec<f32> = linear
        .iter()
        .map(|l| l.max_element())
        .filter(|p| p.is_finite())
        .collect();
    let rank = (peaks.len() as f32 * (1.0 - BURNT_SHARE)) as usize;
    if rank >= peaks.len() {
        return 1.0;
    }
    let (_, bright, _) = peaks.select_nth_unstable_by(rank, f32::total_cmp);
    if *bright > 0.0 { BRIGHT / *bright } else { 1.0 }
}

fn encoded(linear: Vec3) -> [u8; 4] {
    let [r, g, b] = linear
        .to_array()
        .map(|x| (srgb_from_linear(x) * 255.0).round() as u8);
    [r, g, b, 255]
}

/// Draws the marks, faint ones first, so that bright ones stay on top.
fn draw_lights(picture: &mut Picture, lights: &[DomeLight]) {
    let strength = |l: &DomeLight| l.irradiance.max_element();
    let mut shining: Vec<&DomeLight> = lights.iter().filter(|l| strength(l) > 0.0).collect();
    shining.sort_by(|a, b| strength(a).total_cmp(&strength(b)));
    let mean = shining.iter().map(|l| strength(l)).sum::<f32>() / shining.len().max(1) as f32;
    for light in shining {
        let relative = (strength(light) / mean).sqrt().clamp(0.6, 2.2);
        let radius = (MARK_SHARE * picture.height as f32).max(2.0) * relative;
        let centre = pixel_of(light.direction, picture.height);
        draw_mark(picture, centre, radius, light.kind == LightKind::Compact);
    }
}

/// Draws a disc or a ring of 1.5 pixels, both with a dark rim that is visible on any sky.
fn draw_mark(picture: &mut Picture, centre: Vec2, radius: f32, disc: bool) {
    let reach = (radius + 3.0).ceil() as i64;
    let (cx, cy) = (centre.x.round() as i64, centre.y.round() as i64);
    for y in (cy - reach).max(0)..=(cy + reach).min(i64::from(picture.height) - 1) {
        for x in cx - reach..=cx + reach {
            let distance = Vec2::new(x as f32, y as f32).distance(centre);
            let from_line = if disc {
                distance - radius
            } else {
                (distance - radius).abs() - 0.75
            };
            let colour = if disc { AMBER } else { WHITE };
            let x = x.rem_euclid(i64::from(picture.width)) as usize;
            let at = 4 * (y as usize * picture.width as usize + x);
            blend(
                &mut picture.rgba[at..at + 3],
                DARK,
                0.7 * coverage(from_line - 1.0),
            );
            blend(&mut picture.rgba[at..at + 3], colour, coverage(from_line));
        }
    }
}

/// Returns the share of a pixel inside an edge at a distance in pixels.
fn coverage(from_edge: f32) -> f32 {
    (0.5 - from_edge).clamp(0.0, 1.0)
}

fn blend(pixel: &mut [u8], colour: Vec3, share: f32) {
    for (code, c) in pixel.iter_mut().zip(colour.to_array()) {
        *code = (f32::from(*code) + share * (c - f32::from(*code))).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_lighting::LightPlace;
    use proptest::prelude::*;

    const HEIGHT: u32 = 128;

    fn light(direction: Vec3, kind: LightKind) -> DomeLight {
        DomeLight {
            direction,
            irradiance: Vec3::ONE,
            angular_radius: 0.1,
            kind,
            place: LightPlace::FAR,
        }
    }

    proptest! {
        #[test]
        fn pixel_and_direction_are_inverse(x in 0.0_f32..255.0, y in 0.0_f32..127.0) {
            let back = pixel_of(direction_of(Vec2::new(x, y), HEIGHT), HEIGHT);
            prop_assert!((back.y - y).abs() < 0.05);
            let around = (back.x - x + 128.0).rem_euclid(256.0) - 128.0;
            // Near the poles the longitude is inaccurate.
            let latitude = ((y + 0.5) * PI / 128.0).sin();
            prop_assert!(around.abs() * latitude < 0.05, "{around}");
        }

        #[test]
        fn draws_any_light_without_panic(
            x in -1.0_f32..1.0, y in -1.0_f32..1.0, z in -1.0_f32..1.0,
            height in 1_u32..40, value in any::<f32>(),
        ) {
            let lights = [light(Vec3::new(x, y, z), LightKind::Cell), light(Vec3::Z, LightKind::Compact)];
            let picture = environment_preview(height, |_| Vec3::splat(value), &lights);
            prop_assert_eq!(picture.rgba.len() as u32, 8 * height * height);
        }
    }

    #[test]
    fn constant_radiance_gives_one_colour() {
        let picture = environment_preview(HEIGHT, |_| Vec3::new(4.0, 4.0, 2.0), &[]);
        let (full, half) = (srgb_from_linear(BRIGHT), srgb_from_linear(BRIGHT / 2.0));
        let expected = [full, full, half].map(|x| (x * 255.0).round() as u8);
        assert!((0..HEIGHT).all(|y| picture.rgb(2 * y, y) == expected));
    }

    #[test]
    fn zenith_is_at_the_top_and_y_left_of_x() {
        let towards = |axis: Vec3| {
            environment_preview(
                HEIGHT,
                move |d| Vec3::splat(d.dot(axis).max(0.0).powi(8)),
                &[],
            )
        };
        let bright = |p: &Picture, x, y| p.rgb(x, y)[0] > 200;
        let (x, y, z) = (towards(Vec3::X), towards(Vec3::Y), towards(Vec3::Z));
        assert!(bright(&x, 128, 64) && !bright(&x, 64, 64));
        assert!(bright(&y, 64, 64) && !bright(&y, 192, 64));
        assert!(bright(&z, 10, 0) && !bright(&z, 10, 127));
    }

    #[test]
    fn marks_are_at_the_lights_and_wrap_at_the_border() {
        let black = |lights: &[DomeLight]| environment_preview(HEIGHT, |_| Vec3::ZERO, lights);
        let amber = [242, 184, 75];
        assert_eq!(
            black(&[light(Vec3::X, LightKind::Compact)]).rgb(128, 64),
            amber
        );
        let seam = black(&[light(-Vec3::X, LightKind::Compact)]);
        assert_eq!((seam.rgb(0, 64), seam.rgb(255, 64)), (amber, amber));
        let ring = black(&[light(Vec3::X, LightKind::Cell)]);
        assert!(ring.rgb(128, 64)[0] < 20, "a ring is empty in the middle");
        assert!(
            (120..136).any(|x| ring.rgb(x, 64)[0] > 200),
            "and white at its rim"
        );
        let dark = DomeLight {
            irradiance: Vec3::ZERO,
            ..light(Vec3::X, LightKind::Compact)
        };
        assert_eq!(black(&[dark]).rgb(128, 64), [0, 0, 0]);
    }
}
