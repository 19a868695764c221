//! The camera's look on virtual objects.

use crate::stage::{Stage, flat, lighting, looking_from, noise, painted, part, spiral, sun};
use glam::{DMat4, DVec3, Vec3, Vec4};
use penumbra_camera::{
    CameraNoise, DepthOfField, ExposureMotion, NoiseTexture, PointSpread, Response,
};
use penumbra_compositor::Look;
use penumbra_compositor::reference::look::looked;
use penumbra_picture::Picture;
use penumbra_scene::{Material, primitives};

const SPREAD: PointSpread = PointSpread {
    across: [0.5, 0.22, 0.03],
    down: [0.44, 0.25, 0.03],
};

fn camera_noise() -> CameraNoise {
    let mut texture = NoiseTexture::WHITE;
    texture.across[0][0] = 0.4;
    texture.across[1][0] = 0.5;
    texture.across[2][0] = 0.5;
    texture.down[0][0] = 0.2;
    CameraNoise {
        read: [2e-5, 1e-5, 3e-5],
        shot: [3e-4, 2e-4, 4e-4],
        texture,
    }
}

fn everything() -> Look {
    Look {
        picture: 3,
        noise: Some(camera_noise()),
        spread: Some(SPREAD),
        depth_of_field: Some(DepthOfField {
            aperture: 0.02,
            focus: 0.3,
        }),
        motion: Some(ExposureMotion {
            seconds: 0.01,
            rotation: DVec3::new(0.01, 0.02, 0.005),
            translation: DVec3::ZERO,
        }),
    }
}

/// A box in the sun on a table.
fn sunny(width: u32, height: u32) -> Stage {
    let mut lights = spiral(6, 0.8);
    lights.push(sun(Vec3::new(-0.5, 0.4, 1.0), Vec3::splat(1.5)));
    Stage::new(width, height)
        .with_virtual(part(
            primitives::cuboid(Vec3::new(0.1, 0.12, 0.08)),
            DVec3::ZERO,
        ))
        .lit(lighting(lights, 0.3))
}

fn emissive(light: f32) -> Material {
    Material {
        base_colour: Vec4::new(0.0, 0.0, 0.0, 1.0),
        emissive: Vec3::splat(light),
        specular: 0.0,
        ..Material::default()
    }
}

/// Share of each pixel that the virtual parts of `stage` cover: black in front of white.
fn coverage(stage: &Stage) -> Vec<f64> {
    let mut black = stage.clone();
    black.picture = flat(stage.picture.width, stage.picture.height, [255; 3]);
    (black.strength, black.look) = (0.0, Look::default());
    for part in &mut black.scene.virtual_parts {
        part.material = emissive(0.0).into();
    }
    let table = Response::srgb();
    let open = |rgba: &[u8]| f64::from(table.linear_from_code()[usize::from(rgba[0])]);
    let shares = black.compose().rgba.chunks(4).map(open).collect::<Vec<_>>();
    // Four samples a pixel.
    shares
        .iter()
        .map(|open| (4.0 * (1.0 - open)).round() / 4.0)
        .collect()
}

#[test]
fn picture_without_virtual_objects_stays_the_cameras() {
    let mut stage = sunny(101, 67);
    stage.picture = noise(101, 67);
    stage.look = everything();
    let mut compositor = stage.compositor();
    assert!(stage.compose_with(&mut compositor) != stage.picture);
    stage.show_virtual = false;
    assert!(stage.compose_with(&mut compositor) == stage.picture);
    stage.show_virtual = true;
    stage.pose = None;
    assert!(stage.compose_with(&mut compositor) == stage.picture);
    stage.scene.virtual_parts.clear();
    stage.pose = sunny(1, 1).pose;
    assert!(stage.compose() == stage.picture);
}

