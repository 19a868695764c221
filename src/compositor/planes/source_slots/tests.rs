#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use super::*;

fn source(id: u32, direction: Vec3, strength: f32) -> FaceSource {
    let direction = direction.normalize();
    FaceSource {
        id,
        direction,
        angular_radius: 0.005,
        spread: vec![(direction, 1.0)],
        irradiance_in_faces: vec![(id % 40, Vec3::splat(strength / 3.0))],
    }
}

fn turned(direction: Vec3, degrees: f32) -> Vec3 {
    Quat::from_rotation_z(degrees.to_radians()) * direction
}

/// One picture; images that are wanted are there at once where `drawn`.
fn picture(slots: &mut SourceSlots, sources: &[FaceSource], drawn: bool) -> Option<Wanted> {
    let first = slots.follow(sources);
    let wanted = slots.wanted();
    while let Some(wanted) = slots.wanted().filter(|_| drawn) {
        slots.made(&wanted);
    }
    slots.fade(first);
    wanted
}

fn shares(slots: &SourceSlots) -> Vec<f32> {
    slots.shown().map(|(_, share, _)| share).collect()
}

const SUN: Vec3 = Vec3::new(0.6, 0.0, 0.8);
const LAMP: Vec3 = Vec3::new(-0.6, 0.5, 0.5);

#[test]
fn the_first_picture_is_whole_and_later_sources_fade_in_and_out() {
    let mut slots = SourceSlots::default();
    let (sun, lamp) = (source(3, SUN, 2.0), source(5, LAMP, 1.0));
    picture(&mut slots, std::slice::from_ref(&sun), true);
    assert_eq!(shares(&slots), [1.0, 0.0]);
    let both = [sun.clone(), lamp];
    let mut before = 0.0;
    for _ in 0..FADE {
        picture(&mut slots, &both, true);
        let share = shares(&slots)[1];
        assert!(share > before && shares(&slots)[0] == 1.0);
        before = share;
    }
    assert_eq!(before, 1.0);
    for _ in 0..FADE {
        picture(&mut slots, &both[1..], true);
        let share = shares(&slots)[0];
        assert!(share < before && shares(&slots)[1] == 1.0);
        // What it had goes on being taken: the face gives what it still has.
        assert_eq!(slots.shown().next().unwrap().2, sun.irradiance_in_faces);
        before = share;
    }
    assert_eq!(before, 0.0);
}

#[test]
fn faces_serve_until_there_are_images() {
    let mut slots = SourceSlots::default();
    picture(&mut slots, &[], false);
    let sun = [source(3, SUN, 2.0)];
    for _ in 0..20 {
        assert!(picture(&mut slots, &sun, false).is_some());
        assert_eq!(shares(&slots), [0.0, 0.0]);
    }
    picture(&mut slots, &sun, true);
    assert!(shares(&slots)[0] > 0.0);
}

#[test]
fn images_follow_in_small_steps_and_into_the_other_set() {
    let mut slots = SourceSlots::default();
    picture(&mut slots, &[source(3, SUN, 2.0)], true);
    let mut set = slots.shown().next().unwrap().0;
    assert_eq!(
        picture(&mut slots, &[source(3, turned(SUN, 0.2), 2.0)], true),
        None
    );
    for step in 1..=4 {
        let at = turned(SUN, 0.5 * step as f32);
        let wanted = picture(&mut slots, &[source(3, at, 2.0)], true).unwrap();
        assert_eq!(wanted.set, 1 - set);
        assert!((wanted.mean() - at).length() < 1e-5);
        set = slots.shown().next().unwrap().0;
        assert_eq!(set, wanted.set);
        assert_eq!(shares(&slots), [1.0, 0.0]);
    }
}

#[test]
fn the_last_images_serve_while_a_source_moves_and_faces_after_a_jump() {
    let mut slots = SourceSlots::default();
    picture(&mut slots, &[source(3, SUN, 2.0)], true);
    for step in 0..10 {
        picture(
            &mut slots,
            &[source(3, turned(SUN, step as f32), 2.0)],
            false,
        );
        assert_eq!(shares(&slots)[0], 1.0);
    }
    picture(&mut slots, &[source(3, turned(SUN, 40.0), 2.0)], false);
    assert!(shares(&slots)[0] < 1.0);
    for _ in 0..FADE {
        picture(&mut slots, &[source(3, turned(SUN, 40.0), 2.0)], false);
    }
    assert_eq!(shares(&slots)[0], 0.0);
}

