//! Normal equations of tags and cameras with the cameras eliminated (Schur complement).
//!
//! ```text
//!  | A  W | |c|   |a|      (U − Wᵀ A⁻¹ W) t = b − Wᵀ A⁻¹ a,    c = A⁻¹ (a − W t)
//!  | Wᵀ U | |t| = |b|      A is block diagonal: cameras are independent of one another
//! ```

use penumbra_numerics::Matrix;

/// Unknowns of a tag: rotation, translation, scale.
pub(super) const OF_TAG: usize = 7;

type SixBySeven = [[f64; OF_TAG]; 6];

/// The normal equations of one view.
#[derive(Clone, Debug, Default)]
pub(super) struct Block {
    camera: [[f64; 6]; 6],
    right: [f64; 6],
    tags: Vec<OfTag>,
}

/// A view's blocks for one tag: W, U, b.
#[derive(Clone, Debug)]
struct OfTag {
    number: usize,
    across: SixBySeven,
    own: [[f64; OF_TAG]; OF_TAG],
    right: [f64; OF_TAG],
}

impl Block {
    /// A residual with its weight and derivatives.
    pub fn add(
        &mut self,
        off: f64,
        weight: f64,
        by_camera: &[f64; 6],
        by_tag: Option<(usize, [f64; OF_TAG])>,
    ) {
        for (i, x) in by_camera.iter().enumerate() {
            self.right[i] -= weight * x * off;
            for (j, y) in by_camera.iter().enumerate() {
                self.camera[i][j] += weight * x * y;
            }
        }
        let Some((number, by_tag)) = by_tag else {
            return;
        };
        let known = self.tags.iter().position(|t| t.number == number);
        let at = known.unwrap_or_else(|| {
            self.tags.push(OfTag {
                number,
                across: [[0.0; OF_TAG]; 6],
                own: [[0.0; OF_TAG]; OF_TAG],
                right: [0.0; OF_TAG],
            });
            self.tags.len() - 1
        });
        let OfTag {
            across, own, right, ..
        } = &mut self.tags[at];
        for (j, y) in by_tag.iter().enumerate() {
            right[j] -= weight * y * off;
            for (i, x) in by_camera.iter().enumerate() {
                across[i][j] += weight * x * y;
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
    /// A⁻¹ a, and A⁻¹ W by tag, of each view.
    cameras: Vec<Option<Follows>>,
}

struct Follows {
    alone: [f64; 6],
    by_tag: Vec<(usize, SixBySeven)>,
}

impl Reduced {
    pub fn new(tags: usize, views: usize) -> Self {
        Self {
            matrix: Matrix::zeros(tags * OF_TAG, tags * OF_TAG),
            right: vec![0.0; tags * OF_TAG],
            cameras: Vec::with_capacity(views),
        }
    }

    /// Adds a view without a camera pose.
    pub fn skip(&mut self) {
        self.cameras.push(None);
    }

    /// Adds a view; `None` if it does not determine its camera.
    pub fn eliminate(&mut self, block: Block, damping: f64) -> Option<()> {
        let mut camera = Matrix::zeros(6, 6);
        for (i, row) in block.camera.iter().enumerate() {
            for (j, x) in row.iter().enumerate() {
                camera[(i, j)] = *x;
            }
            camera[(i, i)] += damping * row[i].max(1e-12);
        }
        let factor = camera.cholesky()?;
        let mut alone = [0.0; 6];
        alone.copy_from_slice(&factor.solve(&block.right));
        let mut by_tag: Vec<(usize, SixBySeven)> = Vec::with_capacity(block.tags.len());
        for OfTag { number, across, .. } in &block.tags {
            let mut solved = [[0.0; OF_TAG]; 6];
            for j in 0..OF_TAG {
                let column: Vec<f64> = across.iter().map(|row| row[j]).collect();
                for (row, x) in solved.iter_mut().zip(factor.solve(&column)) {
                    row[j] = x;
                }
            }
            by_tag.push((*number, solved));
        }
        for tag in &block.tags {
            let base = tag.number * OF_TAG;
            for j in 0..OF_TAG {
                let across: [f64; 6] = std::array::from_fn(|i| tag.across[i][j]);
                self.right[base + j] += tag.right[j] - dot(&across, &alone);
                for (k, own) in tag.own[j].iter().enumerate() {
                    self.matrix[(base + j, base + k)] += own;
                }
                for (other, solved) in &by_tag {
                    for (i, row) in solved.iter().enumerate() {
                        for (k, x) in row.iter().enumerate() {
                            self.matrix[(base + j, other * OF_TAG + k)] -= across[i] * x;
                        }
                    }
                }
            }
        }
        self.cameras.push(Some(Follows { alone, by_tag }));
        Some(())
    }

    /// Adds a prior of this weight on an unknown that deviates from it by `off`.
    pub fn hold(&mut self, unknown: usize, off: f64, weight: f64) {
        self.matrix[(unknown, unknown)] += weight;
        self.right[unknown] -= weight * off;
    }

    /// Returns the steps of the tags' unknowns in order, and of each view's camera.
    pub fn solve(&self, damping: f64) -> Option<(Vec<f64>, Vec<[f64; 6]>)> {
        let mut damped = self.matrix.clone();
        for i in 0..damped.rows() {
            damped[(i, i)] += damping * damped[(i, i)].abs().max(1e-12);
        }
        let tags = damped.cholesky()?.solve(&self.right);
        let camera = |follows: &Option<Follows>| {
            let Some(follows) = follows else {
                return [0.0; 6];
            };
            let mut step = follows.alone;
            for (number, solved) in &follows.by_tag {
                let of_tag = &tags[number * OF_TAG..(number + 1) * OF_TAG];
                for (slot, row) in step.iter_mut().zip(solved) {
                    *slot -= row.iter().zip(of_tag).map(|(a, b)| a * b).sum::<f64>();
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
