//! Publishes the observations of the mirrored sphere in the scene camera's picture.

use penumbra_interface::MonotonicTime;
use penumbra_lighting::ProbeMap;
use penumbra_status::ProbeStatus;

/// Returns the status at `now`, the instant of the picture that is shown.
pub(super) fn probe(map: &ProbeMap, now: MonotonicTime) -> ProbeStatus {
    let age = |at: MonotonicTime| now.seconds_since(at).max(0.0);
    ProbeStatus {
        coverage: f64::from(map.coverage.clamp(0.0, 1.0)),
        coverage_above: f64::from(map.coverage_above.clamp(0.0, 1.0)),
        map_age_s: map.seen_at.map(age),
        sphere_age_s: map.sphere_seen_at.map(age),
        rim_shift_px: map.rim_shift,
    }
}

/// Returns why the light of a sphere is stale, if it is older than `stale_after` nanoseconds.
pub(super) fn stale(probe: &ProbeStatus, stale_after: i64) -> Option<String> {
    let old = probe.sphere_age_s? * 1e9 > stale_after as f64;
    old.then(|| {
        "the mirrored ball, its marker or the camera's pose is lost: the last light observed in \
         each direction is used"
            .to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_count_from_the_last_observation_of_the_sphere() {
        let at = |seconds: f64| MonotonicTime::from_nanos((seconds * 1e9) as i64);
        let map = ProbeMap {
            sphere_seen_at: Some(at(2.0)),
            rim_shift: Some(0.4),
            seen_at: Some(at(1.5)),
            coverage: 0.9,
            coverage_above: 1.000_001,
        };
        let status = probe(&map, at(2.25));
        assert!((status.sphere_age_s.unwrap() - 0.25).abs() < 1e-9);
        assert!((status.map_age_s.unwrap() - 0.75).abs() < 1e-9);
        assert_eq!(
            (status.coverage_above, status.rim_shift_px),
            (1.0, Some(0.4))
        );
        assert_eq!(stale(&status, 500_000_000), None);
        let later = probe(&map, at(3.0));
        assert!(stale(&later, 500_000_000).unwrap().contains("ball"));
        assert_eq!(stale(&probe(&ProbeMap::default(), at(9.0)), 1), None);
    }
}