#[test]
fn one_that_is_found_again_where_it_was_needs_no_new_images() {
    let mut slots = SourceSlots::default();
    picture(&mut slots, &[source(3, SUN, 2.0)], true);
    picture(&mut slots, &[], true);
    assert!(shares(&slots)[0] < 1.0);
    assert_eq!(
        picture(&mut slots, &[source(4, turned(SUN, 0.1), 2.0)], true),
        None
    );
    assert_eq!(shares(&slots), [1.0, 0.0]);
}

#[test]
fn only_a_much_stronger_source_takes_the_place_of_another() {
    let mut slots = SourceSlots::default();
    let (a, b) = (source(1, SUN, 2.0), source(2, LAMP, 1.0));
    picture(&mut slots, &[a.clone(), b.clone()], true);
    assert_eq!(shares(&slots), [1.0, 1.0]);
    let third = |strength| source(9, Vec3::new(0.0, -0.6, 0.4), strength);
    for _ in 0..3 {
        picture(&mut slots, &[a.clone(), third(1.2), b.clone()], true);
        assert_eq!(shares(&slots), [1.0, 1.0]);
    }
    for _ in 0..3 * FADE {
        picture(&mut slots, &[a.clone(), third(1.8), b.clone()], true);
    }
    assert_eq!(shares(&slots), [1.0, 1.0]);
    assert_eq!(slots.slots[1].source.as_ref().unwrap().id, 9);
}

#[test]
fn wide_sources_have_many_directions_and_narrow_ones_few() {
    let of = |radius: f32, lights: usize| {
        let mut lights: Vec<_> = disc(SUN, radius, lights).collect();
        // Those that follow one another lie side by side.
        let (right, up) = SUN.any_orthonormal_pair();
        lights.sort_by_key(|d| (8.0 * d.dot(up).atan2(d.dot(right))) as i32);
        let share = 1.0 / lights.len() as f32;
        let spread = lights.iter().map(|d| (*d, share)).collect();
        let source = FaceSource {
            angular_radius: radius,
            spread,
            ..source(1, SUN, 1.0)
        };
        directions(&source)
    };
    assert_eq!(of(0.005, 1).len(), 1);
    assert_eq!(of(0.1, 1).len(), MOST_DIRECTIONS);
    for (radius, lights) in [(0.015, 1), (0.2, 1), (0.2, 7), (0.3, 16), (0.3, 60)] {
        let all = of(radius, lights);
        assert!(all.len() <= MOST_DIRECTIONS, "{}", all.len());
        let total: f32 = all.iter().map(|(_, share)| share).sum();
        assert!((total - 1.0).abs() < 1e-5);
        let farthest = all.iter().map(|(d, _)| d.angle_between(SUN));
        let farthest = farthest.fold(0.0, f32::max);
        assert!(
            farthest > 0.5 * radius && farthest < 1.3 * radius,
            "{radius} {lights} {farthest}"
        );
        let mean: Vec3 = all.iter().map(|(d, share)| *d * *share).sum();
        assert!(
            mean.normalize().angle_between(SUN) < 0.1 * radius,
            "{radius} {lights}"
        );
    }
}

#[test]
fn a_source_without_energy_or_direction_is_harmless() {
    let dark = FaceSource {
        spread: vec![(SUN, 0.0)],
        ..source(1, SUN, 0.0)
    };
    assert_eq!(directions(&dark), [(dark.direction, 1.0)]);
    let mut slots = SourceSlots::default();
    let nowhere = FaceSource {
        direction: Vec3::NAN,
        ..source(2, SUN, 1.0)
    };
    for _ in 0..2 {
        picture(&mut slots, std::slice::from_ref(&nowhere), true);
    }
    assert!(shares(&slots)[0] == 0.0);
}
