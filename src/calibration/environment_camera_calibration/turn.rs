//! Which light of the environment camera is which light of the world, and the turn between them.
//!
//! Two lights of each side whose angles agree give a turn; the turn on which most lights fall
//! together is taken. Lights look alike: where another turn brings as many together it is
//! ambiguous, and only a rough orientation can decide.

use crate::environment_camera_calibration::initial_poses::wahba;
use glam::{DQuat, DVec3};

/// A light of either side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Unit vector.
    pub direction: DVec3,
    /// Radius of a disc as large, radians.
    pub radius: f64,
    /// How sure the direction is, radians.
    pub sigma: f64,
}

/// Lights brought together.
#[derive(Clone, Debug, PartialEq)]
pub struct Match {
    /// `second_from_first`.
    pub turn: DQuat,
    /// Indices into first and second.
    pub pairs: Vec<(usize, usize)>,
    /// Another turn suits as well; by so much apart, radians.
    pub ambiguous: Option<f64>,
}

/// Lights cannot tell the turn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoMatch {
    /// At least two on each side.
    #[error(
        "{first} bright lights in the environment camera's picture and {second} seen by the scene camera: two of both are needed, in different directions"
    )]
    TooFew {
        /// In the environment camera's picture.
        first: usize,
        /// By the scene camera.
        second: usize,
    },
    /// No two pairs have the same angle between them.
    #[error(
        "no two bright lights of the environment camera are as far apart as two that the scene camera saw: they do not see the same ones"
    )]
    Different,
}

/// Brings `first` and `second` together within `tolerance` radians. `near` is the turn where it is
/// roughly known: lights that it brings nowhere near to one another are not the same.
///
/// # Errors
/// [`NoMatch`].
pub fn bring_together(
    first: &[Beam],
    second: &[Beam],
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
            let Some(turn) = wahba(&two) else { continue };
            if near.is_some_and(|(q, most)| turn.angle_between(q) > most) {
                continue;
            }
            tried.push(settled(first, second, tolerance, turn));
        }
    }
    tried.retain(|t| t.1.pairs.len() >= 2);
    tried.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((score, best)) = tried.first() else {
        return Err(NoMatch::Different);
    };
    let rival = tried
        .iter()
        .find(|t| t.1.turn.angle_between(best.turn) > 4.0 * tolerance && t.0 > score - 0.75);
    Ok(Match {
        ambiguous: rival.map(|t| t.1.turn.angle_between(best.turn)),
        ..best.clone()
    })
}

fn ordered(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |i| (i + 1..n).map(move |j| (i, j)))
}

/// The turn by all lights that it brings together, and how good that is: a light each, less
/// what they are apart and what they differ in size.
fn settled(first: &[Beam], second: &[Beam], tolerance: f64, start: DQuat) -> (f64, Match) {
    let mut turn = start;
    let mut pairs = Vec::new();
    let mut score = 0.0;
    for _ in 0..3 {
        (score, pairs) = paired(first, second, tolerance, turn);
        let all: Vec<_> = pairs
            .iter()
            .map(|&(i, j)| {
                let sigma = first[i].sigma.hypot(second[j].sigma).max(1e-4);
                (first[i].direction, second[j].direction, sigma.powi(-2))
            })
            .collect();
        turn = wahba(&all).unwrap_or(turn);
    }
    let found = Match {
        turn,
        pairs,
        ambiguous: None,
    };
    (score, found)
}

fn paired(
    first: &[Beam],
    second: &[Beam],
    tolerance: f64,
    turn: DQuat,
) -> (f64, Vec<(usize, usize)>) {
    let mut all: Vec<(f64, usize, usize)> = Vec::new();
    for (i, f) in first.iter().enumerate() {
        for (j, s) in second.iter().enumerate() {
            let apart = (turn * f.direction).angle_between(s.direction) / tolerance;
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn beam(x: f64, y: f64, z: f64, radius: f64) -> Beam {
        Beam {
            direction: DVec3::new(x, y, z).normalize(),
            radius,
            sigma: 0.003,
        }
    }

    fn turned(beams: &[Beam], turn: DQuat) -> Vec<Beam> {
        let one = |b: &Beam| Beam {
            direction: turn * b.direction,
            ..*b
        };
        beams.iter().map(one).collect()
    }

    fn turn() -> DQuat {
        DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.8, 1.9)
    }

    #[test]
    fn three_lights_are_brought_together_whatever_else_shines() {
        let lights = [
            beam(1.0, 0.2, 0.5, 0.1),
            beam(-0.3, 0.9, 0.6, 0.1),
            beam(0.1, -0.4, 1.0, 0.05),
        ];
        let mut seen = turned(&lights, turn().inverse());
        seen.swap(0, 2);
        seen.push(beam(0.3, 0.3, -1.0, 0.1));
        let found = bring_together(&seen, &lights, 0.03, None).unwrap();
        assert!(
            found.turn.angle_between(turn()) < 1e-6 && found.pairs.len() == 3,
            "{found:?}"
        );
        assert_eq!(found.ambiguous, None);
    }

    #[test]
    fn two_lights_alike_are_ambiguous_unless_it_is_roughly_known() {
        let lights = [beam(1.0, 0.2, 0.5, 0.1), beam(-0.3, 0.9, 0.6, 0.1)];
        let seen = turned(&lights, turn().inverse());
        let found = bring_together(&seen, &lights, 0.03, None).unwrap();
        assert!(found.ambiguous.is_some());
        let near = DQuat::from_rotation_x(0.1) * turn();
        let found = bring_together(&seen, &lights, 0.03, Some((near, 0.5))).unwrap();
        assert!(found.turn.angle_between(turn()) < 1e-6 && found.ambiguous.is_none());
        // A window and a lamp are told apart by their size.
        let lights = [
            lights[0],
            Beam {
                radius: 0.01,
                ..lights[1]
            },
        ];
        let seen = turned(&lights, turn().inverse());
        assert_eq!(
            bring_together(&seen, &lights, 0.03, None)
                .unwrap()
                .ambiguous,
            None
        );
    }

    #[test]
    fn one_light_and_other_lights_are_told() {
        let lights = [beam(1.0, 0.2, 0.5, 0.1), beam(-0.3, 0.9, 0.6, 0.1)];
        assert!(matches!(
            bring_together(&lights[..1], &lights, 0.03, None),
            Err(NoMatch::TooFew { .. })
        ));
        let others = [beam(1.0, 0.0, 0.0, 0.1), beam(0.0, 0.0, 1.0, 0.1)];
        assert_eq!(
            bring_together(&others, &lights, 0.01, None),
            Err(NoMatch::Different)
        );
    }
}
