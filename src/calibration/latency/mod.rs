//! The clock offset between tracker and camera, by how both turn.
//!
//! A turn between two pictures is what the tracker saw between the same two instants, which
//! its clock calls later by the offset. [`from_rotations`] compares rotations where pictures
//! have poses (markers, a board); [`from_motion`] compares amounts where they have only a flow
//! ([`ImageMotion`]). Drift is followed by asking again for the last few seconds.

pub mod follow;
mod image_motion;
mod scan;
mod track;

pub use image_motion::ImageMotion;
pub use track::TrackerTrack;

use crate::calibration::hand_eye::best_rotation;
use glam::{DQuat, DVec3};
use scan::{Fit, scan};
use thiserror::Error;

/// How two clocks compare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockOffset {
    /// What the tracker's stamps are ahead of the camera's for one instant: latency of the
    /// tracker minus latency of the camera, seconds.
    pub seconds: f64,
    /// 1σ.
    pub sigma: f64,
    /// Correlation of both motions at that offset, 0 to 1.
    pub correlation: f64,
    /// Pairs of pictures that were compared.
    pub samples: usize,
}

/// Between two pictures, by a camera whose pose was found in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraTurn {
    /// Stamp of the first, seconds.
    pub from: f64,
    /// Stamp of the second, seconds.
    pub to: f64,
    /// `first_from_second`, camera frames.
    pub rotation: DQuat,
}

/// How much the picture moved between two pictures, in any unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMotion {
    /// Stamp of the first, seconds.
    pub from: f64,
    /// Stamp of the second, seconds.
    pub to: f64,
    /// At least 0.
    pub amount: f64,
}

/// The motions do not tell. Each text says what to do.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum LatencyError {
    /// Too few pictures within the tracker's record.
    #[error(
        "{samples} pictures overlap the tracker's record; at least {least} are needed: move the rig for ten seconds"
    )]
    TooShort {
        /// That do.
        samples: usize,
        /// Needed.
        least: usize,
    },
    /// Both motions have nothing to do with each other at any offset.
    #[error(
        "picture and tracker move alike by {percent:.0} % only; turn the rig briskly to and fro, the scene at rest, and check that the tracker sits on this camera"
    )]
    NotAlike {
        /// Correlation at best.
        percent: f64,
    },
    /// The tracker hardly turned.
    #[error("the rig rests, and only turning tells; turn it briskly to and fro")]
    AtRest,
    /// The best offset is the largest one tried.
    #[error("the clocks differ by more than {seconds:.2} s; check the stamps")]
    OutOfRange {
        /// Largest offset tried.
        seconds: f64,
    },
    /// Several offsets explain the motion: it repeats itself.
    #[error(
        "the motion repeats itself, so that offsets of {first:.3} s and {second:.3} s fit alike; move unevenly"
    )]
    Ambiguous {
        /// The best.
        first: f64,
        /// The next best.
        second: f64,
    },
    /// It is not sure enough.
    #[error("the offset is known to {millis:.1} ms only; turn the rig more briskly, and longer")]
    Uncertain {
        /// 1σ, milliseconds.
        millis: f64,
    },
}

/// Fewest samples.
const LEAST: usize = 40;
/// Turns are compared over so many seconds: over one frame they are hardly larger than the
/// tracker's noise.
const SPAN: f64 = 0.25;
/// Least correlation.
const ALIKE: f64 = 0.5;
/// Largest 1σ, seconds.
const LARGEST_SIGMA: f64 = 0.01;

/// From rotations. Which way the camera sits on the sensor is found along the way.
///
/// # Errors
/// Too short, unlike, repetitive or slow motion; an offset beyond `range` seconds.
pub fn from_rotations(
    track: &TrackerTrack,
    turns: &[CameraTurn],
    range: f64,
) -> Result<ClockOffset, LatencyError> {
    let turns = chained(turns);
    let spans: Vec<(f64, f64)> = turns.iter().map(|t| (t.from, t.to)).collect();
    let kept = within(track, &spans, range)?;
    let seen: Vec<(f64, f64, DVec3)> = kept
        .iter()
        .map(|&i| {
            let t = &turns[i];
            (t.from, t.to, shortest(t.rotation).to_scaled_axis())
        })
        .collect();
    let fit = |offset: f64| -> Option<Fit> {
        let mut by_tracker = Vec::with_capacity(seen.len());
        for &(from, to, _) in &seen {
            let turn = track.at(from + offset)?.inverse() * track.at(to + offset)?;
            by_tracker.push(shortest(turn).to_scaled_axis());
        }
        let pairs = by_tracker.iter().copied().zip(seen.iter().map(|s| s.2));
        let rotation = best_rotation(pairs)?;
        let residuals = by_tracker
            .iter()
            .zip(&seen)
            .flat_map(|(a, s)| (*a - rotation * s.2).to_array())
            .collect();
        let power = by_tracker.iter().map(|a| a.length_squared()).sum::<f64>();
        let power = power + seen.iter().map(|s| s.2.length_squared()).sum::<f64>();
        Some(Fit::new(residuals, 0.5 * power))
    };
    settle(scan(fit, range, 3), range, &spans, &kept)
}

