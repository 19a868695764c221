//! Learns a [`TrackerField`] from what markers say beside what the tracker reads.

use glam::DVec3;
use penumbra_numerics::{Matrix, median, root_mean_square};
use penumbra_rig_model::tracker_field::{Grid, TrackerField};

/// Cells along the longest side of the volume.
const CELLS: f64 = 3.0;
/// No cell is smaller, metres.
const LEAST_SPACING: f64 = 0.05;
/// How much a bend costs, against a sample's misfit.
const SMOOTHNESS: [f64; 5] = [1.0, 0.1, 0.01, 1e-3, 1e-4];
/// And how much any correction does, so that corners without samples stay as they are.
const RIDGE: f64 = 1e-5;
/// Parts of which one at a time is held out, and stretches of time that they are made of.
const FOLDS: usize = 5;
const STRETCHES: usize = 25;
/// Fewest samples.
const LEAST: usize = 60;
/// Misfits beyond so many times the median count less.
const ROBUST: f64 = 3.0;
/// It must take away so much of what is held out, to be believed.
const GAIN: f64 = 0.9;

/// A reading, and what it should have been.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FieldSample {
    /// Where the tracker read it, metres.
    pub place: DVec3,
    /// By what the truth departs, metres and rotation vector (transmitter's axes).
    pub shift: DVec3,
    pub turn: DVec3,
}

/// A map and what it is worth: root mean square of what is held out, metres and radians.
#[derive(Clone, Debug)]
pub(super) struct FieldFit {
    pub field: TrackerField,
    pub before: (f64, f64),
    pub after: (f64, f64),
}

impl FieldFit {
    /// It helps where it was not learnt.
    pub fn helps(&self) -> bool {
        let place = self.after.0 / self.before.0.max(1e-12);
        let turn = self.after.1 / self.before.1.max(1e-12);
        place.min(turn) < GAIN && place.max(turn) < 1.05
    }
}

/// Samples in the order of time.
pub(super) fn fit(samples: &[FieldSample]) -> Option<FieldFit> {
    if samples.len() < LEAST {
        return None;
    }
    let grid = grid_of(samples);
    let weights = robust_weights(samples);
    let stretch = samples.len().div_ceil(STRETCHES);
    let fold = |i: usize| (i / stretch) % FOLDS;
    let before = misfit(samples.iter().zip(&weights), |_| (DVec3::ZERO, DVec3::ZERO));
    let mut best: Option<(f64, f64, (f64, f64))> = None;
    for smoothness in SMOOTHNESS {
        let mut held_out = Vec::with_capacity(samples.len());
        for part in 0..FOLDS {
            let kept = (0..samples.len()).filter(|i| fold(*i) != part);
            let field = solve(grid, samples, &weights, kept, smoothness)?;
            let out = (0..samples.len()).filter(|i| fold(*i) == part);
            held_out.extend(out.map(|i| {
                let (shift, turn) = field.at(samples[i].place);
                let left = FieldSample {
                    place: samples[i].place,
                    shift: samples[i].shift - shift,
                    turn: samples[i].turn - turn,
                };
                (left, weights[i])
            }));
        }
        let pairs = held_out.iter().map(|(s, w)| (s, w));
        let after = misfit(pairs, |_| (DVec3::ZERO, DVec3::ZERO));
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

fn misfit<'a>(
    samples: impl Iterator<Item = (&'a FieldSample, &'a f64)> + Clone,
    said: impl Fn(DVec3) -> (DVec3, DVec3),
) -> (f64, f64) {
    let trusted = samples.filter(|(_, w)| **w > 0.99);
    let place = trusted
        .clone()
        .map(|(s, _)| (s.shift - said(s.place).0).length());
    let turn = trusted.map(|(s, _)| (s.turn - said(s.place).1).length());
    (root_mean_square(place), root_mean_square(turn))
}

fn grid_of(samples: &[FieldSample]) -> Grid {
    let places = || samples.iter().map(|s| s.place);
    let low = places().fold(DVec3::MAX, DVec3::min) - 0.01;
    let high = places().fold(DVec3::MIN, DVec3::max) + 0.01;
    let size = high - low;
    let spacing = (size.max_element() / CELLS).max(LEAST_SPACING);
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

/// Axis by axis.
fn middle(values: impl Iterator<Item = DVec3> + Clone) -> DVec3 {
    let of = |axis: usize| median(values.clone().map(|v| v[axis])).unwrap_or(0.0);
    DVec3::new(of(0), of(1), of(2))
}

/// By how far a sample departs from its neighbours in time: a flipped pose or a jump does.
fn robust_weights(samples: &[FieldSample]) -> Vec<f64> {
    let n = samples.len();
    let off: Vec<(f64, f64)> = (0..n)
        .map(|i| {
            let near = &samples[i.saturating_sub(7)..(i + 8).min(n)];
            (
                samples[i]
                    .shift
                    .distance(middle(near.iter().map(|s| s.shift))),
                samples[i]
                    .turn
                    .distance(middle(near.iter().map(|s| s.turn))),
            )
        })
        .collect();
    let usual = (
        median(off.iter().map(|o| o.0)).unwrap_or(0.0).max(1e-4),
        median(off.iter().map(|o| o.1)).unwrap_or(0.0).max(1e-4),
    );
    off.iter()
        .map(|(shift, turn)| {
            let worst = (shift / usual.0).max(turn / usual.1) / ROBUST;
            if worst <= 1.0 { 1.0 } else { worst.powi(-2) }
        })
        .collect()
}

// ┌ min Σ w |Σ_c b_c v_c − d|² / Σ w + λ Σ |v_{c−1} − 2 v_c + v_{c+1}|² + ρ Σ |v_c|²           ┐
// └ over the control points c, for each of the six components alike: one matrix               ┘
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
        grid.weigh(sample.place, |c, w| row.push((c, w)));
        let [a, b, c] = sample.shift.to_array();
        let [d, e, f] = sample.turn.to_array();
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
    bends(&grid, |[a, b, c]| {
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

/// Every three neighbours in a row along an axis.
fn bends(grid: &Grid, mut with: impl FnMut([usize; 3])) {
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
