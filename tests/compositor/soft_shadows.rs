//! Soft shadows of extended lights, against the twin with many rays per light.

use crate::comparison::{away_from_edges, keep, square_differences};
use crate::stage::{Stage, lighting, matt, painted, part, sun};
use glam::{DVec3, Vec3};
use penumbra_compositor::reference::{ReferencePicture, Seen};
use penumbra_lighting::{DomeLight, LightPlace};
use penumbra_picture::Picture;
use penumbra_scene::primitives;

/// A light whose disc has the angular radius `radius`, radians.
fn lamp(direction: Vec3, irradiance: f32, radius: f32) -> DomeLight {
    DomeLight {
        angular_radius: radius,
        ..sun(direction, Vec3::splat(irradiance))
    }
}

fn stage() -> Stage {
    let mut stage = Stage::new(128, 96).lit(lighting(
        vec![
            lamp(Vec3::new(-0.6, 0.3, 1.0), 1.5, 0.12),
            lamp(Vec3::new(0.3, -0.8, 0.9), 1.0, 0.04),
            lamp(Vec3::new(0.1, 0.1, 1.0), 1.0, 0.3),
        ],
        0.0,
    ));
    stage.settings.soft_samples = 16;
    stage
}

/// Compares pictures with shadow maps and with the surface cache. `largest`, for each of the two, and
/// `mean` are tolerances, codes.
fn assert_close(name: &str, stage: &Stage, on_virtual: bool, largest: [f64; 2], mean: f64) {
    let twin = stage.soft_twin(64);
    let mut stage = stage.clone();
    let kinds = [
        (false, name.to_owned(), largest[0]),
        (true, format!("{name}-cached"), largest[1]),
    ];
    for (cached, name, largest) in kinds {
        stage.settings.cached = cached;
        let ours = stage.compose();
        assert_picture(&name, &ours, twin.clone(), on_virtual, largest, mean);
    }
}

fn assert_picture(
    name: &str,
    ours: &Picture,
    mut twin: ReferencePicture,
    on_virtual: bool,
    largest: f64,
    mean: f64,
) {
    if !on_virtual {
        replace_virtual(ours, &mut twin);
    }
    let calm = away_from_edges(&twin, 2);
    let worst = (0..calm.len())
        .filter(|i| calm[*i])
        .map(|i| {
            let off = |c: usize| ours.rgba[4 * i + c].abs_diff(twin.picture.rgba[4 * i + c]);
            (off(0).max(off(1)).max(off(2)), i)
        })
        .max()
        .unwrap();
    let squares = square_differences(ours, &twin.picture);
    let average = squares.iter().map(|s| s.1).sum::<f64>() / squares.len() as f64;
    let far = squares.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    eprintln!(
        "{name}: calm {} far {:.2} mean {average:.3}",
        worst.0, far.1
    );
    if worst.0 > 5 || far.1 > largest || average > mean {
        keep(&format!("{name}-twin"), &twin.picture);
        let kept = keep(&format!("{name}-ours"), ours);
        panic!(
            "{name}: {} codes off at {:?} away from any edge, {:.1} around {:?}, {average:.2} on \
             average\n{kept:?}",
            worst.0,
            (worst.1 as u32 % ours.width, worst.1 as u32 / ours.width),
            far.1,
            far.0
        );
    }
}

/// The twin has no light that the nearby table reflects onto virtual surfaces.
fn replace_virtual(ours: &Picture, twin: &mut ReferencePicture) {
    let near = |i: usize| twin.pixels[i].seen == Seen::Virtual;
    let width = ours.width as usize;
    let flags: Vec<bool> = (0..twin.pixels.len())
        .map(|i| {
            near(i)
                || near(i.saturating_sub(1))
                || near(i.saturating_sub(width))
                || near((i + 1).min(twin.pixels.len() - 1))
                || near((i + width).min(twin.pixels.len() - 1))
        })
        .collect();
    for (i, _) in flags.iter().enumerate().filter(|(_, near)| **near) {
        twin.picture.rgba[4 * i..4 * i + 4].copy_from_slice(&ours.rgba[4 * i..4 * i + 4]);
    }
}