/// From amounts of motion, whatever their unit: the tracker's turn times a factor plus a
/// floor (noise makes stillness look like motion) is fitted at each offset.
///
/// # Errors
/// As [`from_rotations`].
pub fn from_motion(
    track: &TrackerTrack,
    motions: &[CameraMotion],
    range: f64,
) -> Result<ClockOffset, LatencyError> {
    let spans: Vec<(f64, f64)> = motions.iter().map(|m| (m.from, m.to)).collect();
    let kept = within(track, &spans, range)?;
    let seen: Vec<CameraMotion> = kept.iter().map(|&i| motions[i]).collect();
    // Both are summed over the same few pictures, which moves neither in time.
    let length = seen.iter().map(|m| m.to - m.from).sum::<f64>() / seen.len() as f64;
    let together = ((SPAN / length) as usize).clamp(1, seen.len() / 4);
    let each: Vec<f64> = seen.iter().map(|m| m.amount).collect();
    let amounts = summed(&each, together);
    let mean = amounts.iter().sum::<f64>() / amounts.len() as f64;
    let fit = |offset: f64| -> Option<Fit> {
        let mut turns = Vec::with_capacity(seen.len());
        for m in &seen {
            let turn = track.at(m.from + offset)?.inverse() * track.at(m.to + offset)?;
            turns.push(shortest(turn).to_scaled_axis().length());
        }
        let turns = summed(&turns, together);
        let n = turns.len() as f64;
        let middle = turns.iter().sum::<f64>() / n;
        let (mut across, mut own, mut power) = (0.0, 0.0, 0.0);
        for (turn, amount) in turns.iter().zip(&amounts) {
            across += (turn - middle) * (amount - mean);
            own += (turn - middle).powi(2);
            power += (amount - mean).powi(2);
        }
        // More turn is more flow: a falling line fits by accident.
        let slope = (across / own.max(1e-300)).max(0.0);
        let residuals = turns
            .iter()
            .zip(&amounts)
            .map(|(turn, amount)| (amount - mean) - slope * (turn - middle))
            .collect();
        Some(Fit::new(residuals, power))
    };
    settle(scan(fit, range, 1), range, &spans, &kept)
}

/// Each turn and those that follow it without a gap, up to [`SPAN`].
fn chained(turns: &[CameraTurn]) -> Vec<CameraTurn> {
    (0..turns.len())
        .map(|i| {
            let mut whole = turns[i];
            for next in &turns[i + 1..] {
                if next.from != whole.to || whole.to - whole.from >= SPAN {
                    break;
                }
                whole.to = next.to;
                whole.rotation = (whole.rotation * next.rotation).normalize();
            }
            whole
        })
        .collect()
}

/// Sums of so many neighbours.
fn summed(values: &[f64], together: usize) -> Vec<f64> {
    values.windows(together).map(|w| w.iter().sum()).collect()
}

/// Which spans lie within the track at every offset.
fn within(
    track: &TrackerTrack,
    spans: &[(f64, f64)],
    range: f64,
) -> Result<Vec<usize>, LatencyError> {
    let (first, last) = track.span();
    let kept: Vec<usize> = (0..spans.len())
        .filter(|&i| {
            let (from, to) = spans[i];
            to > from && from - range >= first && to + range <= last
        })
        .collect();
    if kept.len() < LEAST {
        return Err(LatencyError::TooShort {
            samples: kept.len(),
            least: LEAST,
        });
    }
    Ok(kept)
}

fn settle(
    found: Option<scan::Minimum>,
    range: f64,
    spans: &[(f64, f64)],
    kept: &[usize],
) -> Result<ClockOffset, LatencyError> {
    let Some(mut found) = found else {
        return Err(LatencyError::NotAlike { percent: 0.0 });
    };
    found.sigma *= of_few(spans, kept);
    if found.correlation < ALIKE {
        return Err(LatencyError::NotAlike {
            percent: 100.0 * found.correlation,
        });
    }
    if found.at_edge {
        return Err(LatencyError::OutOfRange { seconds: range });
    }
    if let Some(second) = found.rival {
        return Err(LatencyError::Ambiguous {
            first: found.offset,
            second,
        });
    }
    if found.sigma.is_nan() || found.sigma > LARGEST_SIGMA {
        return Err(LatencyError::Uncertain {
            millis: 1e3 * found.sigma,
        });
    }
    Ok(ClockOffset {
        seconds: found.offset,
        sigma: found.sigma,
        correlation: found.correlation,
        samples: kept.len(),
    })
}

/// How much wider the result of a short record is than its own scatter says: so many spans
/// are independent, and three numbers (a rotation, or a line and the offset) are fitted.
fn of_few(spans: &[(f64, f64)], kept: &[usize]) -> f64 {
    let length: f64 = kept.windows(2).map(|w| spans[w[1]].0 - spans[w[0]].0).sum();
    let independent = length / SPAN;
    (independent / (independent - 3.0).max(0.1)).max(1.0).sqrt()
}

fn shortest(q: DQuat) -> DQuat {
    if q.w < 0.0 { -q } else { q }
}

#[cfg(test)]
mod tests;
