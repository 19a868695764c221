use super::*;
use crate::geodesic::{FaceLight, FaceSource, Membership};
use crate::light::{CompactSourceSpecular, CubeMap, DomeLight, LightKind, MAX_LEVELS};
use crate::place::LightPlace;
use penumbra_interface::MonotonicTime;
use proptest::prelude::*;

fn direction(azimuth: f32, height: f32) -> Vec3 {
    let r = (1.0 - height * height).sqrt();
    Vec3::new(r * azimuth.cos(), r * azimuth.sin(), height)
}

fn light(direction: Vec3, irradiance: f32, kind: LightKind) -> DomeLight {
    DomeLight {
        direction,
        irradiance: Vec3::new(1.0, 0.8, 0.5) * irradiance,
        angular_radius: 0.05,
        kind,
        place: LightPlace::FAR,
    }
}

fn lighting(lights: Vec<DomeLight>) -> Lighting {
    Lighting {
        captured_at: MonotonicTime::from_nanos(1_000),
        generation: 1,
        radiance: Arc::new(CubeMap::default()),
        irradiance: Harmonics::default(),
        lights,
        ground_radiance: Vec3::ZERO,
        faces: None,
    }
}

fn blended(from: &[DomeLight], to: &[DomeLight], weight: f32) -> Vec<DomeLight> {
    let mut out = Vec::new();
    lights::blend_lights(from, to, Shares::moving(weight), &mut out);
    out
}

/// Irradiance of the ground, by lights of a kind.
fn on_ground(lights: &[DomeLight], kind: LightKind) -> Vec3 {
    let each = lights.iter().filter(|l| l.kind == kind);
    each.map(|l| l.irradiance * l.direction.z).sum()
}

fn any_light() -> impl Strategy<Value = DomeLight> {
    let kind = prop_oneof![3 => Just(LightKind::Cell), 1 => Just(LightKind::Compact)];
    let colour = [0.0_f32..2.0, 0.0_f32..2.0, 0.0_f32..2.0].prop_map(Vec3::from);
    let lit = prop_oneof![1 => Just(0.0_f32), 5 => Just(1.0)];
    (
        0.0_f32..std::f32::consts::TAU,
        0.04_f32..0.99,
        colour,
        lit,
        0.01_f32..0.3,
        kind,
    )
        .prop_map(
            |(azimuth, height, colour, lit, angular_radius, kind)| DomeLight {
                direction: direction(azimuth, height),
                irradiance: colour * lit,
                angular_radius,
                kind,
                place: LightPlace::FAR,
            },
        )
}

proptest! {
    /// Whatever is in the slots, both kinds together light the ground by the linear blend, as
    /// long as cells remain that can take over the energy of a lost one.
    #[test]
    fn ground_irradiance_is_the_linear_blend(
        pairs in prop::collection::vec((any_light(), any_light()), 12..24),
        weight in 0.0_f32..1.0,
    ) {
        let (mut from, mut to): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
        // A cell that stays.
        for lights in [&mut from, &mut to] {
            lights.push(DomeLight {
                irradiance: Vec3::splat(0.7),
                ..light(Vec3::Z, 1.0, LightKind::Cell)
            });
        }
        let out = blended(&from, &to, weight);
        for kind in [LightKind::Cell, LightKind::Compact] {
            let expected = on_ground(&from, kind).lerp(on_ground(&to, kind), weight);
            let error = (on_ground(&out, kind) - expected).abs().max_element();
            prop_assert!(error <= 1e-4 * (1.0 + expected.max_element()), "{kind:?}: {error}");
        }
        prop_assert!(out.iter().all(|l| l.direction.is_normalized() && l.irradiance.is_finite()));
        prop_assert!(out.iter().all(|l| l.irradiance.min_element() >= 0.0));
    }
}

#[test]
fn ends_are_reproduced() {
    let from = [light(direction(0.1, 0.5), 1.0, LightKind::Compact)];
    let to = [light(direction(0.3, 0.6), 2.0, LightKind::Compact)];
    for (weight, end) in [(0.0, from[0]), (1.0, to[0])] {
        let out = blended(&from, &to, weight)[0];
        assert!(out.direction.distance(end.direction) < 1e-6);
        assert!((out.irradiance - end.irradiance).abs().max_element() < 1e-5);
    }
}

#[test]
fn moving_source_goes_along_its_path_in_small_steps() {
    let from = [light(direction(0.0, 0.5), 1.0, LightKind::Compact)];
    let to = [light(direction(0.2, 0.5), 1.0, LightKind::Compact)];
    let angle = from[0].direction.angle_between(to[0].direction);
    let mut passed = 0.0;
    for k in 0..=100 {
        let weight = k as f32 / 100.0;
        let at = blended(&from, &to, weight)[0].direction;
        let along = at.angle_between(from[0].direction);
        assert!(
            (along - weight * angle).abs() < 0.05 * 0.05,
            "{along} at {weight}"
        );
        assert!(along >= passed - 1e-4);
        passed = along;
    }
}