#[test]
fn pixels_far_from_virtual_changes_stay_the_cameras() {
    for distortion in [[0.0; 5], [-0.2, 0.05, 0.001, 0.0, 0.0]] {
        let mut stage = sunny(160, 120);
        stage.camera.distortion = distortion;
        stage.picture = noise(160, 120);
        stage.picture.rgba.chunks_mut(4).for_each(|p| p[3] = 255);
        let plain = stage.compose();
        stage.look = everything();
        let out = stage.compose();
        // The look reaches as far as its blur.
        let reach = 8_i64;
        let changed = |x: i64, y: i64| {
            let inside = (0..160).contains(&x) && (0..120).contains(&y);
            let i = (4 * (y * 160 + x)) as usize;
            inside && plain.rgba[i..i + 4] != stage.picture.rgba[i..i + 4]
        };
        let mut kept = 0;
        for (x, y) in (0..120).flat_map(|y| (0..160).map(move |x| (x, y))) {
            let mut near = (-reach..=reach).flat_map(|v| (-reach..=reach).map(move |u| (u, v)));
            if !near.any(|(u, v)| changed(x + u, y + v)) {
                let i = (4 * (y * 160 + x)) as usize;
                assert_eq!(out.rgba[i..i + 4], stage.picture.rgba[i..i + 4], "{x} {y}");
                kept += 1;
            }
        }
        assert!(kept > 3000, "{kept}");
        assert!(out.rgba.chunks(4).all(|p| p[3] == 255));
    }
}

#[test]
fn gpu_and_twin_are_equal() {
    let all = everything();
    let looks = [
        Look {
            spread: all.spread,
            ..Look::default()
        },
        Look {
            depth_of_field: all.depth_of_field,
            ..Look::default()
        },
        Look {
            motion: all.motion,
            ..Look::default()
        },
        Look {
            noise: all.noise,
            picture: 9,
            ..Look::default()
        },
        all,
    ];
    let mut stage = sunny(160, 120);
    let coverage = coverage(&stage);
    let plain = stage.compose();
    for look in looks {
        stage.look = look;
        let found = stage.compose();
        let twin = looked(
            &plain,
            &coverage,
            &stage.input(),
            (&stage.scene, &stage.response),
        );
        let differences = || {
            found
                .rgba
                .iter()
                .zip(&twin.rgba)
                .map(|(a, b)| a.abs_diff(*b))
        };
        let worst = differences().max().unwrap();
        let different = differences().filter(|d| *d > 1).count();
        assert!(
            worst <= 3 && different < 50,
            "{look:?}: {worst}, {different}"
        );
        let changed = plain.rgba.iter().zip(&found.rgba).filter(|(a, b)| a != b);
        assert!(changed.count() > 500, "{look:?}");
    }
}

/// A wall of even light in front of a camera that looks down from one metre.
fn wall(light: f32, size: u32) -> Stage {
    let mut stage = Stage::new(size, size).without_ground();
    stage.pose = Some(looking_from(DVec3::Z, DVec3::ZERO));
    stage.picture = flat(size, size, [0, 0, 0]);
    stage = stage.lit(lighting(spiral(4, 1.0), 0.0));
    stage.with_virtual(painted(
        primitives::plane(3.0, 3.0),
        DVec3::ZERO,
        emissive(light),
    ))
}

fn linear(picture: &Picture) -> Vec<[f64; 3]> {
    let table = Response::srgb();
    let pixel = |p: &[u8]| table.linear_from_rgb([p[0], p[1], p[2]]).map(f64::from);
    picture.rgba.chunks(4).map(pixel).collect()
}

#[test]
fn grain_has_the_level_and_the_correlation_of_the_model() {
    let size = 192;
    for light in [0.05_f32, 0.4] {
        let mut stage = wall(light, size);
        let mut compositor = stage.compositor();
        let model = camera_noise();
        // As the picture's codes show it.
        let plain = linear(&stage.compose_with(&mut compositor))[0];
        stage.look.noise = Some(model);
        let (mut sum, mut square, mut beside) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        let pictures = 6;
        for picture in 0..pictures {
            stage.look.picture = picture;
            let values = linear(&stage.compose_with(&mut compositor));
            for (i, value) in values.iter().enumerate() {
                let right = values[if (i + 1) % size as usize == 0 {
                    i
                } else {
                    i + 1
                }];
                for c in 0..3 {
                    let off = value[c] - plain[c];
                    sum[c] += off;
                    square[c] += off * off;
                    beside[c] += off * (right[c] - plain[c]);
                }
            }
        }
        let count = f64::from(size * size) * pictures as f64;
        for c in 0..3 {
            let (mean, found) = (sum[c] / count, square[c] / count);
            let wanted = model.read[c] + model.shot[c] * f64::from(light);
            assert!(
                (found / wanted - 1.0).abs() < 0.1,
                "{light} {c}: {found} {wanted}"
            );
            assert!(
                mean.abs() < 0.05 * wanted.sqrt() + 5e-4,
                "{light} {c}: {mean}"
            );
            let correlation = beside[c] / square[c];
            // Between those of luma and of the colour differences.
            assert!((0.35..0.55).contains(&correlation), "{c}: {correlation}");
        }
    }
}

