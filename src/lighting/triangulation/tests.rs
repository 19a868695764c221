use super::*;
use penumbra_numerics::Random;

const SIGMA: f64 = 0.01;

/// Sightings of a lamp from points, with noise.
fn seen(
    lamp: impl Fn(usize) -> DVec3,
    points: impl Iterator<Item = DVec3>,
    random: &mut Random,
) -> (Sightings, u32) {
    let (mut sightings, mut breaks) = (Sightings::default(), 0);
    for (k, from) in points.enumerate() {
        let noise = DVec3::new(random.normal(), random.normal(), random.normal()) * SIGMA;
        let direction = ((lamp(k) - from).normalize() + noise).normalize();
        let sighting = Sighting {
            from,
            direction,
            sigma: SIGMA,
        };
        breaks += u32::from(!sightings.add(sighting));
    }
    (sightings, breaks)
}

fn along(count: usize, length: f64) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |k| DVec3::new(length * k as f64 / count as f64, 0.0, 0.05))
}

proptest::proptest! {
    /// A lamp that stands still is found where it is, within the stated error.
    #[test]
    fn lamp_that_stands_still_is_found(
        seed in 0_u64..1_000_000,
        x in -1.0..1.0_f64, y in -1.0..1.0_f64, z in 0.4..1.5_f64, length in 0.15..0.6_f64,
    ) {
        let (lamp, random) = (DVec3::new(x, y, z), &mut Random::new(seed));
        let (sightings, _) = seen(|_| lamp, along(40, length), random);
        let observer = DVec3::new(length, 0.1, 0.05);
        let truth = lamp.distance(observer).recip();
        let found = sightings.distance(observer, (lamp - observer).normalize()).expect("enough");
        let error = (f64::from(found.inverse) - truth).abs();
        proptest::prop_assert!(error < 5.0 * f64::from(found.sigma), "{found:?} for {truth}");
        // Half of the variance does not fall, along half of the path.
        let expected = 4.0 * SIGMA / length * (lamp.length() / z).max(1.0).powi(2);
        proptest::prop_assert!(f64::from(found.sigma) < expected, "{found:?}, {expected} expected");
    }

    /// Nothing that is seen breaks it, and its memory is bounded.
    #[test]
    fn anything_may_be_seen(values in proptest::collection::vec(-1e6..1e6_f64, 0..400)) {
        let mut sightings = Sightings::default();
        for v in values.as_chunks::<7>().0 {
            let direction = DVec3::new(v[3], v[4], v[5]).normalize_or(DVec3::X);
            let from = DVec3::new(v[0], v[1], v[2]);
            let sigma = v[6].abs() * 1e-6;
            sightings.add(Sighting { from, direction, sigma: sigma.max(1e-4) });
            proptest::prop_assert!(sightings.places() <= PLACES);
            if let Some(d) = sightings.distance(from, direction) {
                proptest::prop_assert!(d.inverse.is_finite() && d.sigma.is_finite());
            }
        }
    }
}

#[test]
fn far_lamp_is_far() {
    let random = &mut Random::new(3);
    let lamp = DVec3::new(3e3, 1e3, 5e3);
    let (sightings, _) = seen(|_| lamp, along(40, 0.5), random);
    let found = sightings
        .distance(DVec3::ZERO, lamp.normalize())
        .expect("enough");
    assert!(found.inverse < 3.0 * found.sigma, "{found:?}");
    assert!(found.sigma < 0.05, "{found:?}");
}

#[test]
fn lamp_that_moves_is_forgotten() {
    let random = &mut Random::new(4);
    // It is carried along with the ball, and stands still in the end.
    let lamp = |k: usize| DVec3::new(0.3, 0.02 * k.min(30) as f64, 0.6);
    let (sightings, breaks) = seen(lamp, along(60, 0.6), random);
    assert!(breaks > 0);
    let observer = DVec3::new(0.6, 0.0, 0.05);
    let lamp = lamp(60);
    let found = sightings.distance(observer, (lamp - observer).normalize());
    let found = found.expect("enough");
    let error = (f64::from(found.inverse) - lamp.distance(observer).recip()).abs();
    assert!(error < 4.0 * f64::from(found.sigma), "{found:?}, {error}");
}

#[test]
fn from_one_place_nothing_is_known() {
    let random = &mut Random::new(5);
    let lamp = DVec3::new(0.3, 0.2, 0.6);
    let (sightings, breaks) = seen(|_| lamp, along(40, 0.0), random);
    assert_eq!(
        (sightings.distance(DVec3::ZERO, lamp.normalize()), breaks),
        (None, 0)
    );
}

#[test]
fn better_estimate_weighs_more() {
    let of = |inverse, sigma| LampDistance { inverse, sigma };
    let both = fused(of(1.0, 0.1), of(2.0, 0.2));
    assert!((both.inverse - 1.2).abs() < 1e-5 && (both.sigma - 0.08944).abs() < 1e-4);
    assert_eq!(
        fused(of(1.0, 0.1), LampDistance::FAR).inverse,
        of(1.0, 0.1).inverse
    );
}
