//! Normal equations of tags and cameras with the cameras eliminated (Schur complement).
//!
//! ```text
//!  | A  W | |c|   |a|      (U − Wᵀ A⁻¹ W) t = b − Wᵀ A⁻¹ a,    c = A⁻¹ (a − W t)
//!  | Wᵀ U | |t| = |b|      A is block diagonal: cameras are independent of one another
//! ```

use penumbra_numerics::Matrix;

/// Number of unknowns of a tag: rotation, translation, scale.
pub(super) const TAG_UNKNOWNS: usize = 7;

type SixBySeven = [[f64; TAG_UNKNOWNS]; 6];

/// The normal equations of one view: A, a, and the blocks of its tags.
#[derive(Clone, Debug, Default)]
pub(super) struct Block {
    camera: [[f64; 6]; 6],
    right: [f64; 6],
    tags: Vec<TagBlock>,
}

/// A view's blocks for one tag: W, U, b.
#[derive(Clone, Debug)]
struct TagBlock {
    /// Number of the tag among the tags with unknowns.
    number: usize,
    coupling: SixBySeven,
    own: [[f64; TAG_UNKNOWNS]; TAG_UNKNOWNS],
    right: [f64; TAG_UNKNOWNS],
}

impl Block {
    /// Adds a residual with its weight and its derivatives by the camera's unknowns and by those of
    /// a tag, unless the tag is fixed.
    pub fn add(
        &mut self,
        residual: f64,
        weight: f64,
        by_camera: &[f64; 6],
        by_tag: Option<(usize, [f64; TAG_UNKNOWNS])>,
    ) {
        for (i, x) in by_camera.iter().enumerate() {
            self.right[i] -= weight * x * residual;
            for (j, y) in by_camera.iter().enumerate() {
                self.camera[i][j] += weight * x * y;
            }
        }
        let Some((number, by_tag)) = by_tag else {
            return;
        };
        let existing = self.tags.iter().position(|t| t.number == number);
        let at = existing.unwrap_or_else(|| {
            self.tags.push(TagBlock {
                number,
                coupling: [[0.0; TAG_UNKNOWNS]; 6],
                own: [[0.0; TAG_UNKNOWNS]; TAG_UNKNOWNS],
                right: [0.0; TAG_UNKNOWNS],
            });
            self.tags.len() - 1
        });
        let TagBlock {
            coupling,
            own,
            right,
            ..
        } = &mut self.tags[at];
        for (j, y) in by_tag.iter().enumerate() {
            right[j] -= weight * y * residual;
            for (i, x) in by_camera.iter().enumerate() {
                coupling[i][j] += weight * x * y;
            }
            for (k, z) in by_tag.iter().enumerate() {
                own[j][k] += weight * y * z;
            }
        }
    }
}

/// The reduced equations of the tags, and the back-substitution for the cameras.
pub(super) struct Reduced {
    matrix: Matrix,
    right: Vec<f64>,
    /// The solution of each view's camera; `None` without a camera pose.
    cameras: Vec<Option<CameraSolution>>,
}

/// The solution of a camera as a function of the tags' steps t: A⁻¹ a − A⁻¹ W t.
struct CameraSolution {
    /// A⁻¹ a.
    constant: [f64; 6],
    /// A⁻¹ W by tag.
    by_tag: Vec<(usize, SixBySeven)>,
}

impl Reduced {
    /// Creates the equations of `tags` tags, without views.
    pub fn new(tags: usize, views: usize) -> Self {
        Self {
            matrix: Matrix::zeros(tags * TAG_UNKNOWNS, tags * TAG_UNKNOWNS),
            right: vec![0.0; tags * TAG_UNKNOWNS],
            cameras: Vec::with_capacity(views),
        }
    }

    /// Adds a view without a camera pose.
    pub fn skip_view(&mut self) {
        self.cameras.push(None);
    }

    /// Adds a view and eliminates its camera; `None` if it does not determine the camera's pose.
    pub fn eliminate(&mut self, block: Block, damping: f64) -> Option<()> {
        let mut camera = Matrix::zeros(6, 6);
        for (i, row) in block.camera.iter().enumerate() {
            for (j, x) in row.iter().enumerate() {
                camera[(i, j)] = *x;
            }
            camera[(i, i)] += damping * row[i].max(1e-12);
        }
        let factor = camera.cholesky()?;
        let mut constant = [0.0; 6];
        constant.copy_from_slice(&factor.solve(&block.right));
        let mut by_tag: Vec<(usize, SixBySeven)> = Vec::with_capacity(block.tags.len());
        for TagBlock {
            number, coupling, ..
        } in &block.tags
        {
            let mut solved = [[0.0; TAG_UNKNOWNS]; 6];
            for j in 0..TAG_UNKNOWNS {
                let column: Vec<f64> = coupling.iter().map(|row| row[j]).collect();
                for (row, x) in solved.iter_mut().zip(factor.solve(&column)) {
                    row[j] = x;
                }
            }
            by_tag.push((*number, solved));
        }
        for tag in &block.tags {
            let base = tag.number * TAG_UNKNOWNS;
            for j in 0..TAG_UNKNOWNS {
                let coupling: [f64; 6] = std::array::from_fn(|i| tag.coupling[i][j]);
                self.right[base + j] += tag.right[j] - dot(&coupling, &constant);
                for (k, own) in tag.own[j].iter().enumerate() {
                    self.matrix[(base + j, base + k)] += own;
                }
                for (other, solved) in &by_tag {
                    for (i, row) in solved.iter().enumerate() {
                        for (k, x) in row.iter().enumerate() {
                            self.matrix[(base + j, other * TAG_UNKNOWNS + k)] -= coupling[i] * x;
                        }
                    }
                }
            }
        }
        self.cameras.push(Some(CameraSolution { constant, by_tag }));
        Some(())
    }

    /// Adds a prior of this weight on an unknown that deviates from it by `deviation`.
    pub fn add_prior(&mut self, unknown: usize, deviation: f64, weight: f64) {
        self.matrix[(unknown, unknown)] += weight;
        self.right[unknown] -= weight * deviation;
    }

    /// Returns the steps of the tags' unknowns in order, and of each view's camera; `None` if the
    /// damped equations are singular.
    pub fn solve(&self, damping: f64) -> Option<(Vec<f64>, Vec<[f64; 6]>)> {
        let mut damped = self.matrix.clone();
        for i in 0..damped.rows() {
            damped[(i, i)] += damping * damped[(i, i)].abs().max(1e-12);
        }
        let tags = damped.cholesky()?.solve(&self.right);
        let camera = |solution: &Option<CameraSolution>| {
            let Some(solution) = solution else {
                return [0.0; 6];
            };
            let mut step = solution.constant;
            for (number, solved) in &solution.by_tag {
                let tag_step = &tags[number * TAG_UNKNOWNS..(number + 1) * TAG_UNKNOWNS];
                for (slot, row) in step.iter_mut().zip(solved) {
                    *slot -= row.iter().zip(tag_step).map(|(a, b)| a * b).sum::<f64>();
                }
            }
            step
        };
        let cameras = self.cameras.iter().map(camera).collect();
        Some((tags, cameras))
    }

    /// Returns the covariance of the tags' unknowns for residuals of variance 1; `None` if they are
    /// undetermined.
    pub fn covariance(&self) -> Option<Matrix> {
        Some(self.matrix.cholesky()?.inverse())
    }
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
