//! Levenberg–Marquardt for a few unknowns.

use crate::matrix::Matrix;

/// Damping of the first step.
const FIRST_DAMPING: f64 = 1e-3;
/// Minimum damping.
const MIN_DAMPING: f64 = 1e-12;
/// Damping at which the search ends without a better step.
const MAX_DAMPING: f64 = 1e12;

/// Normal equations of a linearised least-squares problem.
#[derive(Clone, Debug)]
pub struct NormalEquations {
    /// Σ w jᵀ j.
    pub hessian: Matrix,
    /// Σ w jᵀ r.
    pub gradient: Vec<f64>,
    /// Cost: Σ w r², unless set otherwise.
    pub cost: f64,
    /// Number of residuals.
    pub residuals: usize,
}

impl NormalEquations {
    /// Creates the equations of `unknowns` unknowns, without residuals.
    #[must_use]
    pub fn new(unknowns: usize) -> Self {
        Self {
            hessian: Matrix::zeros(unknowns, unknowns),
            gradient: vec![0.0; unknowns],
            cost: 0.0,
            residuals: 0,
        }
    }

    /// Adds a residual with its derivatives by the unknowns (`row`) and its weight.
    pub fn add(&mut self, residual: f64, row: &[f64], weight: f64) {
        self.hessian.add_outer(weight, row, row);
        for (slot, j) in self.gradient.iter_mut().zip(row) {
            *slot += weight * residual * j;
        }
        self.cost += weight * residual * residual;
        self.residuals += 1;
    }

    fn step(&self, damping: f64) -> Option<Vec<f64>> {
        let mut damped = self.hessian.clone();
        for i in 0..damped.rows() {
            damped[(i, i)] += damping * damped[(i, i)].max(1e-12);
        }
        let downhill: Vec<f64> = self.gradient.iter().map(|g| -g).collect();
        Some(damped.cholesky()?.solve(&downhill))
    }
}

/// The result of [`minimise`].
#[derive(Clone, Debug)]
pub struct Minimum<S> {
    /// The unknowns.
    pub state: S,
    /// The normal equations at this state.
    pub normal: NormalEquations,
}

/// When [`descend`] ends, unless no step decreases the cost any more.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// Number of accepted steps.
    pub iterations: usize,
    /// Decrease of the cost in one step, as a share of the cost.
    pub min_gain: f64,
}

/// Minimises a cost from `start` by damped Gauss–Newton steps (Levenberg 1944, Marquardt 1963).
/// `linearise` returns the cost at a state, and whatever `step` needs of it, or `None` at an invalid
/// state. `step` returns the state after a step with a damping, the factor by which the diagonal of
/// the normal equations is increased; `None` if they cannot be solved. Returns `None` if `start` is
/// invalid.
pub fn descend<S, L>(
    start: S,
    stop: Stop,
    mut linearise: impl FnMut(&S) -> Option<(f64, L)>,
    mut step: impl FnMut(&S, &L, f64) -> Option<S>,
) -> Option<(S, L)> {
    let (mut cost, mut here) = linearise(&start)?;
    let (mut state, mut damping) = (start, FIRST_DAMPING);
    for _ in 0..stop.iterations {
        let mut better = None;
        while better.is_none() && damping < MAX_DAMPING {
            better = step(&state, &here, damping)
                .and_then(|s| linearise(&s).map(|(c, l)| (s, c, l)))
                .filter(|(_, c, _)| c.is_finite() && *c <= cost);
            damping *= if better.is_some() { 0.1 } else { 10.0 };
        }
        damping = damping.max(MIN_DAMPING);
        let Some((next, next_cost, at_next)) = better else {
            break;
        };
        let done = cost - next_cost <= stop.min_gain * cost;
        (state, cost, here) = (next, next_cost, at_next);
        if done {
            break;
        }
    }
    Some((state, here))
}

/// Minimises a sum of squares from `start` by [`descend`]. `linearise` returns the normal equations
/// at a state, or `None` at an invalid one; `apply` adds a step to a state. Ends after `iterations`
/// accepted steps, or when the cost decreases by less than 1e-12 of itself. Returns `None` if
/// `start` is invalid.
pub fn minimise<S>(
    start: S,
    iterations: usize,
    linearise: impl Fn(&S) -> Option<NormalEquations>,
    apply: impl Fn(&S, &[f64]) -> S,
) -> Option<Minimum<S>> {
    let stop = Stop {
        iterations,
        min_gain: 1e-12,
    };
    let (state, normal) = descend(
        start,
        stop,
        |s| linearise(s).map(|n| (n.cost, n)),
        |s, n, damping| n.step(damping).map(|step| apply(s, &step)),
    )?;
    Some(Minimum { state, normal })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minimises_rosenbrocks_function() {
        let found = minimise(
            [-1.2, 1.0],
            200,
            |x: &[f64; 2]| {
                let mut normal = NormalEquations::new(2);
                normal.add(1.0 - x[0], &[-1.0, 0.0], 1.0);
                normal.add(10.0 * (x[1] - x[0] * x[0]), &[-20.0 * x[0], 10.0], 1.0);
                Some(normal)
            },
            |x, d| [x[0] + d[0], x[1] + d[1]],
        );
        let x = found.unwrap().state;
        assert!(
            (x[0] - 1.0).abs() < 1e-6 && (x[1] - 1.0).abs() < 1e-6,
            "{x:?}"
        );
    }
}
