//! The rotation between two sets of directions.

use glam::{DQuat, DVec3};
use penumbra_numerics::{Matrix, symmetric_eigen};

/// Returns the rotation that best maps the first directions to the second ones, with weights third
/// (Wahba 1965; the eigenvector of Davenport's 4×4 matrix); `None` where they do not determine it.
pub(super) fn wahba(pairs: &[(DVec3, DVec3, f64)]) -> Option<DQuat> {
    let total: f64 = pairs.iter().map(|p| p.2).sum();
    let mut k = Matrix::zeros(4, 4);
    for (from, to, weight) in pairs {
        let (f, t, w) = (from.to_array(), to.to_array(), weight / total);
        let cross = from.cross(*to).to_array();
        let dot = from.dot(*to);
        for i in 0..3 {
            for j in 0..3 {
                k[(i, j)] -= w * (t[i] * f[j] + f[i] * t[j]);
            }
            k[(i, i)] += w * dot;
            k[(i, 3)] -= w * cross[i];
            k[(3, i)] -= w * cross[i];
        }
        k[(3, 3)] -= w * dot;
    }
    let (values, vectors) = symmetric_eigen(&k);
    let q = vectors.row(0);
    (values[1] - values[0] > 1e-7)
        .then(|| DQuat::from_xyzw(q[0], q[1], q[2], q[3]).normalize())
        .filter(|q| q.is_finite())
}
