//! What the mirrored sphere in the scene camera's picture has shown, as the status tells it.

use penumbra_interface::MonotonicTime;
use penumbra_lighting::ProbeMap;
use penumbra_status::ProbeStatus;

/// At the instant of the picture that is shown.
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

/// Why the light by a sphere is old, if it is older than `stale_after` nanoseconds.
pub(super) fn stale(probe: &ProbeStatus, stale_after: i64) -> Option<String> {
    let old = probe.sphere_age_s? * 1e9 > stale_after as f64;
    old.then(|| {
        "the mirrored ball, its marker or the camera's pose is out of sight: the light is the last \
         that was seen of each direction"
            .to_owned()
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn ages_grow_from_when_the_ball_was_seen() {
        let at = |seconds: f64| MonotonicTime::from_nanos((seconds * 1e9) as i64);
        let map = ProbeMap {
            sphere_seen_at: Some(at(2.0)),
            rim_shift: Some(0.4),
            seen_at: Some(at(1.5)),
            coverage: 0.9,
            coverage_above: 1.000_001,
        };
        let told = probe(&map, at(2.25));
        assert!((told.sphere_age_s.unwrap() - 0.25).abs() < 1e-9);
        assert!((told.map_age_s.unwrap() - 0.75).abs() < 1e-9);
        assert_eq!((told.coverage_above, told.rim_shift_px), (1.0, Some(0.4)));
        assert_eq!(stale(&told, 500_000_000), None);
        let later = probe(&map, at(3.0));
        assert!(stale(&later, 500_000_000).unwrap().contains("ball"));
        assert_eq!(stale(&probe(&ProbeMap::default(), at(9.0)), 1), None);
    }
}
