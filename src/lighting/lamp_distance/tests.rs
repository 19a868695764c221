use super::*;
use glam::DVec2;
use penumbra_numerics::Random;

/// Boxes, each seen from above and from two sides, on a ground, in the light of a lamp overhead
/// and of the sky; the sides of some are `painted` half as bright.
pub fn overhead(boxes: usize, painted: usize) -> (SeenSurfaces, CompactSource) {
    let lamp = CompactSource {
        id: 0,
        viewpoint: Vec3::ZERO,
        direction: Vec3::Z,
        irradiance: Vec3::splat(2.0),
        angular_radius: 0.01,
        distance: LampDistance::FAR,
        position: None,
        clipped: 0.0,
        lights: 1,
        is_unseen: false,
    };
    let mut random = Random::new(5);
    let mut point = |surface: u32, normal: Vec3, albedo: f32| {
        let lit = sky().irradiance(normal).x + 2.0 * normal.z.max(0.0);
        let noise = 0.02 * random.normal() as f32;
        Some(SurfacePoint {
            position: DVec3::ZERO,
            normal,
            log_values: [(lit * albedo).ln() + noise; 4],
            surface,
        })
    };
    let mut points = Vec::new();
    for k in 0..=boxes as u32 {
        let dark = if k > 0 && k as usize <= painted {
            0.5
        } else {
            1.0
        };
        let sides = [
            (Vec3::Z, 0.4),
            (Vec3::X, 0.4 * dark),
            (Vec3::NEG_Y, 0.4 * dark),
        ];
        // Surface 0 is the ground.
        for (normal, albedo) in sides.into_iter().take(if k == 0 { 1 } else { 3 }) {
            points.extend((0..40).map(|_| point(k, normal, albedo)));
            // Nothing beside it.
            points.extend([None; 8]);
        }
    }
    (SeenSurfaces { width: 8, points }, lamp)
}

/// A lamp without extent.
pub fn seen_lamp(source: CompactSource) -> SeenLamp {
    SeenLamp {
        source,
        parts: vec![source.direction],
        is_energy_unknown: false,
    }
}

/// A ground of 90 by 60 points, 1 cm apart, in the light of `lamps` (position, power) and of a
/// uniform sky, with a ball on it that blocks light, and texture.
struct Table {
    lamps: Vec<(DVec3, f32)>,
    balls: Vec<(DVec3, f64)>,
    texture: f32,
}

const WIDTH: usize = 90;
const OBSERVER: DVec3 = DVec3::new(-0.25, 0.1, 0.05);

fn blocked(balls: &[(DVec3, f64)], origin: DVec3, to: DVec3, farthest: f64) -> bool {
    let direction = to.normalize();
    balls.iter().any(|(centre, radius)| {
        let along = (*centre - origin).dot(direction);
        let apart = (*centre - origin - along * direction).length();
        along > 0.0 && along < farthest * to.length() && apart < *radius
    })
}

impl Table {
    fn irradiance(&self, p: DVec3) -> f32 {
        let by = |(lamp, power): &(DVec3, f32)| {
            let to = *lamp - p;
            let open = !blocked(&self.balls, p, to, 1.0);
            power * f32::from(u8::from(open)) * (to.z / to.length().powi(3)) as f32
        };
        0.6 + self.lamps.iter().map(by).sum::<f32>()
    }

    fn seen(&self) -> SeenSurfaces {
        self.seen_by(|p| self.irradiance(p))
    }

    /// As a camera sees it: a point is the mean of five by five pixels, six of which lie between points.
    fn seen_in_pixels(&self) -> SeenSurfaces {
        self.seen_by(|p| {
            let pixels =
                (0..25).map(|k| DVec3::new(f64::from(k % 5 - 2), f64::from(k / 5 - 2), 0.0));
            pixels
                .map(|pixel| self.irradiance(p + pixel * (0.01 / 6.0)))
                .sum::<f32>()
                / 25.0
        })
    }

    fn seen_by(&self, irradiance: impl Fn(DVec3) -> f32) -> SeenSurfaces {
        let mut random = Random::new(7);
        let point = |i: usize| {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            let position = DVec3::new(0.01 * x - 0.45, 0.01 * y - 0.3, 0.0);
            let grain = (40.0 * position.x).sin() as f32 * self.texture;
            let noise = 0.01 * random.normal() as f32;
            let log = irradiance(position).ln() + grain + noise;
            Some(SurfacePoint {
                position,
                normal: Vec3::Z,
                log_values: [log; 4],
                surface: 0,
            })
        };
        SeenSurfaces {
            width: WIDTH,
            points: (0..WIDTH * 60).map(point).collect(),
        }
    }

