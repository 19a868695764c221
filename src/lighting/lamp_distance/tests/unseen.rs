//! Lamps that the environment camera does not see.

use super::super::unseen::RADII;
use super::*;

const SEEN: (DVec3, f32) = (DVec3::new(-0.2, 0.4, 0.8), 0.5);
const HIDDEN: (DVec3, f32) = (DVec3::new(0.35, -0.3, 0.45), 0.3);

fn table(lamps: &[(DVec3, f32)], texture: f32) -> Table {
    Table {
        lamps: lamps.to_vec(),
        balls: BALLS.to_vec(),
        texture,
    }
}

/// Dark things are everywhere but beside the lamp that is seen, and below it nothing is seen.
fn hiding(direction: Vec3) -> Hiding {
    let seen = (SEEN.0 - OBSERVER).as_vec3();
    match direction.angle_between(seen) > 0.3 {
        true if direction.z < 0.7 => Hiding::NotSeen,
        true => Hiding::DarkThing,
        false => Hiding::Nothing,
    }
}

/// What is done with a search that knows the lamp that is seen, and these balls.
fn with_search<T>(
    table: &Table,
    known: &[(DVec3, f64)],
    then: impl Fn(&mut DistanceSearch<'_>) -> T,
) -> T {
    with_search_of(table, &table.seen(), known, then)
}

/// The same with what a camera sees of the table.
fn with_search_of<T>(
    table: &Table,
    seen: &SeenSurfaces,
    known: &[(DVec3, f64)],
    then: impl Fn(&mut DistanceSearch<'_>) -> T,
) -> T {
    let mut lamps = table.sources();
    lamps.truncate(1);
    let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(known, o, to, farthest);
    let mut search = DistanceSearch::new(seen, &lamps, (&sky(), None), OBSERVER, &blocked);
    search.find_together(&[0]);
    then(&mut search)
}

/// How far a lamp is from the hidden one, metres, and the ratio of their light at the observer.
fn compared(lamp: &UnseenLamp) -> (f64, f32) {
    let at = OBSERVER + lamp.direction.as_dvec3() / f64::from(lamp.distance.inverse);
    let light = HIDDEN.1 / HIDDEN.0.distance_squared(OBSERVER) as f32;
    (at.distance(HIDDEN.0), lamp.irradiance.x / light)
}

#[test]
fn lamp_that_is_not_seen_is_found_by_its_shadows() {
    for texture in [0.0, 0.1] {
        let table = table(&[SEEN, HIDDEN], texture);
        let found = with_search(&table, &BALLS, |search| search.find_unseen(&hiding, (0, 1)));
        let found = found.expect("its shadows are seen");
        let (error, light) = compared(&found);
        assert!(error < 0.06, "{texture}: {error} {found:?}");
        assert!((light - 1.0).abs() < 0.1, "{texture}: {light}");
        assert!(found.distance.sigma > 0.0, "{found:?}");
    }
}

#[test]
fn sharp_shadows_of_a_low_sun_tell_its_direction_and_that_it_is_small() {
    let sun = DVec3::new(0.6, -0.5, 0.35).normalize() * 1000.0;
    let table = table(&[SEEN, (sun, 0.6e6)], 0.05);
    let search = |search: &mut DistanceSearch<'_>| search.find_unseen(&hiding, (0, 1));
    let found = with_search_of(&table, &table.seen_in_pixels(), &BALLS, search);
    let found = found.expect("its shadows are seen");
    let off = found.direction.angle_between(sun.as_vec3()).to_degrees();
    assert!(off < 0.35, "{off}° {found:?}");
    assert_eq!(found.angular_radius, RADII[0], "{found:?}");
}

#[test]
fn no_lamp_is_made_up() {
    let stranger = (DVec3::new(0.25, -0.15, 0.05), 0.05);
    for texture in [0.0, 0.15] {
        let mut alone = table(&[SEEN], texture);
        let find = |table: &Table, known: &[(DVec3, f64)]| {
            with_search(table, known, |search| search.find_unseen(&hiding, (0, 1)))
        };
        assert_eq!(find(&alone, &BALLS), None);
        // Something unknown throws a shadow; something known is elsewhere.
        alone.balls.push(stranger);
        assert_eq!(find(&alone, &BALLS), None);
        // What is known to stand there is gone: its shadows are missing.
        let mut gone = BALLS.to_vec();
        gone.push((DVec3::new(0.0, 0.1, 0.07), 0.06));
        assert_eq!(find(&table(&[SEEN], texture), &gone), None);
        let displaced = BALLS.map(|(centre, radius)| (centre + 0.005 * DVec3::X, radius));
        assert_eq!(find(&table(&[SEEN], texture), &displaced), None);
    }
}

#[test]
fn lamp_is_sought_only_where_something_may_hide_it() {
    let table = table(&[SEEN, HIDDEN], 0.05);
    let hidden = (HIDDEN.0 - OBSERVER).as_vec3();
    let elsewhere = |direction: Vec3| match direction.angle_between(hidden) > 0.7 {
        true => Hiding::DarkThing,
        false => Hiding::Nothing,
    };
    let found = with_search(&table, &BALLS, |search| {
        search.find_unseen(&elsewhere, (0, 1))
    });
    assert!(found.is_none_or(|lamp| elsewhere(lamp.direction) != Hiding::Nothing));
    let nowhere = with_search(&table, &BALLS, |search| {
        search.find_unseen(&|_| Hiding::Nothing, (0, 1))
    });
    assert_eq!(nowhere, None);
}

#[test]
fn parts_of_the_search_find_what_all_of_it_does() {
    let table = table(&[SEEN, HIDDEN], 0.05);
    let parts = (0..8).filter_map(|part| {
        with_search(&table, &BALLS, |search| {
            search.find_unseen(&hiding, (part, 8))
        })
    });
    let errors: Vec<f64> = parts.map(|lamp| compared(&lamp).0).collect();
    let least = errors.iter().copied().fold(f64::MAX, f64::min);
    assert!(least < 0.06, "{errors:?}");
}

/// The hidden lamp as it was seen.
fn seen_before() -> UnseenLamp {
    UnseenLamp {
        direction: (HIDDEN.0 - OBSERVER).normalize().as_vec3(),
        distance: LampDistance {
            inverse: HIDDEN.0.distance(OBSERVER).recip() as f32,
            sigma: 0.1,
        },
        angular_radius: 0.015,
        irradiance: Vec3::splat(HIDDEN.1 / HIDDEN.0.distance_squared(OBSERVER) as f32),
    }
}

#[test]
fn lamp_that_was_seen_is_kept_while_its_shadows_are_there() {
    let keep = |table: &Table| {
        with_search(table, &BALLS, |search| {
            let kept = search.keep_unseen(&seen_before(), &hiding);
            (kept, search.lamps.len())
        })
    };
    let (kept, lamps) = keep(&table(&[SEEN, HIDDEN], 0.05));
    let (error, light) = compared(&kept.expect("hidden"));
    assert!(error < 0.05 && (light - 1.0).abs() < 0.1, "{error} {light}");
    assert_eq!(lamps, 2);
    // Off, or elsewhere.
    let elsewhere = (DVec3::new(-0.4, -0.4, 0.45), HIDDEN.1);
    for gone in [&[SEEN][..], &[SEEN, elsewhere]] {
        assert_eq!(keep(&table(gone, 0.05)), (None, 1));
    }
}

#[test]
fn lamp_is_followed_until_it_is_gone() {
    let known = seen_before();
    let mut displaced = known;
    displaced.direction = (known.direction + Vec3::new(0.0, 0.0, 0.1)).normalize();
    displaced.irradiance *= 1.3;
    let follow = |table: &Table, lamp: &UnseenLamp| {
        with_search(table, &BALLS, |search| {
            let number = search.adopt_known(lamp);
            search.follow_unseen(number, (lamp, true), &hiding)
        })
    };
    let there = table(&[SEEN, HIDDEN], 0.05);
    let (error, light) = compared(&follow(&there, &displaced).expect("still there"));
    let (before, _) = compared(&displaced);
    assert!(error < 0.6 * before, "{error} of {before}");
    assert!((light - 1.0).abs() < 0.1, "{light}");
    assert_eq!(follow(&table(&[SEEN], 0.05), &known), None);
}
