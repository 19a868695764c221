//! Fits a [`TrackerField`] to the differences between poses from markers and tracker readings.

use glam::DVec3;
use penumbra_numerics::{Matrix, median, root_mean_square};
use penumbra_rig_model::tracker_field::{Grid, TrackerField};

/// Cells along the longest side of the volume.
const CELLS: f64 = 3.0;
/// Minimum size of a cell, metres.
const MIN_SPACING: f64 = 0.05;
/// Weights of the second differences, relative to a sample's residual; the best is chosen by
/// cross-validation.
const SMOOTHNESS: [f64; 5] = [1.0, 0.1, 0.01, 1e-3, 1e-4];
/// Weight of the corrections themselves, so that they are zero at grid points without samples.
const RIDGE: f64 = 1e-5;
/// Folds of the cross-validation.
const FOLDS: usize = 5;
/// Intervals of time that are assigned to the folds in turn.
const INTERVALS: usize = 25;
/// Minimum number of samples.
const MIN_SAMPLES: usize = 60;
/// Samples with residuals beyond this multiple of the median are downweighted.
const ROBUST: f64 = 3.0;
/// Maximum ratio of the held-out residuals with the field to those without it, for the field to be
/// used.
const MAX_RATIO: f64 = 0.9;

/// Error of a tracker reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FieldSample {
    /// Position read, metres.
    pub position: DVec3,
    /// Correct minus read position, metres.
    pub translation: DVec3,
    /// Rotation vector from read to correct orientation, radians, transmitter's axes.
    pub rotation: DVec3,
}

/// A field and its value: root mean square of the held-out residuals without it (`before`) and with
/// it (`after`), metres and radians.
#[derive(Clone, Debug)]
pub(super) struct FieldFit {
    pub field: TrackerField,
    pub before: (f64, f64),
    pub after: (f64, f64),
}

impl FieldFit {
    /// Returns whether the field reduces the held-out residuals.
    pub fn helps(&self) -> bool {
        let position = self.after.0 / self.before.0.max(1e-12);
        let rotation = self.after.1 / self.before.1.max(1e-12);
        position.min(rotation) < MAX_RATIO && position.max(rotation) < 1.05
    }
}

/// Fits a field to samples in the order of time; `None` for too few samples.
pub(super) fn fit(samples: &[FieldSample]) -> Option<FieldFit> {
    if samples.len() < MIN_SAMPLES {
        return None;
    }
    let grid = grid_of(samples);
    let weights = robust_weights(samples);
    let interval = samples.len().div_ceil(INTERVALS);
    let fold = |i: usize| (i / interval) % FOLDS;
    let before = inlier_rms(samples.iter().zip(&weights));
    let mut best: Option<(f64, f64, (f64, f64))> = None;
    for smoothness in SMOOTHNESS {
        let mut held_out = Vec::with_capacity(samples.len());
        for part in 0..FOLDS {
            let kept = (0..samples.len()).filter(|i| fold(*i) != part);
            let field = solve(grid, samples, &weights, kept, smoothness)?;
            let out = (0..samples.len()).filter(|i| fold(*i) == part);
            held_out.extend(out.map(|i| {
                let (translation, rotation) = field.at(samples[i].position);
                let residual = FieldSample {
                    position: samples[i].position,
                    translation: samples[i].translation - translation,
                    rotation: samples[i].rotation - rotation,
                };
                (residual, weights[i])
            }));
        }
        let after = inlier_rms(held_out.iter().map(|(s, w)| (s, w)));
        let score =
            (after.0 / before.0.max(1e-12)).powi(2) + (after.1 / before.1.max(1e-12)).powi(2);
        if best.is_none_or(|(b, ..)| score < b) {
            best = Some((score, smoothness, after));
        }
    }
    let (_, smoothness, after) = best?;
    Some(FieldFit {
        field: solve(grid, samples, &weights, 0..samples.len(), smoothness)?,
        before,
        after,
    })
}

/// Returns the root mean square of the samples with full weight, metres and radians.
fn inlier_rms<'a>(samples: impl Iterator<Item = (&'a FieldSample, &'a f64)> + Clone) -> (f64, f64) {
    let inliers = samples.filter(|(_, w)| **w > 0.99);
    let translations = inliers.clone().map(|(s, _)| s.translation.length());
    let rotations = inliers.map(|(s, _)| s.rotation.length());
    (root_mean_square(translations), root_mean_square(rotations))
}

