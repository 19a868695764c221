//! The offset from rotations: those of a camera with known poses against the tracker's.

use super::model::{CameraRotation, ClockOffset, LatencyError};
use super::scan::{Fit, scan};
use super::selection::{SPAN, accept_minimum, covered_spans, independent_count, spans_within};
use super::track::TrackerTrack;
use penumbra_numerics::{best_rotation, rotation_vector};

/// Finds the offset from rotations. The camera's orientation on the sensor is fitted along with it.
///
/// # Errors
/// The record is too short; the motion is uncorrelated, periodic or slow; the offset is beyond
/// ±`range` seconds.
pub fn from_rotations(
    track: &TrackerTrack,
    rotations: &[CameraRotation],
    range: f64,
) -> Result<ClockOffset, LatencyError> {
    let rotations = chained(rotations);
    let spans: Vec<(f64, f64)> = rotations.iter().map(|t| (t.from, t.to)).collect();
    let all = spans_within(track, &spans, range)?;
    let rough = scan(|offset| fit(track, &rotations, &all, offset), range, 3);
    let kept = covered_spans(track, &spans, all, rough.map_or(0.0, |r| r.offset))?;
    let found = scan(|offset| fit(track, &rotations, &kept, offset), range, 3);
    accept_minimum(
        found,
        range,
        independent_count(&spans, &kept),
        (3.0, kept.len()),
    )
}

/// Returns the residuals at an offset, with the camera's orientation on the sensor fitted.
fn fit(
    track: &TrackerTrack,
    rotations: &[CameraRotation],
    kept: &[usize],
    offset: f64,
) -> Option<Fit> {
    let (mut by_tracker, mut by_camera) = (Vec::new(), Vec::new());
    for camera in kept.iter().map(|&i| &rotations[i]) {
        let from = track.rotation_at(camera.from + offset)?;
        let to = track.rotation_at(camera.to + offset)?;
        by_tracker.push(rotation_vector(from.inverse() * to));
        by_camera.push(rotation_vector(camera.rotation));
    }
    let pairs = || by_tracker.iter().copied().zip(by_camera.iter().copied());
    let rotation = best_rotation(pairs().map(|(a, b)| (b, a, 1.0)))?.rotation;
    let residuals = pairs().flat_map(|(a, b)| (a - rotation * b).to_array());
    let power: f64 = pairs()
        .map(|(a, b)| a.length_squared() + b.length_squared())
        .sum();
    Some(Fit::new(residuals.collect(), 0.5 * power))
}

/// Composes each rotation with those that follow it without a gap, up to [`SPAN`].
fn chained(rotations: &[CameraRotation]) -> Vec<CameraRotation> {
    (0..rotations.len())
        .map(|i| {
            let mut total = rotations[i];
            for next in &rotations[i + 1..] {
                if next.from != total.to || total.to - total.from >= SPAN {
                    break;
                }
                total.to = next.to;
                total.rotation = (total.rotation * next.rotation).normalize();
            }
            total
        })
        .collect()
}