#[test]
fn grain_depends_on_the_number_of_the_picture_alone() {
    let mut stage = wall(0.3, 96);
    stage.look.noise = Some(camera_noise());
    let mut compositor = stage.compositor();
    let first = stage.compose_with(&mut compositor);
    stage.look.picture = 1;
    let second = stage.compose_with(&mut compositor);
    stage.look.picture = 0;
    assert!(first != second);
    assert!(first == stage.compose());
    assert!(first == stage.compose_with(&mut compositor));
}

/// Luminance along the middle row of a picture, relative to `light`.
fn profile(picture: &Picture, light: f32) -> Vec<f64> {
    let width = picture.width as usize;
    let row = (picture.height / 2) as usize * width;
    let values = linear(picture);
    (0..width)
        .map(|x| values[row + x][1] / f64::from(light))
        .collect()
}

/// A wall that ends in the middle of the picture, at a vertical edge.
fn edge(light: f32, size: u32) -> Stage {
    let mut stage = wall(light, size);
    let place = DMat4::from_translation(DVec3::new(-1.5, 0.0, 0.0));
    stage.scene.virtual_parts[0].world_from_part = place;
    stage
}

/// Width over which a profile rises from 10 to 90 %.
fn rise(profile: &[f64]) -> f64 {
    let crossing = |level: f64| {
        let i = profile.iter().rposition(|v| *v > level).unwrap();
        let (a, b) = (profile[i], profile[i + 1]);
        i as f64 + (a - level) / (a - b)
    };
    crossing(0.1) - crossing(0.9)
}

#[test]
fn motion_blur_is_as_long_as_the_motion_during_the_exposure() {
    let size = 192;
    let mut stage = edge(0.5, size);
    // One metre away, with a focal length of `size` pixels.
    let pixels = 20.0;
    stage.look.motion = Some(ExposureMotion {
        seconds: 0.01,
        rotation: DVec3::ZERO,
        translation: DVec3::X * (pixels / f64::from(size)),
    });
    let found = profile(&stage.compose(), 0.5);
    // A box of this length rises from 10 to 90 % over 0.8 of it.
    let width = rise(&found);
    assert!((width - 0.8 * pixels).abs() < 1.0, "{width}");
    let sum: f64 = found.iter().sum();
    let sharp: f64 = profile(&edge(0.5, size).compose(), 0.5).iter().sum();
    assert!((sum - sharp).abs() < 0.3, "{sum} {sharp}");
}

#[test]
fn defocus_has_the_circle_of_confusion_of_the_lens() {
    let size = 192;
    let mut stage = edge(0.5, size);
    let lens = DepthOfField {
        aperture: 0.05,
        focus: 0.4,
    };
    stage.look.depth_of_field = Some(lens);
    let circle = lens.circle(f64::from(size), 1.0);
    // The edge profile of a disc: 10 to 90 % over 0.6881 of its diameter.
    let width = rise(&profile(&stage.compose(), 0.5));
    assert!((width - 0.6881 * circle).abs() < 0.8, "{width} {circle}");
}

#[test]
fn edges_have_the_spread_of_the_camera() {
    let mut stage = edge(0.5, 96);
    stage.look.spread = Some(SPREAD);
    let sharp = profile(&edge(0.5, 96).compose(), 0.5);
    let soft = profile(&stage.compose(), 0.5);
    let [a, b, c] = SPREAD.across;
    for x in 2..94 {
        let wanted =
            a * sharp[x] + b * (sharp[x - 1] + sharp[x + 1]) + c * (sharp[x - 2] + sharp[x + 2]);
        assert!(
            (soft[x] - wanted).abs() < 0.006,
            "{x}: {} {wanted}",
            soft[x]
        );
    }
}