fn grid_of(samples: &[FieldSample]) -> Grid {
    let positions = || samples.iter().map(|s| s.position);
    let low = positions().fold(DVec3::MAX, DVec3::min) - 0.01;
    let high = positions().fold(DVec3::MIN, DVec3::max) + 0.01;
    let size = high - low;
    let spacing = (size.max_element() / CELLS).max(MIN_SPACING);
    let cells = size
        .to_array()
        .map(|s| ((s / spacing).ceil() as usize).clamp(1, 6));
    let covered = DVec3::from(cells.map(|c| c as f64)) * spacing;
    Grid {
        low: low - 0.5 * (covered - size),
        spacing,
        cells,
    }
}

/// Returns the componentwise median.
fn median_vector(values: impl Iterator<Item = DVec3> + Clone) -> DVec3 {
    let along = |axis: usize| median(values.clone().map(|v| v[axis])).unwrap_or(0.0);
    DVec3::new(along(0), along(1), along(2))
}

/// Returns weights by the deviation of each sample from its neighbours in time, which is large for a
/// flipped pose or a jump.
fn robust_weights(samples: &[FieldSample]) -> Vec<f64> {
    let n = samples.len();
    let deviations: Vec<(f64, f64)> = (0..n)
        .map(|i| {
            let near = &samples[i.saturating_sub(7)..(i + 8).min(n)];
            let translation = median_vector(near.iter().map(|s| s.translation));
            let rotation = median_vector(near.iter().map(|s| s.rotation));
            (
                samples[i].translation.distance(translation),
                samples[i].rotation.distance(rotation),
            )
        })
        .collect();
    let typical = |values: &mut dyn Iterator<Item = f64>| median(values).unwrap_or(0.0).max(1e-4);
    let typical = (
        typical(&mut deviations.iter().map(|d| d.0)),
        typical(&mut deviations.iter().map(|d| d.1)),
    );
    deviations
        .iter()
        .map(|(translation, rotation)| {
            let worst = (translation / typical.0).max(rotation / typical.1) / ROBUST;
            if worst <= 1.0 { 1.0 } else { worst.powi(-2) }
        })
        .collect()
}

// ┌ min Σ w |Σ_c b_c v_c − d|² / Σ w + λ Σ |v_{c−1} − 2 v_c + v_{c+1}|² + ρ Σ |v_c|²           ┐
// └ over the control points c, separately for each of the six components, with one matrix      ┘
fn solve(
    grid: Grid,
    samples: &[FieldSample],
    weights: &[f64],
    kept: impl Iterator<Item = usize>,
    smoothness: f64,
) -> Option<TrackerField> {
    let n = grid.count();
    let (mut normal, mut right, mut total) = (Matrix::zeros(n, n), vec![[0.0; 6]; n], 0.0);
    let mut row: Vec<(usize, f64)> = Vec::with_capacity(64);
    for i in kept {
        let (sample, weight) = (&samples[i], weights[i]);
        row.clear();
        grid.weigh(sample.position, |c, w| row.push((c, w)));
        let [a, b, c] = sample.translation.to_array();
        let [d, e, f] = sample.rotation.to_array();
        for &(at, w) in &row {
            for &(other, v) in &row {
                normal[(at, other)] += weight * w * v;
            }
            for (slot, value) in right[at].iter_mut().zip([a, b, c, d, e, f]) {
                *slot += weight * w * value;
            }
        }
        total += weight;
    }
    for_each_triple(&grid, |[a, b, c]| {
        let scale = smoothness * total;
        for (i, x) in [(a, 1.0), (b, -2.0), (c, 1.0)] {
            for (j, y) in [(a, 1.0), (b, -2.0), (c, 1.0)] {
                normal[(i, j)] += scale * x * y;
            }
        }
    });
    for i in 0..n {
        normal[(i, i)] += RIDGE * total;
    }
    let factor = normal.cholesky()?;
    let mut values = vec![(DVec3::ZERO, DVec3::ZERO); n];
    for component in 0..6 {
        let column: Vec<f64> = right.iter().map(|r| r[component]).collect();
        for (slot, x) in values.iter_mut().zip(factor.solve(&column)) {
            match component {
                0..3 => slot.0[component] = x,
                _ => slot.1[component - 3] = x,
            }
        }
    }
    TrackerField::new(grid, values)
}

/// Calls `with` for every three adjacent grid points along an axis.
fn for_each_triple(grid: &Grid, mut with: impl FnMut([usize; 3])) {
    let size = [grid.points(0), grid.points(1), grid.points(2)];
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let at = [x, y, z];
                for axis in 0..3 {
                    if at[axis] == 0 || at[axis] + 1 == size[axis] {
                        continue;
                    }
                    let (mut a, mut c) = (at, at);
                    a[axis] -= 1;
                    c[axis] += 1;
                    with([a, at, c].map(|[x, y, z]| grid.index(x, y, z)));
                }
            }
        }
    }
}
