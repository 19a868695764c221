//! Bundle adjustment: least squares over all reprojection errors, for the lens and all board poses.

use super::board::View;
use super::pose::{by_pose, moved};
use glam::DVec2;
use penumbra_camera::{Lens, MAX_PARAMETERS};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, Stop, descend};

/// Mapping from lens parameters to unknowns; parameters of the same unknown are equal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Unknowns {
    column_of: [Option<usize>; MAX_PARAMETERS],
    count: usize,
}

impl Unknowns {
    /// Creates the unknowns: focal lengths (one if pixels are square), the centre if `centre`, and
    /// the first coefficients.
    pub fn new(square_pixels: bool, centre: bool, coefficients: usize) -> Self {
        let mut column_of = [None; MAX_PARAMETERS];
        let mut count = 0;
        let mut next = || {
            count += 1;
            Some(count - 1)
        };
        column_of[0] = next();
        column_of[1] = if square_pixels { column_of[0] } else { next() };
        if centre {
            column_of[2] = next();
            column_of[3] = next();
        }
        for slot in &mut column_of[4..4 + coefficients] {
            *slot = next();
        }
        Self { column_of, count }
    }

    pub const fn count(&self) -> usize {
        self.count
    }

    /// Returns values per parameter from values per unknown (e.g. a covariance's diagonal).
    pub fn by_parameter(&self, values: impl Fn(usize) -> f64) -> [f64; MAX_PARAMETERS] {
        self.column_of.map(|column| column.map_or(0.0, &values))
    }

    /// Returns derivatives per unknown from derivatives per parameter.
    pub fn gather(&self, by_parameter: &[DVec2; MAX_PARAMETERS], into: &mut [DVec2]) {
        into.fill(DVec2::ZERO);
        for (column, by) in self.column_of.iter().zip(by_parameter) {
            if let Some(column) = column {
                into[*column] += *by;
            }
        }
    }

    fn stepped(&self, lens: &Lens, step: &[f64]) -> Lens {
        let mut parameters = lens.parameters();
        for (value, column) in parameters.iter_mut().zip(self.column_of) {
            *value += column.map_or(0.0, |c| step[c]);
        }
        lens.with_parameters(&parameters)
    }
}

/// State of the minimisation: lens and poses.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub lens: Lens,
    /// `camera_from_board`, one for each view.
    pub poses: Vec<RigidTransform>,
}

/// Loss function of the errors.
#[derive(Clone, Copy, Debug)]
pub(super) enum Loss {
    /// Squared error.
    Squares,
    /// Cauchy loss: s² ln(1 + e²/s²), s in pixels.
    Cauchy(f64),
}

impl Loss {
    /// Returns cost and weight of a squared error.
    fn cost_and_weight(self, square: f64) -> (f64, f64) {
        match self {
            Self::Squares => (square, 1.0),
            Self::Cauchy(s) => {
                let ratio = square / (s * s);
                (s * s * ratio.ln_1p(), 1.0 / (1.0 + ratio))
            }
        }
    }
}

/// The views and which of their points are used.
pub(super) struct Bundle<'a> {
    pub views: &'a [&'a View],
    pub used: &'a [Vec<bool>],
    pub unknowns: Unknowns,
    pub loss: Loss,
}

/// Normal equations with one block per pose.
pub(super) struct Linearised {
    lens: Matrix,
    lens_gradient: Vec<f64>,
    poses: Vec<PoseBlock>,
    pub cost: f64,
    /// Number of points used.
    pub points: usize,
}

struct PoseBlock {
    own: Matrix,
    /// Block between lens and pose.
    cross: Matrix,
    gradient: [f64; 6],
    lens_gradient: Vec<f64>,
}

/// The equations of the lens after elimination of the poses.
pub(super) struct Reduced {
    pub matrix: Matrix,
    pub gradient: Vec<f64>,
    /// Each view's contribution to the gradient.
    pub by_view: Vec<Vec<f64>>,
}

