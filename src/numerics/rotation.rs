//! Rotations: their vectors, and the best one between two sets of vectors.

use crate::{Matrix, symmetric_eigen};
use glam::{DQuat, DVec3};

/// Returns the rotation vector (axis times angle, radians) of a unit quaternion; the angle is at
/// most π.
#[must_use]
pub fn rotation_vector(rotation: DQuat) -> DVec3 {
    // q and −q are the same rotation; that with w ≥ 0 has the smaller angle.
    let shortest = if rotation.w < 0.0 {
        -rotation
    } else {
        rotation
    };
    shortest.to_scaled_axis()
}

/// The result of [`best_rotation`].
#[derive(Clone, Copy, Debug)]
pub struct BestRotation {
    /// The rotation.
    pub rotation: DQuat,
    /// Distance of the best solution from the second best, as a share of the largest value that the
    /// weighted sum of dot products can have: zero where the vectors do not determine the rotation.
    pub margin: f64,
}

/// Returns the rotation that best maps the first vector of each pair to the second, with weights
/// third, in the sense of least squares (Wahba 1965): the eigenvector of Davenport's 4×4 matrix.
/// `None` without pairs or with vectors of length zero alone.
#[must_use]
pub fn best_rotation(pairs: impl IntoIterator<Item = (DVec3, DVec3, f64)>) -> Option<BestRotation> {
    let mut k = Matrix::zeros(4, 4);
    let mut total = 0.0;
    for (from, to, weight) in pairs {
        let (f, t) = (from.to_array(), to.to_array());
        let cross = (weight * from.cross(to)).to_array();
        let dot = weight * from.dot(to);
        for i in 0..3 {
            for j in 0..3 {
                k[(i, j)] += weight * (t[i] * f[j] + f[i] * t[j]);
            }
            k[(i, i)] -= dot;
            k[(i, 3)] += cross[i];
            k[(3, i)] += cross[i];
        }
        k[(3, 3)] += dot;
        total += weight * from.length() * to.length();
    }
    let (values, vectors) = symmetric_eigen(&k);
    let [x, y, z, w] = *vectors.row(3) else {
        return None;
    };
    let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
    (total > 0.0 && rotation.is_finite()).then(|| BestRotation {
        rotation,
        margin: (values[3] - values[2]) / total,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn best_rotation_maps_vectors_and_tells_ambiguity() {
        let truth = DQuat::from_scaled_axis(DVec3::new(0.3, -1.2, 2.0));
        let pair = |v: DVec3| (v, truth * v, 2.0);
        let found = best_rotation([pair(DVec3::X), pair(DVec3::new(0.0, 3.0, 1.0))]).unwrap();
        assert!(found.rotation.angle_between(truth) < 1e-9);
        assert!(found.margin > 0.1);
        let one = best_rotation([pair(DVec3::X)]).unwrap();
        assert!((one.rotation * DVec3::X).distance(truth * DVec3::X) < 1e-9);
        assert!(one.margin < 1e-12);
        assert!(best_rotation([]).is_none());
    }
}