#[test]
fn light_that_appears_does_not_move() {
    let dark = light(Vec3::Z, 0.0, LightKind::Cell);
    let lamp = light(direction(1.0, 0.3), 3.0, LightKind::Compact);
    for weight in [0.01, 0.5, 0.99] {
        let out = blended(&[dark], &[lamp], weight)[0];
        assert_eq!(
            (out.direction, out.kind),
            (lamp.direction, LightKind::Compact)
        );
        assert!(
            (out.irradiance - lamp.irradiance * weight)
                .abs()
                .max_element()
                < 1e-6
        );
        let out = blended(&[lamp], &[dark], weight)[0];
        assert_eq!(out.direction, lamp.direction);
    }
}

/// Directions of a blend that are not near one of the two ends.
fn sweeps(out: &[DomeLight], ends: [Vec3; 2]) -> usize {
    let lit = out.iter().filter(|l| l.irradiance != Vec3::ZERO);
    lit.filter(|l| ends.iter().all(|d| d.angle_between(l.direction) > 1e-3))
        .count()
}

#[test]
fn other_source_in_a_slot_fades_in_by_a_dark_slot() {
    let (a, b) = (direction(0.0, 0.4), direction(2.5, 0.4));
    let dark = light(Vec3::Z, 0.0, LightKind::Cell);
    let from = [light(a, 1.0, LightKind::Compact), dark];
    let to = [light(b, 2.0, LightKind::Compact), dark];
    let out = blended(&from, &to, 0.25);
    assert_eq!(sweeps(&out, [a, b]), 0);
    assert_eq!((out[0].direction, out[1].direction), (a, b));
    assert!((out[0].irradiance.x - 0.75).abs() < 1e-6 && (out[1].irradiance.x - 0.5).abs() < 1e-6);
}

#[test]
fn other_source_without_a_dark_slot_switches_at_equal_energy() {
    let (a, b) = (direction(0.0, 0.4), direction(2.5, 0.4));
    let from = [light(a, 1.0, LightKind::Compact)];
    let to = [light(b, 3.0, LightKind::Compact)];
    // (1 − w) · 1 = w · 3 at w = 1/4.
    for (weight, expected) in [(0.0, a), (0.24, a), (0.26, b), (1.0, b)] {
        assert!(blended(&from, &to, weight)[0].direction.distance(expected) < 1e-6);
    }
}

#[test]
fn jump_is_a_switched_lamp_and_not_a_moving_one() {
    let room: Vec<_> = (0..12)
        .map(|k| light(direction(k as f32, 0.5), 0.1, LightKind::Cell))
        .collect();
    let with = |lamp: Vec3, irradiance: f32| {
        let mut lights = room.clone();
        lights.push(light(lamp, irradiance, LightKind::Compact));
        lighting(lights)
    };
    let here = with(direction(0.0, 0.5), 1.0);
    assert!(!has_jumped(&here, &here, 1));
    assert!(!has_jumped(&here, &with(direction(0.1, 0.55), 1.1), 1));
    assert!(has_jumped(&here, &with(direction(0.0, 0.5), 0.0), 1));
    assert!(has_jumped(&with(direction(0.0, 0.5), 0.0), &here, 1));
    // Another lamp of the same flux.
    assert!(has_jumped(&here, &with(direction(3.1, 0.5), 1.0), 1));
    let dark = lighting(Vec::new());
    assert!(!has_jumped(&dark, &dark, 1));
    // Light that fades evenly, seen in every third picture.
    let faded = |pictures: i32| {
        let mut lights = room.clone();
        for light in &mut lights {
            light.irradiance *= 0.85_f32.powi(pictures);
        }
        lighting(lights)
    };
    assert!(!has_jumped(&faded(0), &faded(1), 1) && !has_jumped(&faded(0), &faded(3), 3));
    assert!(has_jumped(&faded(0), &faded(3), 1));
}

fn map(value: f32, towards: Vec3) -> CubeMap {
    CubeMap {
        size: 2,
        levels: vec![vec![[value; 3]; 24], vec![[2.0 * value; 3]; 6]],
        compact_sources: vec![CompactSourceSpecular {
            direction: towards,
            flux: Vec3::splat(value),
            radius: 0.05,
            weights: [value / 4.0; MAX_LEVELS],
            place: LightPlace::FAR,
        }],
        ..CubeMap::default()
    }
}

