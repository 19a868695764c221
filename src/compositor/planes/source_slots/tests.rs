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

fn rotated(direction: Vec3, degrees: f32) -> Vec3 {
    Quat::from_rotation_z(degrees.to_radians()) * direction
}

/// Runs one frame and returns its first request; with `baked`, all requested images are finished at
/// once.
fn frame(slots: &mut SourceSlots, sources: &[FaceSource], baked: bool) -> Option<BakeRequest> {
    let first = slots.follow(sources);
    let request = slots.request();
    while let Some(request) = slots.request().filter(|_| baked) {
        slots.finish(&request);
    }
    slots.fade(first);
    request
}

fn shares(slots: &SourceSlots) -> Vec<f32> {
    slots.in_use().map(|(_, share, _)| share).collect()
}

const SUN: Vec3 = Vec3::new(0.6, 0.0, 0.8);
const LAMP: Vec3 = Vec3::new(-0.6, 0.5, 0.5);

#[test]
fn sources_of_the_first_frame_are_lit_at_once_and_later_sources_fade_in_and_out() {
    let mut slots = SourceSlots::default();
    let (sun, lamp) = (source(3, SUN, 2.0), source(5, LAMP, 1.0));
    frame(&mut slots, std::slice::from_ref(&sun), true);
    assert_eq!(shares(&slots), [1.0, 0.0]);
    let both = [sun.clone(), lamp];
    let mut before = 0.0;
    for _ in 0..FADE_FRAMES {
        frame(&mut slots, &both, true);
        let share = shares(&slots)[1];
        assert!(share > before && shares(&slots)[0] == 1.0);
        before = share;
    }
    assert_eq!(before, 1.0);
    for _ in 0..FADE_FRAMES {
        frame(&mut slots, &both[1..], true);
        let share = shares(&slots)[0];
        assert!(share < before && shares(&slots)[1] == 1.0);
        // A source that fades out still takes its last irradiance from its faces.
        assert_eq!(slots.in_use().next().unwrap().2, sun.irradiance_in_faces);
        before = share;
    }
    assert_eq!(before, 0.0);
}

#[test]
fn sources_are_lit_by_faces_until_images_are_finished() {
    let mut slots = SourceSlots::default();
    frame(&mut slots, &[], false);
    let sun = [source(3, SUN, 2.0)];
    for _ in 0..20 {
        assert!(frame(&mut slots, &sun, false).is_some());
        assert_eq!(shares(&slots), [0.0, 0.0]);
    }
    frame(&mut slots, &sun, true);
    assert!(shares(&slots)[0] > 0.0);
}

#[test]
fn images_follow_small_movements_in_alternating_sets() {
    let mut slots = SourceSlots::default();
    frame(&mut slots, &[source(3, SUN, 2.0)], true);
    let mut set = slots.in_use().next().unwrap().0;
    assert_eq!(
        frame(&mut slots, &[source(3, rotated(SUN, 0.2), 2.0)], true),
        None
    );
    for step in 1..=4 {
        let at = rotated(SUN, 0.5 * step as f32);
        let request = frame(&mut slots, &[source(3, at, 2.0)], true).unwrap();
        assert_eq!(request.set, 1 - set);
        assert!((request.mean() - at).length() < 1e-5);
        set = slots.in_use().next().unwrap().0;
        assert_eq!(set, request.set);
        assert_eq!(shares(&slots), [1.0, 0.0]);
    }
}

#[test]
fn last_images_are_used_while_a_source_moves_and_faces_after_a_jump() {
    let mut slots = SourceSlots::default();
    frame(&mut slots, &[source(3, SUN, 2.0)], true);
    for step in 0..10 {
        frame(
            &mut slots,
            &[source(3, rotated(SUN, step as f32), 2.0)],
            false,
        );
        assert_eq!(shares(&slots)[0], 1.0);
    }
    frame(&mut slots, &[source(3, rotated(SUN, 40.0), 2.0)], false);
    assert!(shares(&slots)[0] < 1.0);
    for _ in 0..FADE_FRAMES {
        frame(&mut slots, &[source(3, rotated(SUN, 40.0), 2.0)], false);
    }
    assert_eq!(shares(&slots)[0], 0.0);
}

#[test]
fn source_found_again_at_its_old_direction_needs_no_new_images() {
    let mut slots = SourceSlots::default();
    frame(&mut slots, &[source(3, SUN, 2.0)], true);
    frame(&mut slots, &[], true);
    assert!(shares(&slots)[0] < 1.0);
    assert_eq!(
        frame(&mut slots, &[source(4, rotated(SUN, 0.1), 2.0)], true),
        None
    );
    assert_eq!(shares(&slots), [1.0, 0.0]);
}

#[test]
fn only_a_much_stronger_source_replaces_another() {
    let mut slots = SourceSlots::default();
    let (a, b) = (source(1, SUN, 2.0), source(2, LAMP, 1.0));
    frame(&mut slots, &[a.clone(), b.clone()], true);
    assert_eq!(shares(&slots), [1.0, 1.0]);
    let third = |strength| source(9, Vec3::new(0.0, -0.6, 0.4), strength);
    for _ in 0..3 {
        frame(&mut slots, &[a.clone(), third(1.2), b.clone()], true);
        assert_eq!(shares(&slots), [1.0, 1.0]);
    }
    for _ in 0..3 * FADE_FRAMES {
        frame(&mut slots, &[a.clone(), third(1.8), b.clone()], true);
    }
    assert_eq!(shares(&slots), [1.0, 1.0]);
    assert_eq!(slots.slots[1].source.as_ref().unwrap().id, 9);
}

#[test]
fn wide_sources_have_many_directions_and_narrow_ones_few() {
    let directions_of = |radius: f32, lights: usize| {
        let mut lights: Vec<_> = disc(SUN, radius, lights).collect();
        // Consecutive lights lie side by side.
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
    assert_eq!(directions_of(0.005, 1).len(), 1);
    assert_eq!(directions_of(0.1, 1).len(), MAX_DIRECTIONS);
    for (radius, lights) in [(0.015, 1), (0.2, 1), (0.2, 7), (0.3, 16), (0.3, 60)] {
        let all = directions_of(radius, lights);
        assert!(all.len() <= MAX_DIRECTIONS, "{}", all.len());
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
fn source_without_energy_or_direction_is_never_lit() {
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
        frame(&mut slots, std::slice::from_ref(&nowhere), true);
    }
    assert!(shares(&slots)[0] == 0.0);
}