#[test]
fn penumbrae_on_the_table_match_the_twin() {
    let stage = stage()
        .with_virtual(part(primitives::cuboid(Vec3::splat(0.08)), DVec3::ZERO))
        .with_virtual(part(
            primitives::sphere(0.03, 32, 16),
            DVec3::new(0.1, 0.08, 0.12),
        ));
    assert_close("soft-table", &stage, false, [3.5, 3.5], 0.15);
}

#[test]
fn distant_shadows_of_a_wide_light_match_the_twin() {
    let mut stage = stage()
        .with_virtual(part(
            primitives::cuboid(Vec3::new(0.1, 0.3, 0.02)),
            DVec3::new(0.0, 0.05, 0.2),
        ))
        .lit(lighting(
            vec![
                lamp(Vec3::new(-0.3, -0.2, 1.0), 2.0, 0.25),
                lamp(Vec3::Z, 0.3, 0.02),
            ],
            0.0,
        ));
    stage.pose = Some(crate::stage::looking_from(
        DVec3::new(0.05, -0.5, 0.4),
        DVec3::new(0.05, 0.0, 0.0),
    ));
    assert_close("soft-wide", &stage, false, [4.0, 4.8], 0.25);
}

#[test]
fn overlapping_real_and_virtual_penumbrae_are_not_counted_twice() {
    let stage = stage()
        .with_virtual(part(primitives::cuboid(Vec3::splat(0.06)), DVec3::ZERO))
        .with_phantom(part(
            primitives::cuboid(Vec3::new(0.05, 0.05, 0.12)),
            DVec3::new(-0.08, 0.06, 0.0),
        ));
    assert_close("soft-both", &stage, false, [1.5, 1.5], 0.04);
}

#[test]
fn no_surface_lies_in_its_own_soft_shadow() {
    let stage = stage()
        .without_ground()
        .with_virtual(part(
            primitives::cuboid(Vec3::new(0.3, 0.3, 0.02)),
            DVec3::ZERO,
        ))
        .with_virtual(painted(
            primitives::sphere(0.05, 96, 48),
            DVec3::new(0.05, 0.0, 0.09),
            matt(Vec3::new(0.9, 0.5, 0.3)),
        ))
        .with_phantom(part(
            primitives::cuboid(Vec3::splat(0.05)),
            DVec3::new(-0.09, 0.02, 0.02),
        ));
    // The largest difference is light that leaks where the ball is near the plate: a map knows its upper
    // side alone.
    assert_close("soft-own", &stage, true, [8.0, 11.0], 0.8);
}

/// A lamp at a place, stated for a point among the objects.
fn near_lamp(at: Vec3, irradiance: f32, radius: f32) -> DomeLight {
    let reference = Vec3::new(0.02, 0.01, 0.05);
    let to = at - reference;
    DomeLight {
        place: LightPlace {
            reference,
            inverse_distance: to.length().recip(),
        },
        ..lamp(to, irradiance, radius)
    }
}

#[test]
fn shadows_of_near_lamps_match_the_twin() {
    let lamps = || {
        vec![
            near_lamp(Vec3::new(-0.2, 0.15, 0.35), 1.5, 0.06),
            near_lamp(Vec3::new(0.3, -0.2, 0.3), 1.0, 0.02),
            lamp(Vec3::new(0.1, 0.1, 1.0), 0.5, 0.2),
            lamp(Vec3::new(-0.5, -0.3, 1.0), 0.5, 0.2),
        ]
    };
    let stage = stage()
        .with_virtual(part(primitives::cuboid(Vec3::splat(0.06)), DVec3::ZERO))
        .with_virtual(part(
            primitives::sphere(0.03, 64, 32),
            DVec3::new(0.1, 0.08, 0.12),
        ))
        .with_phantom(part(
            primitives::cuboid(Vec3::new(0.05, 0.05, 0.06)),
            DVec3::new(-0.09, 0.05, 0.0),
        ))
        .lit(lighting(lamps(), 0.0));
    assert_close("soft-near", &stage, false, [6.0, 6.0], 0.1);
    let far = lamps().into_iter().map(DomeLight::far).collect();
    let distant = stage.clone().lit(lighting(far, 0.0)).compose();
    let squares = square_differences(&distant, &stage.soft_twin(64).picture);
    let average = squares.iter().map(|s| s.1).sum::<f64>() / squares.len() as f64;
    assert!(average > 1.0, "distance must matter: {average:.2}");
}