    fn sources(&self) -> Vec<SeenLamp> {
        let each = self.lamps.iter().zip(0..);
        each.map(|((lamp, power), id)| {
            let to = *lamp - OBSERVER;
            seen_lamp(CompactSource {
                id,
                viewpoint: Vec3::ZERO,
                direction: to.normalize().as_vec3(),
                irradiance: Vec3::splat(*power / to.length_squared() as f32),
                angular_radius: 0.01,
                distance: LampDistance::FAR,
                position: None,
                clipped: 0.0,
                lights: 1,
                is_unseen: false,
            })
        })
        .collect()
    }
}

pub fn sky() -> Harmonics {
    let mut sky = Harmonics::default();
    sky.coefficients[0] = Vec3::splat(0.6);
    sky
}

fn found(table: &Table, known: &[(DVec3, f64)]) -> Vec<LampDistance> {
    let (seen, sources) = (table.seen(), table.sources());
    let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(known, o, to, farthest);
    let mut search = DistanceSearch::new(&seen, &sources, (&sky(), None), OBSERVER, &blocked);
    let all = 0..sources.len();
    let found = search.find_together(&all.collect::<Vec<_>>());
    found.into_iter().map(|(_, distance)| distance).collect()
}

const BALLS: [(DVec3, f64); 2] = [
    (DVec3::new(0.1, 0.05, 0.06), 0.05),
    (DVec3::new(-0.1, -0.1, 0.04), 0.04),
];

#[test]
fn the_distance_of_near_lamps_is_found_and_far_ones_stay_far() {
    for (texture, tolerance) in [(0.0, 0.06), (0.1, 0.08)] {
        let table = Table {
            lamps: vec![
                (DVec3::new(0.3, -0.2, 0.5), 0.3),
                (DVec3::new(-0.2, 0.4, 0.8), 0.5),
                (DVec3::new(-300.0, 100.0, 400.0), 1e5),
            ],
            balls: BALLS.to_vec(),
            texture,
        };
        let found = found(&table, &BALLS);
        for ((lamp, _), found) in table.lamps.iter().zip(&found) {
            let expected = lamp.distance(OBSERVER).recip() as f32;
            let error = (found.inverse - expected).abs();
            assert!(error < tolerance, "{lamp}: {found:?} for {expected}");
        }
    }
}

#[test]
fn wide_lamps_are_found_by_their_soft_shadows() {
    // A softbox 0.3 m wide.
    let centre = DVec3::new(0.25, -0.2, 0.5);
    let bulb = |k: usize| {
        let at = DVec2::from_angle(2.4 * k as f64) * 0.15 * ((k as f64 + 0.5) / 32.0).sqrt();
        (centre + DVec3::new(at.x, at.y, 0.0), 0.3 / 32.0)
    };
    let mut table = Table {
        lamps: (0..32).map(bulb).collect(),
        balls: BALLS.to_vec(),
        texture: 0.1,
    };
    let towards = |(at, _): &(DVec3, f32)| (*at - OBSERVER).normalize().as_vec3();
    let parts = table.lamps.iter().step_by(2).map(towards).collect();
    let seen = table.seen();
    table.lamps = vec![(centre, 0.3)];
    let mut lamps = table.sources();
    lamps[0].source.angular_radius = 0.2;
    lamps[0].parts = parts;
    let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(&BALLS, o, to, farthest);
    let mut search = DistanceSearch::new(&seen, &lamps, (&sky(), None), OBSERVER, &blocked);
    let (_, found) = search.find_together(&[0])[0];
    let expected = centre.distance(OBSERVER).recip() as f32;
    let error = (found.inverse - expected).abs() / expected;
    assert!(error < 0.05, "{found:?} for {expected}");
}

#[test]
fn lamps_that_hide_each_others_distances_are_found_together() {
    // Until the others have a place, the nearest seems to be elsewhere, and to be far.
    let lamps = vec![
        (DVec3::new(-0.45, -0.2, 0.4), 0.3),
        (DVec3::new(0.1, -0.95, 0.75), 0.9),
        (DVec3::new(0.46, 0.0, 0.5), 0.5),
    ];
    let table = Table {
        lamps,
        balls: BALLS.to_vec(),
        texture: 0.05,
    };
    for ((lamp, _), found) in table.lamps.iter().zip(found(&table, &BALLS)) {
        let expected = lamp.distance(OBSERVER).recip() as f32;
        let error = (found.inverse - expected).abs() / expected;
        assert!(error < 0.05, "{lamp}: {found:?} for {expected}");
    }
}