#[test]
fn change_of_radiance_alone_keeps_the_direction() {
    let at = |d: Vec3, irradiance| DomeLight {
        direction: d,
        irradiance: Vec3::splat(irradiance),
        angular_radius: 0.05,
        kind: LightKind::Compact,
        place: LightPlace::FAR,
    };
    for k in 0..100 {
        let d = Vec3::new(0.3, 0.01 * k as f32, 0.7).normalize();
        let [light] = blended(&[at(d, 1.0)], &[at(d, 1.3)], 0.01 * k as f32)[..] else {
            panic!("one light");
        };
        assert_eq!(light.direction, d);
    }
}

#[test]
fn maps_and_what_they_leave_out_are_blended_linearly() {
    let (from, to) = (map(1.0, Vec3::X), map(3.0, direction(0.2, 0.0)));
    let mut out = CubeMap::default();
    map::blend_map(&from, &to, Shares::moving(0.25), &mut out);
    assert_eq!(out.levels, vec![vec![[1.5; 3]; 24], vec![[3.0; 3]; 6]]);
    let [source] = out.compact_sources[..] else {
        panic!("one source");
    };
    let left_out = |s: &CompactSourceSpecular| s.flux.x * s.weights[1];
    let expected =
        0.75 * left_out(&from.compact_sources[0]) + 0.25 * left_out(&to.compact_sources[0]);
    assert!((left_out(&source) - expected).abs() < 1e-6);
    // Three quarters of the energy of one, one quarter of the threefold energy of the other.
    assert!((source.direction.angle_between(Vec3::X) - 0.1).abs() < 1e-3);
    // Far apart: each fades where it is.
    map::blend_map(&from, &map(3.0, Vec3::Y), Shares::moving(0.25), &mut out);
    let fluxes: Vec<_> = out
        .compact_sources
        .iter()
        .map(|s| (s.direction, s.flux.x))
        .collect();
    assert_eq!(fluxes, [(Vec3::X, 0.75), (Vec3::Y, 0.75)]);
}

#[test]
fn faces_and_their_sources_are_blended_linearly() {
    let face_light = |value: f32, sources: &[(u32, f32)]| FaceLight {
        frequency: 2,
        membership: Arc::new(Membership::default()),
        radiance: Arc::new(vec![[value; 3]; 5]),
        sources: sources
            .iter()
            .map(|(id, irradiance)| FaceSource {
                id: *id,
                irradiance_in_faces: vec![(*id, Vec3::splat(*irradiance)), (9, Vec3::ONE)],
                ..FaceSource::default()
            })
            .collect(),
    };
    let from = Arc::new(face_light(1.0, &[(1, 4.0), (2, 8.0)]));
    let to = Arc::new(face_light(2.0, &[(2, 4.0), (3, 4.0)]));
    let mut out = None;
    for _ in 0..2 {
        map::blend_faces(Some(&from), Some(&to), Shares::moving(0.25), &mut out);
    }
    let out = out.unwrap();
    assert_eq!(*out.radiance, vec![[1.25; 3]; 5]);
    let own = |s: &FaceSource| {
        (
            s.id,
            s.irradiance_in_faces[0].1.x,
            s.irradiance_in_faces[1].1.x,
        )
    };
    let sources: Vec<_> = out.sources.iter().map(own).collect();
    assert_eq!(sources, [(1, 3.0, 0.75), (2, 7.0, 1.0), (3, 1.0, 0.25)]);
}

#[test]
fn blender_returns_ends_recycles_and_numbers_blends_apart() {
    let lights = |z: f32| vec![light(direction(0.0, z), 1.0, LightKind::Cell)];
    let from = Arc::new(lighting(lights(0.5)));
    let to = Arc::new(Lighting {
        captured_at: MonotonicTime::from_nanos(2_000),
        generation: 2,
        ..lighting(lights(0.6))
    });
    let mut blender = Blender::default();
    assert!(Arc::ptr_eq(&blender.blend(&from, &to, 0.0), &from));
    assert!(Arc::ptr_eq(&blender.blend(&from, &to, 1.0), &to));
    let blend = blender.blend(&from, &to, 0.5);
    assert_eq!(blend.captured_at, MonotonicTime::from_nanos(1_500));
    assert!(blend.generation > 1 << 62);
    let (address, number) = (Arc::as_ptr(&blend), blend.generation);
    // In use: another buffer is taken.
    assert_ne!(Arc::as_ptr(&blender.blend(&from, &to, 0.6)), address);
    drop(blend);
    let addresses: Vec<_> = (0..2).map(|_| blender.blend(&from, &to, 0.7)).collect();
    assert!(addresses.iter().any(|b| Arc::as_ptr(b) == address));
    assert!(addresses.iter().all(|b| b.generation > number));
    // Another number of lights: no blend.
    let other = Arc::new(lighting(Vec::new()));
    assert!(Arc::ptr_eq(&blender.blend(&from, &other, 0.5), &other));
}
