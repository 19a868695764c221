//! Matches lights of the environment camera with lights of the world, and finds the rotation between
//! them.
//!
//! Two lights of each side with equal angles between them give a rotation; the rotation that matches
//! most lights is chosen. Lights have few distinguishing features: where another rotation matches as
//! many, the result is ambiguous, and only an approximate orientation can decide.

use glam::{DQuat, DVec3};
use penumbra_numerics::best_rotation;

/// Minimum [`penumbra_numerics::BestRotation::margin`] of a rotation between directions.
const MIN_MARGIN: f64 = 1e-7;

/// Direction of a light from either side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightDirection {
    /// Unit vector.
    pub direction: DVec3,
    /// Radius of a disc of equal solid angle, radians.
    pub radius: f64,
    /// Standard deviation of the direction, radians.
    pub sigma: f64,
}

/// Matched lights.
#[derive(Clone, Debug, PartialEq)]
pub struct Match {
    /// `second_from_first`.
    pub rotation: DQuat,
    /// Indices into first and second.
    pub pairs: Vec<(usize, usize)>,
    /// Angle to another rotation that fits as well, radians.
    pub ambiguous: Option<f64>,
}

/// Why lights could not be matched.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoMatch {
    /// There are fewer than two lights on either side.
    #[error(
        "{first} bright lights in the environment camera's picture and {second} in the scene camera's; two are needed in each, in different directions"
    )]
    TooFew {
        /// Lights of the environment camera.
        first: usize,
        /// Lights of the scene camera.
        second: usize,
    },
    /// No two pairs have the same angle between them.
    #[error(
        "no two bright lights of the environment camera have the same angle between them as two of the scene camera: the cameras see different lights"
    )]
    Different,
}

/// Matches `first` and `second` within `tolerance` radians. `near` is an approximate rotation and its
/// maximum error, radians, if known.
///
/// # Errors
/// There are fewer than two lights on either side, or no two pairs have the same angle between them.
pub fn match_lights(
    first: &[LightDirection],
    second: &[LightDirection],
    tolerance: f64,
    near: Option<(DQuat, f64)>,
) -> Result<Match, NoMatch> {
    if first.len() < 2 || second.len() < 2 {
        return Err(NoMatch::TooFew {
            first: first.len(),
            second: second.len(),
        });
    }
    let mut tried: Vec<(f64, Match)> = Vec::new();
    for (a, b) in ordered(first.len()) {
        for (c, d) in ordered(second.len()).chain(ordered(second.len()).map(|(c, d)| (d, c))) {
            let wide = first[a].direction.angle_between(first[b].direction);
            let other = second[c].direction.angle_between(second[d].direction);
            if !(0.1..=3.0).contains(&wide) || (wide - other).abs() > 2.0 * tolerance {
                continue;
            }
            let two = [(first[a], second[c]), (first[b], second[d])]
                .map(|(f, s)| (f.direction, s.direction, 1.0));
            let Some(rotation) = determined_rotation(&two) else {
                continue;
            };
            if near.is_some_and(|(q, max_error)| rotation.angle_between(q) > max_error) {
                continue;
            }
            tried.push(refined(first, second, tolerance, rotation));
        }
    }
    tried.retain(|t| t.1.pairs.len() >= 2);
    tried.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((score, best)) = tried.first() else {
        return Err(NoMatch::Different);
    };
    let rival = tried.iter().find(|t| {
        t.1.rotation.angle_between(best.rotation) > 4.0 * tolerance && t.0 > score - 0.75
    });
    Ok(Match {
        ambiguous: rival.map(|t| t.1.rotation.angle_between(best.rotation)),
        ..best.clone()
    })
}

fn ordered(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |i| (i + 1..n).map(move |j| (i, j)))
}

/// Refines a rotation with all lights that it matches; returns its score as well: one for each match,
/// less penalties for angle and difference in size.
fn refined(
    first: &[LightDirection],
    second: &[LightDirection],
    tolerance: f64,
    start: DQuat,
) -> (f64, Match) {
    let mut rotation = start;
    let mut pairs = Vec::new();
    let mut score = 0.0;
    for _ in 0..3 {
        (score, pairs) = paired(first, second, tolerance, rotation);
        let all: Vec<_> = pairs
            .iter()
            .map(|&(i, j)| {
                let sigma = first[i].sigma.hypot(second[j].sigma).max(1e-4);
                (first[i].direction, second[j].direction, sigma.powi(-2))
            })
            .collect();
        rotation = determined_rotation(&all).unwrap_or(rotation);
    }
    let found = Match {
        rotation,
        pairs,
        ambiguous: None,
    };
    (score, found)
}