#[test]
fn lamps_in_nearly_the_same_direction_are_not_taken_for_each_other() {
    let towards = |azimuth: f64, elevation: f64| {
        let level = DVec2::from_angle(azimuth) * elevation.cos();
        level.extend(elevation.sin())
    };
    for (k, [first, second]) in (0..8).flat_map(|k| [[0.7, 0.32], [1.2, 0.4]].map(|d| (k, d))) {
        // Ten degrees apart.
        let azimuth = 0.785 * f64::from(k);
        let lamps = vec![
            (
                OBSERVER + first * towards(azimuth, 0.29),
                (1.1 * first * first) as f32,
            ),
            (
                OBSERVER + second * towards(azimuth + 0.14, 0.4),
                (second * second) as f32,
            ),
        ];
        let table = Table {
            lamps,
            balls: BALLS.to_vec(),
            texture: 0.1,
        };
        for ((lamp, _), found) in table.lamps.iter().zip(found(&table, &BALLS)) {
            let expected = lamp.distance(OBSERVER).recip() as f32;
            let error = (found.inverse - expected).abs();
            assert!(error < 0.2, "{lamp}: {found:?} for {expected}");
        }
    }
}

#[test]
fn a_weak_lamp_is_near_where_another_one_is() {
    let weak = DVec3::new(-0.5, -1.4, 0.9);
    let near = (DVec3::new(0.3, -0.2, 0.5), 0.3);
    let beside = |other: (DVec3, f32), weak: (DVec3, f32)| {
        let table = Table {
            lamps: vec![other, weak],
            balls: BALLS.to_vec(),
            texture: 0.1,
        };
        found(&table, &BALLS)[1].inverse
    };
    let expected = weak.distance(OBSERVER).recip() as f32;
    for power in [0.1, 0.15] {
        let inverse = beside(near, (weak, power));
        assert!((inverse - expected).abs() < 0.1, "{inverse}");
        // Beside the sun, the same evidence is not enough.
        let sun = (DVec3::new(300.0, -200.0, 500.0), 4e5);
        assert_eq!(beside(sun, (weak, power)), 0.0);
        // The sun through a window, as weak.
        let inverse = beside(near, (300.0 * weak, 9e4 * power));
        assert!(inverse < 0.1, "{inverse}");
    }
}

#[test]
fn weak_lamps_are_near_if_all_of_them_together_show_it() {
    let places = [
        DVec3::new(0.9, 0.5, 1.5),
        DVec3::new(-0.9, 0.6, 1.6),
        DVec3::new(0.0, -0.9, 1.7),
        DVec3::new(-1.4, -0.6, 1.5),
        DVec3::new(0.1, 1.6, 1.4),
    ];
    let near = |count: usize| {
        // The others are infinitely far, in the same directions.
        let lamp = |(k, place): (usize, &DVec3)| {
            let far = if k < count { 1.0 } else { 300.0 };
            (
                OBSERVER + (*place - OBSERVER) * far,
                0.08 * (far * far) as f32,
            )
        };
        let table = Table {
            lamps: places.iter().enumerate().map(lamp).collect(),
            balls: BALLS.to_vec(),
            texture: 0.15,
        };
        found(&table, &BALLS)
    };
    for (place, found) in places.iter().zip(near(5)) {
        let expected = place.distance(OBSERVER).recip() as f32;
        let error = (found.inverse - expected).abs();
        assert!(error < 0.1, "{place}: {found:?} for {expected}");
    }
    for count in [0, 1] {
        assert!(
            near(count).iter().all(|found| found.inverse == 0.0),
            "{count}"
        );
    }
}

#[test]
fn without_known_shadows_the_fall_off_of_light_tells_and_foreign_shadows_do_not() {
    let lamps = vec![(DVec3::new(0.3, -0.2, 0.5), 0.3)];
    let mut table = Table {
        lamps,
        balls: BALLS.to_vec(),
        texture: 0.1,
    };
    let expected = table.lamps[0].0.distance(OBSERVER).recip() as f32;
    let by_fall_off = found(&table, &[])[0].inverse;
    assert!(
        (by_fall_off - expected).abs() < 0.15,
        "{by_fall_off} for {expected}"
    );
    table.lamps[0] = (DVec3::new(300.0, -200.0, 500.0), 2e5);
    table.balls.push((DVec3::new(0.25, -0.15, 0.05), 0.05));
    assert_eq!(found(&table, &BALLS)[0].inverse, 0.0);
}

#[test]
fn the_depth_of_shadows_tells_how_bright_a_clipped_lamp_is() {
    let table = Table {
        lamps: vec![(DVec3::new(0.3, -0.2, 0.5), 0.3)],
        balls: BALLS.to_vec(),
        texture: 0.1,
    };
    let (seen, mut sources) = (table.seen(), table.sources());
    let lost = Vec3::new(0.5, 0.4, 0.3);
    sources[0].source.irradiance *= lost;
    let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(&BALLS, o, to, farthest);
    let mut search = DistanceSearch::new(&seen, &sources, (&sky(), None), OBSERVER, &blocked);
    search.find_together(&[0]);
    let mut factor = Vec3::ONE;
    for _ in 0..3 {
        factor *= search.find_factor(0, factor, Colour::BestMatch);
    }
    let error = (factor * lost - 1.0).abs().max_element();
    assert!(error < 0.08, "{factor} for {}", lost.recip());
}

