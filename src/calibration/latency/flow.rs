//! The offset from image motion without poses and without a known mounting.
//!
//! Each component of the flow (displacement to the right and down, change of scale, rotation) is a
//! linear combination of the tracker's rotation and translation between the same two instants. The
//! coefficients depend on the mounting, the lens and the distance of the scene, which varies with the
//! position. They are fitted at each offset, so that none of these need to be known. Where the scene
//! has varying depth, or the camera orbits it, the rotation of the flow still determines the offset,
//! as each component is weighted by how well it fits.

use super::model::{CameraMotion, ClockOffset, LatencyError};
use super::scan::{Fit, scan};
use super::selection::{SPAN, accept_minimum, covered_spans, independent_count, spans_within};
use super::track::TrackerTrack;
use glam::DVec3;
use penumbra_numerics::{Matrix, median_absolute, root_mean_square, rotation_vector};

/// Number of components of a flow.
const COMPONENTS: usize = 4;
/// Number of a component's coefficients for the rotation about three axes.
const ROTATION_COEFFICIENTS: usize = 3;
/// Number of all coefficients of a component: also those for the translation along three axes and for
/// the change of inverse depth with the position along three axes.
const COEFFICIENTS: usize = ROTATION_COEFFICIENTS + 3 + 9;
/// Minimum number of independent spans: fewer are fitted by chance.
const MIN_INDEPENDENT: f64 = 30.0;
/// Interval over which flows are summed for comparison, seconds.
const SUM_SECONDS: f64 = 0.13;
/// Motions with a residual of more than this number of σ are rejected as jumps of the picture.
const OUTLIER: f64 = 6.0;
/// Minimum share of the squares that the worst offset leaves. If it leaves less, the coefficients
/// compensate for any offset: a harmonic oscillation fits a delayed one with other coefficients.
const MIN_WORST: f64 = 0.03;
/// Relative ridge added to the normal equations of the coefficients: motion about one axis leaves the
/// coefficients of the others undetermined.
const RIDGE: f64 = 1e-9;

/// Finds the offset from flows, fitted by the tracker's rotation and translation at each offset.
///
/// # Errors
/// As [`super::from_rotations`].
pub fn from_flow(
    track: &TrackerTrack,
    motions: &[CameraMotion],
    range: f64,
) -> Result<ClockOffset, LatencyError> {
    let spans: Vec<(f64, f64)> = motions.iter().map(|m| (m.from, m.to)).collect();
    let kept = spans_within(track, &spans, range)?;
    let length = kept.iter().map(|&i| spans[i].1 - spans[i].0).sum::<f64>() / kept.len() as f64;
    let independent_spans = independent_count(&spans, &kept);
    if independent_spans < MIN_INDEPENDENT {
        return Err(LatencyError::TooShort {
            samples: kept.len(),
            needed: (MIN_INDEPENDENT * SPAN / length).ceil() as usize,
        });
    }
    // First with components weighted by their RMS, then by their residuals, without jumps.
    let all = SummedMotions::new(track, motions, &kept, length);
    let rms = all.component_rms();
    let rough = scan(|offset| all.fit(offset, &rms), range, COMPONENTS);
    let rough = rough.ok_or(LatencyError::Uncorrelated { percent: 0.0 })?;
    let (noise, outliers) = all
        .noise(rough.offset)
        .ok_or(LatencyError::Uncorrelated { percent: 0.0 })?;
    let inliers = kept.into_iter().zip(outliers);
    let inliers = inliers.filter(|(_, outlier)| !outlier).map(|(i, _)| i);
    let kept = covered_spans(track, &spans, inliers.collect(), rough.offset)?;
    let inliers = SummedMotions::new(track, motions, &kept, length);
    let found = scan(|offset| inliers.fit(offset, &noise), range, COMPONENTS);
    if found.as_ref().is_some_and(|f| f.worst < MIN_WORST) {
        return Err(LatencyError::AnyOffset);
    }
    let fitted = (COEFFICIENTS + 1) as f64;
    let independent_sums = independent_spans * SPAN / SUM_SECONDS;
    accept_minimum(found, range, independent_sums, (fitted, kept.len()))
}

/// Flows and the tracker's motion, both summed over the same successive pictures.
struct SummedMotions<'a> {
    track: &'a TrackerTrack,
    spans: Vec<(f64, f64)>,
    flows: Vec<[f64; COMPONENTS]>,
    /// Number of successive pairs of pictures that are summed.
    sum_length: usize,
    /// Mean position of the tracker.
    mean_position: DVec3,
    coefficients: usize,
    /// Share of the squares that a fit to unrelated motions leaves.
    unrelated_share: f64,
}

impl<'a> SummedMotions<'a> {
    fn new(track: &'a TrackerTrack, motions: &[CameraMotion], kept: &[usize], length: f64) -> Self {
        let seen = kept.iter().map(|&i| &motions[i]);
        let spans: Vec<(f64, f64)> = seen.clone().map(|m| (m.from, m.to)).collect();
        let components = |m: &CameraMotion| {
            let flow = &m.flow;
            [flow.shift.x, flow.shift.y, flow.growth, flow.rotation]
        };
        let sum_length = ((SUM_SECONDS / length) as usize).clamp(1, kept.len().max(4) / 4);
        let coefficients = if track.has_positions() {
            COEFFICIENTS
        } else {
            ROTATION_COEFFICIENTS
        };
        let all: Vec<usize> = (0..spans.len()).collect();
        let independent_sums = independent_count(&spans, &all) * SPAN / SUM_SECONDS;
        let independent_sums = independent_sums.max(coefficients as f64 + 1.0);
        Self {
            track,
            flows: summed(&seen.map(components).collect::<Vec<_>>(), sum_length),
            spans,
            sum_length,
            mean_position: track.mean_position(),
            coefficients,
            unrelated_share: (independent_sums - coefficients as f64) / independent_sums,
        }
    }

