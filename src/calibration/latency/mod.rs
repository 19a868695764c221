//! The clock offset between tracker and camera, by how both turn.
//!
//! A turn between two pictures is what the tracker saw between the same two instants, which
//! its clock calls later by the offset. [`from_rotations`] compares rotations where pictures
//! have poses (markers, a board); where they have none, their flow ([`ImageMotion`]) is compared:
//! patch by patch with the camera's motion if its mounting is known ([`from_patches`]), else with all
//! of the tracker's motion as a whole ([`from_motion`]). Drift is followed by asking again for the last few seconds.

mod flow;
pub mod follow;
mod image_motion;
mod jumps;
mod mounted;
mod scan;
mod track;

pub use flow::from_motion;
pub use image_motion::{Flow, ImageMotion, MOST_PATCHES, Patch};
pub(crate) use jumps::without_jumps;
pub use mounted::{Mounted, from_patches};
pub use track::TrackerTrack;

use crate::hand_eye::best_rotation;
use glam::DQuat;
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

/// How the picture moved between two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMotion {
    /// Stamp of the first, seconds.
    pub from: f64,
    /// Stamp of the second, seconds.
    pub to: f64,
    /// It.
    pub flow: Flow,
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
    /// The motion fits at any offset.
    #[error(
        "the motion fits at any offset, as it is slow or goes to and fro at one pace; turn the rig briskly and unevenly"
    )]
    AnyOffset,
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
/// A rough offset is off by no more than this, seconds.
const AROUND: f64 = 0.015;
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
    let all = within(track, &spans, range)?;
    let rough = scan(|offset| fit(track, &turns, &all, offset), range, 3);
    let kept = covered(track, &spans, all, rough.map_or(0.0, |r| r.offset))?;
    let found = scan(|offset| fit(track, &turns, &kept, offset), range, 3);
    settle(found, range, independent(&spans, &kept), (3.0, kept.len()))
}

/// What is left between both at an offset, the camera's mounting fitted.
fn fit(track: &TrackerTrack, turns: &[CameraTurn], kept: &[usize], offset: f64) -> Option<Fit> {
    let (mut by_tracker, mut seen) = (Vec::new(), Vec::new());
    for turn in kept.iter().map(|&i| &turns[i]) {
        let tracked = track.at(turn.from + offset)?.inverse() * track.at(turn.to + offset)?;
        by_tracker.push(shortest(tracked).to_scaled_axis());
        seen.push(shortest(turn.rotation).to_scaled_axis());
    }
    let pairs = || by_tracker.iter().copied().zip(seen.iter().copied());
    let rotation = best_rotation(pairs())?;
    let residuals = pairs().flat_map(|(a, b)| (a - rotation * b).to_array());
    let power: f64 = pairs()
        .map(|(a, b)| a.length_squared() + b.length_squared())
        .sum();
    Some(Fit::new(residuals.collect(), 0.5 * power))
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

/// Of those the ones at whose ends the tracker spoke, at about that offset.
fn covered(
    track: &TrackerTrack,
    spans: &[(f64, f64)],
    mut kept: Vec<usize>,
    offset: f64,
) -> Result<Vec<usize>, LatencyError> {
    let there = |time: f64| {
        let about = [-AROUND, 0.0, AROUND];
        about.iter().all(|d| track.covers(time + offset + d))
    };
    kept.retain(|&i| there(spans[i].0) && there(spans[i].1));
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
    independent: f64,
    (fitted, samples): (f64, usize),
) -> Result<ClockOffset, LatencyError> {
    let Some(mut found) = found else {
        return Err(LatencyError::NotAlike { percent: 0.0 });
    };
    // How much wider the result of a short record is than its own scatter says.
    let of_few = independent / (independent - fitted).max(0.1);
    found.sigma *= of_few.max(1.0).sqrt();
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
        samples,
    })
}

/// How many spans tell something of their own.
fn independent(spans: &[(f64, f64)], kept: &[usize]) -> f64 {
    let length: f64 = kept.windows(2).map(|w| spans[w[1]].0 - spans[w[0]].0).sum();
    length / SPAN
}

fn shortest(q: DQuat) -> DQuat {
    if q.w < 0.0 { -q } else { q }
}

#[cfg(test)]
mod tests;