#[test]
fn shadows_agree_with_their_light_although_points_lie_on_their_edges() {
    let table = Table {
        lamps: vec![(DVec3::new(300.0, -200.0, 500.0), 6e5)],
        balls: BALLS.to_vec(),
        texture: 0.0,
    };
    let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(&BALLS, o, to, farthest);
    let (seen, lamps) = (table.seen_in_pixels(), table.sources());
    let search = DistanceSearch::new(&seen, &lamps, (&sky(), None), OBSERVER, &blocked);
    let agreement = search.agreement()[0];
    assert!(agreement.difference.abs() < 0.015, "{agreement:?}");
    assert!(agreement.pairs > 30, "{agreement:?}");
}

/// What is found of lamps of which only a share of the light is seen: errors of 1/distance, and of the energy,
/// octaves.
fn found_of_clipped(
    lamps: &[(DVec3, f32)],
    seen_shares: &[f32],
    is_unknown: bool,
) -> Vec<[f32; 2]> {
    let table = Table {
        lamps: lamps.to_vec(),
        balls: BALLS.to_vec(),
        texture: 0.1,
    };
    let (seen, mut sources) = (table.seen(), table.sources());
    for (lamp, share) in sources.iter_mut().zip(seen_shares) {
        lamp.source.irradiance *= *share;
        lamp.is_energy_unknown = is_unknown;
    }
    let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(&BALLS, o, to, farthest);
    let mut search = DistanceSearch::new(&seen, &sources, (&sky(), None), OBSERVER, &blocked);
    let all: Vec<usize> = (0..lamps.len()).collect();
    let found = search.find_together(&all);
    let mut factors = vec![Vec3::ONE; lamps.len()];
    for round in 0..6 {
        if round > 0 && lamps.len() > 1 {
            let common = search.find_common_factor(&all, 0.1);
            factors.iter_mut().for_each(|factor| *factor *= common);
        }
        for (lamp, factor) in factors.iter_mut().enumerate() {
            *factor *= search.find_factor(lamp, *factor, Colour::Kept);
        }
    }
    let errors = |(k, distance): &(usize, LampDistance)| {
        let expected = lamps[*k].0.distance(OBSERVER).recip() as f32;
        let energy = factors[*k].x * seen_shares[*k];
        [distance.inverse - expected, energy.log2()]
    };
    found.iter().map(errors).collect()
}

#[test]
fn lamps_of_which_little_is_seen_are_found_with_their_energy() {
    let one = [(DVec3::new(0.3, -0.2, 0.5), 0.3)];
    let two = [one[0], (DVec3::new(-0.2, 0.4, 0.8), 0.5)];
    let cases = [
        (&one[..], &[0.005][..]),
        (&two, &[0.1, 0.3]),
        (&two, &[0.02, 0.005]),
    ];
    for (lamps, shares) in cases {
        let errors = found_of_clipped(lamps, shares, true);
        let is_right = |[place, energy]: &[f32; 2]| place.abs() < 0.1 && energy.abs() < 0.15;
        assert!(errors.iter().all(is_right), "{shares:?}: {errors:?}");
    }
    // Taken to be as bright as their pixels, they are not found.
    let errors = found_of_clipped(&one, &[0.02], false);
    assert!(errors[0][0].abs() > 1.0, "{errors:?}");
}

mod unseen;

#[test]
fn lamp_that_is_not_seen_stays_in_the_room_while_the_observer_moves() {
    let (lamp, by) = (Vec3::new(0.2, 0.6, 0.9), Vec3::new(0.3, -0.1, 0.05));
    let away = lamp.length();
    let near = UnseenLamp {
        direction: lamp / away,
        distance: LampDistance {
            inverse: away.recip(),
            sigma: 0.1,
        },
        angular_radius: 0.03 / away,
        irradiance: Vec3::splat(0.5 / (away * away)),
    };
    let moved = near.seen_from_elsewhere(by);
    let there = (lamp - by).length();
    let at = by + moved.direction / moved.distance.inverse;
    assert!(at.distance(lamp) < 1e-5, "{at}");
    assert!((moved.angular_radius * there - 0.03).abs() < 1e-5);
    assert!((moved.irradiance.x * there * there - 0.5).abs() < 1e-5);
    let far = UnseenLamp {
        distance: LampDistance::FAR,
        ..near
    };
    assert_eq!(far.seen_from_elsewhere(by), far);
}