/// Matches lights one to one at a rotation, best first, and returns the score.
fn paired(
    first: &[LightDirection],
    second: &[LightDirection],
    tolerance: f64,
    rotation: DQuat,
) -> (f64, Vec<(usize, usize)>) {
    let mut all: Vec<(f64, usize, usize)> = Vec::new();
    for (i, f) in first.iter().enumerate() {
        for (j, s) in second.iter().enumerate() {
            let apart = (rotation * f.direction).angle_between(s.direction) / tolerance;
            let size = (f.radius.max(2e-3) / s.radius.max(2e-3)).ln().abs();
            if apart < 1.0 && size < 1.6 {
                all.push((1.0 - 0.25 * apart * apart - 0.25 * size, i, j));
            }
        }
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut score, mut pairs) = (0.0, Vec::new());
    for (value, i, j) in all {
        if !pairs.iter().any(|&(a, b)| a == i || b == j) {
            score += value;
            pairs.push((i, j));
        }
    }
    (score, pairs)
}

/// Returns the rotation that best maps the first directions to the second ones, with weights third;
/// `None` where they do not determine it.
pub(super) fn determined_rotation(pairs: &[(DVec3, DVec3, f64)]) -> Option<DQuat> {
    let best = best_rotation(pairs.iter().copied())?;
    (best.margin > MIN_MARGIN).then_some(best.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beam(x: f64, y: f64, z: f64, radius: f64) -> LightDirection {
        LightDirection {
            direction: DVec3::new(x, y, z).normalize(),
            radius,
            sigma: 0.003,
        }
    }

    fn rotated(beams: &[LightDirection], rotation: DQuat) -> Vec<LightDirection> {
        let one = |b: &LightDirection| LightDirection {
            direction: rotation * b.direction,
            ..*b
        };
        beams.iter().map(one).collect()
    }

    fn rotation() -> DQuat {
        DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.8, 1.9)
    }

    #[test]
    fn matches_three_lights_among_others() {
        let lights = [
            beam(1.0, 0.2, 0.5, 0.1),
            beam(-0.3, 0.9, 0.6, 0.1),
            beam(0.1, -0.4, 1.0, 0.05),
        ];
        let mut seen = rotated(&lights, rotation().inverse());
        seen.swap(0, 2);
        seen.push(beam(0.3, 0.3, -1.0, 0.1));
        let found = match_lights(&seen, &lights, 0.03, None).unwrap();
        assert!(
            found.rotation.angle_between(rotation()) < 1e-6 && found.pairs.len() == 3,
            "{found:?}"
        );
        assert_eq!(found.ambiguous, None);
    }

    #[test]
    fn two_equal_lights_are_ambiguous_without_approximate_rotation() {
        let lights = [beam(1.0, 0.2, 0.5, 0.1), beam(-0.3, 0.9, 0.6, 0.1)];
        let seen = rotated(&lights, rotation().inverse());
        let found = match_lights(&seen, &lights, 0.03, None).unwrap();
        assert!(found.ambiguous.is_some());
        let near = DQuat::from_rotation_x(0.1) * rotation();
        let found = match_lights(&seen, &lights, 0.03, Some((near, 0.5))).unwrap();
        assert!(found.rotation.angle_between(rotation()) < 1e-6 && found.ambiguous.is_none());
        // A window and a lamp are distinguished by their size.
        let lights = [
            lights[0],
            LightDirection {
                radius: 0.01,
                ..lights[1]
            },
        ];
        let seen = rotated(&lights, rotation().inverse());
        assert_eq!(
            match_lights(&seen, &lights, 0.03, None).unwrap().ambiguous,
            None
        );
    }

    #[test]
    fn reports_too_few_and_different_lights() {
        let lights = [beam(1.0, 0.2, 0.5, 0.1), beam(-0.3, 0.9, 0.6, 0.1)];
        assert!(matches!(
            match_lights(&lights[..1], &lights, 0.03, None),
            Err(NoMatch::TooFew { .. })
        ));
        let others = [beam(1.0, 0.0, 0.0, 0.1), beam(0.0, 0.0, 1.0, 0.1)];
        assert_eq!(
            match_lights(&others, &lights, 0.01, None),
            Err(NoMatch::Different)
        );
    }
}
