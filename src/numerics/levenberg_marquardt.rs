//! Levenberg–Marquardt for a handful of unknowns.

use super::Matrix;

/// Damping beyond which no step helps any more.
const MOST_DAMPING: f64 = 1e12;

/// Normal equations of a linearised least-squares problem.
#[derive(Clone, Debug)]
pub struct NormalEquations {
    /// Σ w jᵀ j.
    pub hessian: Matrix,
    /// Σ w jᵀ r.
    pub gradient: Vec<f64>,
    /// Σ of what [`NormalEquations::add`] was told a residual costs.
    pub cost: f64,
    /// Residuals counted.
    pub residuals: usize,
}

impl NormalEquations {
    /// Of so many unknowns, without residuals.
    #[must_use]
    pub fn new(unknowns: usize) -> Self {
        Self {
            hessian: Matrix::zeros(unknowns, unknowns),
            gradient: vec![0.0; unknowns],
            cost: 0.0,
            residuals: 0,
        }
    }

    /// Adds a residual, its derivatives by the unknowns and its weight.
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

/// Where the search ended.
#[derive(Clone, Debug)]
pub struct Minimum<S> {
    /// The unknowns.
    pub state: S,
    /// The problem linearised there.
    pub normal: NormalEquations,
}

/// Minimises the cost that `linearise` finds at a state, by steps of `unknowns` numbers that
/// `apply` takes (Marquardt 1963). `linearise` gives `None` where a state makes no sense; a
/// start of that kind gives `None`.
pub fn minimise<S: Clone>(
    start: S,
    iterations: usize,
    linearise: impl Fn(&S) -> Option<NormalEquations>,
    apply: impl Fn(&S, &[f64]) -> S,
) -> Option<Minimum<S>> {
    let mut normal = linearise(&start)?;
    let (mut state, mut damping) = (start, 1e-3);
    for _ in 0..iterations {
        let mut better = None;
        while damping < MOST_DAMPING {
            let tried = normal.step(damping).map(|step| apply(&state, &step));
            let tried = tried.and_then(|s| linearise(&s).map(|n| (s, n)));
            match tried.filter(|(_, n)| n.cost.is_finite() && n.cost <= normal.cost) {
                Some(found) => {
                    better = Some(found);
                    break;
                }
                None => damping *= 10.0,
            }
        }
        let Some((next, at_next)) = better else { break };
        let gain = normal.cost - at_next.cost;
        let done = gain <= 1e-12 * normal.cost;
        (state, normal) = (next, at_next);
        damping = (damping * 0.1).max(1e-12);
        if done {
            break;
        }
    }
    Some(Minimum { state, normal })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn rosenbrocks_valley_is_walked_to_its_end() {
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