impl Bundle<'_> {
    /// Minimises the cost from `state`; `None` if the cost of `state` is undefined.
    pub fn minimise(&self, state: State, iterations: usize) -> Option<(State, Linearised)> {
        let stop = Stop {
            iterations,
            min_gain: 1e-10,
        };
        descend(
            state,
            stop,
            |state| self.linearise(state).map(|l| (l.cost, l)),
            |state, at, damping| self.stepped(state, at, damping),
        )
    }

    pub fn linearise(&self, state: &State) -> Option<Linearised> {
        let n = self.unknowns.count();
        let mut out = Linearised {
            lens: Matrix::zeros(n, n),
            lens_gradient: vec![0.0; n],
            poses: Vec::with_capacity(self.views.len()),
            cost: 0.0,
            points: 0,
        };
        let mut by_lens = vec![DVec2::ZERO; n];
        let mut row = vec![0.0; n];
        for (i, view) in self.views.iter().enumerate() {
            let mut block = PoseBlock {
                own: Matrix::zeros(6, 6),
                cross: Matrix::zeros(n, 6),
                gradient: [0.0; 6],
                lens_gradient: vec![0.0; n],
            };
            for (c, _) in view
                .points
                .iter()
                .zip(&self.used[i])
                .filter(|(_, used)| **used)
            {
                let arm = state.poses[i].rotation * c.point.extend(0.0);
                let p = state
                    .lens
                    .project_with_derivatives(arm + state.poses[i].translation)?;
                let error = p.pixel - c.pixel;
                let (cost, weight) = self.loss.cost_and_weight(error.length_squared());
                let by_pose = by_pose(&p.by_point, arm);
                self.unknowns.gather(&p.by_parameter, &mut by_lens);
                for axis in 0..2 {
                    row.iter_mut().zip(&by_lens).for_each(|(r, d)| *r = d[axis]);
                    let pose_row = by_pose.map(|d| d[axis]);
                    out.lens.add_outer(weight, &row, &row);
                    block.cross.add_outer(weight, &row, &pose_row);
                    block.own.add_outer(weight, &pose_row, &pose_row);
                    let weighted = weight * error[axis];
                    add_scaled(&mut block.lens_gradient, weighted, &row);
                    add_scaled(&mut block.gradient, weighted, &pose_row);
                }
                out.cost += cost;
                out.points += 1;
            }
            add_scaled(&mut out.lens_gradient, 1.0, &block.lens_gradient);
            out.poses.push(block);
        }
        Some(out)
    }

    fn stepped(&self, state: &State, at: &Linearised, damping: f64) -> Option<State> {
        let reduced = at.reduced(damping)?;
        let lens_step = reduced
            .matrix
            .cholesky()?
            .solve(&negative(&reduced.gradient));
        let lens = self.unknowns.stepped(&state.lens, &lens_step);
        let poses = state.poses.iter().zip(&at.poses).map(|(pose, block)| {
            let mut right = negative(&block.gradient);
            let eliminated = block.cross.transposed().times_vector(&lens_step);
            add_scaled(&mut right, -1.0, &eliminated);
            Some(moved(
                *pose,
                &damped(&block.own, damping).cholesky()?.solve(&right),
            ))
        });
        let is_plausible = lens.focal.min_element() > 1.0 && lens.focal.max_element() < 1e6;
        is_plausible.then_some(State {
            lens,
            poses: poses.collect::<Option<_>>()?,
        })
    }
}

impl Linearised {
    // ┌ [A  B][l]   [a]                                                                     ┐
    // │ [Bᵀ C][p] = [c]  ⇒  (A − B C⁻¹ Bᵀ) l = a − B C⁻¹ c,  C block-diagonal by view        │
    // └ (Schur complement; Triggs et al. 2000, section 6.1)                                ┘
    pub fn reduced(&self, damping: f64) -> Option<Reduced> {
        let mut matrix = damped(&self.lens, damping);
        let mut gradient = vec![0.0; self.lens.rows()];
        let mut by_view = Vec::with_capacity(self.poses.len());
        for block in &self.poses {
            let own = damped(&block.own, damping).cholesky()?;
            for i in 0..self.lens.rows() {
                let solved = own.solve(block.cross.row(i));
                let column = block.cross.times_vector(&solved);
                for (j, value) in column.into_iter().enumerate() {
                    matrix[(i, j)] -= value;
                }
            }
            let mut share = block.lens_gradient.clone();
            let eliminated = block.cross.times_vector(&own.solve(&block.gradient));
            add_scaled(&mut share, -1.0, &eliminated);
            add_scaled(&mut gradient, 1.0, &share);
            by_view.push(share);
        }
        Some(Reduced {
            matrix,
            gradient,
            by_view,
        })
    }
}

fn damped(matrix: &Matrix, damping: f64) -> Matrix {
    let mut out = matrix.clone();
    for i in 0..out.rows() {
        out[(i, i)] += damping * out[(i, i)];
    }
    out
}

fn negative(v: &[f64]) -> Vec<f64> {
    v.iter().map(|x| -x).collect()
}

fn add_scaled(to: &mut [f64], factor: f64, v: &[f64]) {
    for (slot, value) in to.iter_mut().zip(v) {
        *slot += factor * value;
    }
}