    /// Returns the root mean square of each component.
    fn component_rms(&self) -> [f64; COMPONENTS] {
        std::array::from_fn(|k| root_mean_square(self.flows.iter().map(|f| f[k])).max(1e-12))
    }

    /// Returns the tracker's rotation and translation, in its own axes at the first of both instants,
    /// and the products of translation and position.
    fn tracker_motion(&self, offset: f64) -> Option<Vec<[f64; COEFFICIENTS]>> {
        let one = |&(from, to): &(f64, f64)| {
            let before = self.track.pose_at(from + offset)?;
            let after = self.track.pose_at(to + offset)?;
            let back = before.rotation.inverse();
            let rotation = rotation_vector(back * after.rotation);
            let translation = back * (after.translation - before.translation);
            let p = before.translation - self.mean_position;
            let mut motion = [0.0; COEFFICIENTS];
            motion[..3].copy_from_slice(&rotation.to_array());
            for (k, factor) in [1.0, p.x, p.y, p.z].into_iter().enumerate() {
                motion[3 * (k + 1)..][..3].copy_from_slice(&(translation * factor).to_array());
            }
            Some(motion)
        };
        let each: Option<Vec<_>> = self.spans.iter().map(one).collect();
        Some(summed(&each?, self.sum_length))
    }

    /// Returns the residuals of each component with the best coefficients at an offset.
    fn residuals(&self, offset: f64) -> Option<Vec<[f64; COMPONENTS]>> {
        let motion = self.tracker_motion(offset)?;
        let n = self.coefficients;
        let mut normal = Matrix::zeros(n, n);
        let mut right = [[0.0; COEFFICIENTS]; COMPONENTS];
        for (m, flow) in motion.iter().zip(&self.flows) {
            normal.add_outer(1.0, &m[..n], &m[..n]);
            for (sums, component) in right.iter_mut().zip(flow) {
                sums.iter_mut()
                    .zip(m)
                    .for_each(|(sum, m)| *sum += m * component);
            }
        }
        for i in 0..n {
            let own = normal[(i, i)];
            normal[(i, i)] = own * (1.0 + RIDGE) + 1e-18;
        }
        let solver = normal.cholesky()?;
        let coefficients = right.map(|sums| solver.solve(&sums[..n]));
        let residual = |(m, flow): (&[f64; COEFFICIENTS], &[f64; COMPONENTS])| {
            std::array::from_fn(|k| {
                let predicted: f64 = coefficients[k].iter().zip(m).map(|(c, m)| c * m).sum();
                flow[k] - predicted
            })
        };
        Some(motion.iter().zip(&self.flows).map(residual).collect())
    }

    /// Returns the residuals in units of the components' noise.
    fn fit(&self, offset: f64, noise: &[f64; COMPONENTS]) -> Option<Fit> {
        let in_units = |values: &[[f64; COMPONENTS]]| -> Vec<f64> {
            let each = values
                .iter()
                .flat_map(|v| (0..COMPONENTS).map(|k| v[k] / noise[k]));
            each.collect()
        };
        let power: f64 = in_units(&self.flows).iter().map(|v| v * v).sum();
        Some(Fit::new(
            in_units(&self.residuals(offset)?),
            power * self.unrelated_share,
        ))
    }

    /// Returns the robust standard deviation (1.4826 MAD) of each component's residuals, and which
    /// motions are outliers.
    fn noise(&self, offset: f64) -> Option<([f64; COMPONENTS], Vec<bool>)> {
        let residuals = self.residuals(offset)?;
        let rms = self.component_rms();
        let noise: [f64; COMPONENTS] = std::array::from_fn(|k| {
            let robust = 1.4826 * median_absolute(residuals.iter().map(|r| r[k]));
            robust.max(0.01 * rms[k]).max(1e-12)
        });
        let is_outlier =
            |r: &[f64; COMPONENTS]| (0..COMPONENTS).any(|k| r[k].abs() > OUTLIER * noise[k]);
        let sums: Vec<bool> = residuals.iter().map(is_outlier).collect();
        // A jump affects all sums that contain it, and no others.
        let is_jump = |i: usize| {
            let first = (i + 1).saturating_sub(self.sum_length);
            sums[first..sums.len().min(i + 1)]
                .iter()
                .all(|outlier| *outlier)
        };
        Some((noise, (0..self.spans.len()).map(is_jump).collect()))
    }
}

/// Returns the sums of every `sum_length` successive values.
fn summed<const N: usize>(values: &[[f64; N]], sum_length: usize) -> Vec<[f64; N]> {
    let sum = |w: &[[f64; N]]| std::array::from_fn(|k| w.iter().map(|v| v[k]).sum());
    values.windows(sum_length).map(sum).collect()
}
