//! Least-squares refinement over all pairs, and the uncertainty of the result.

use super::model::{HandEye, Mounting, PosePair, median_length};
use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, NormalEquations, minimise, root_mean_square};

/// A pair is an outlier beyond this number of standard deviations.
const SIGMAS: f64 = 4.0;
/// Residuals that are never outliers, radians and metres: no tracker is more accurate.
const MIN_OUTLIER: (f64, f64) = (0.002, 0.001);
/// The median of the length of a normal 3-vector, in σ of a component.
const MEDIAN_LENGTH: f64 = 1.538;

/// Returns which pairs are consistent with a mounting, relative to the median residual of all.
pub(super) fn consistent(pairs: &[PosePair], mounting: &Mounting) -> Vec<bool> {
    let (rotation, position) = scales(pairs.iter(), mounting);
    pairs
        .iter()
        .map(|pair| {
            let (r, p) = mounting.residual(pair);
            r.length() <= (SIGMAS * rotation).max(MIN_OUTLIER.0)
                && p.length() <= (SIGMAS * position).max(MIN_OUTLIER.1)
        })
        .collect()
}

/// Returns σ of a component of rotation (radians) and position (metres).
fn scales<'a>(pairs: impl Iterator<Item = &'a PosePair> + Clone, m: &Mounting) -> (f64, f64) {
    let rotation = median_length(pairs.clone().map(|p| m.residual(p).0)) / MEDIAN_LENGTH;
    let position = median_length(pairs.map(|p| m.residual(p).1)) / MEDIAN_LENGTH;
    (rotation.max(1e-9), position.max(1e-9))
}

/// Returns the least-squares mounting over the pairs used, rotations and positions weighted by
/// their standard deviations.
pub(super) fn refine(pairs: &[PosePair], used: &[bool], start: &Mounting) -> Option<Mounting> {
    let (rotation, position) = scales(kept(pairs, used), start);
    let minimum = minimise(
        *start,
        40,
        |m| Some(linearise(kept(pairs, used), m, rotation, position)),
        stepped,
    )?;
    Some(minimum.state)
}

fn kept<'a>(pairs: &'a [PosePair], used: &'a [bool]) -> impl Iterator<Item = &'a PosePair> + Clone {
    pairs
        .iter()
        .zip(used)
        .filter_map(|(p, used)| used.then_some(p))
}

/// Applies a step: rotation of the camera about its own axes, its translation in the sensor's
/// frame, rotation of the transmitter about the world's axes, its translation in the world.
fn stepped(m: &Mounting, step: &[f64]) -> Mounting {
    let v = |i: usize| DVec3::new(step[i], step[i + 1], step[i + 2]);
    let (x, z) = (m.sensor_from_camera, m.world_from_transmitter);
    Mounting {
        sensor_from_camera: RigidTransform::new(
            (x.rotation * DQuat::from_scaled_axis(v(0))).normalize(),
            x.translation + v(3),
        ),
        world_from_transmitter: RigidTransform::new(
            (DQuat::from_scaled_axis(v(6)) * z.rotation).normalize(),
            z.translation + v(9),
        ),
    }
}

// ┌ With C = Z B X (Z transmitter, B sensor, X camera), residuals r = log(R_Cᵀ R) and        ┐
// │ p = t − t_C change by  dr = −J(r)⁻¹ (dx + R_Cᵀ dz),  J⁻¹ ≈ 1 + [r]×/2                     │
// └ dp = −(R_Z R_B dX_t + dz × R_Z (R_B X_t + B_t) + dZ_t)                                  ┘
fn linearise<'a>(
    pairs: impl Iterator<Item = &'a PosePair>,
    m: &Mounting,
    rotation: f64,
    position: f64,
) -> NormalEquations {
    let mut normal = NormalEquations::new(12);
    let (weight_r, weight_p) = (rotation.powi(-2), position.powi(-2));
    let z = m.world_from_transmitter;
    for pair in pairs {
        let (r, p) = m.residual(pair);
        let sensor = pair.transmitter_from_sensor;
        let by_tracker = z * sensor * m.sensor_from_camera;
        let inverse_jacobian = -(DMat3::IDENTITY - 0.5 * cross(r));
        let to_camera = DMat3::from_quat(by_tracker.rotation).transpose();
        let (by_x, by_z) = (inverse_jacobian, inverse_jacobian * to_camera);
        let to_world = DMat3::from_quat(z.rotation * sensor.rotation);
        let arm = z.rotation * sensor.transform_point(m.sensor_from_camera.translation);
        let by_arm = cross(arm);
        for axis in 0..3 {
            let mut row = [0.0; 12];
            row[..3].copy_from_slice(&by_x.row(axis).to_array());
            row[6..9].copy_from_slice(&by_z.row(axis).to_array());
            normal.add(r[axis], &row, weight_r);
            let mut row = [0.0; 12];
            row[3..6].copy_from_slice(&(-to_world.row(axis)).to_array());
            row[6..9].copy_from_slice(&by_arm.row(axis).to_array());
            row[9 + axis] = -1.0;
            normal.add(p[axis], &row, weight_p);
        }
    }
    normal
}

/// Returns the cross-product matrix [v]×.
fn cross(v: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, v.z, -v.y),
        DVec3::new(-v.z, 0.0, v.x),
        DVec3::new(v.y, -v.x, 0.0),
    )
}

/// Returns the result with its uncertainty. A tracker's errors are correlated in time, so there
/// are fewer independent pairs than pairs: the covariance is scaled by the correlation time of the
/// residuals.
pub(super) fn describe(
    pairs: &[PosePair],
    used: Vec<bool>,
    m: &Mounting,
    second_axis: f64,
) -> Option<HandEye> {
    let residuals: Vec<(DVec3, DVec3)> = kept(pairs, &used).map(|p| m.residual(p)).collect();
    let component = |v: &dyn Fn(&(DVec3, DVec3)) -> DVec3| {
        root_mean_square(residuals.iter().map(|r| v(r).length()))
    };
    let (rotation_rms, position_rms) = (component(&|r| r.0), component(&|r| r.1));
    let correction =
        (residuals.len() as f64 * 6.0 / (residuals.len() as f64 * 6.0 - 12.0).max(1.0)).sqrt();
    let sigma = |rms: f64| (correction * rms / 3_f64.sqrt()).max(1e-12);
    let normal = linearise(
        kept(pairs, &used),
        m,
        sigma(rotation_rms),
        sigma(position_rms),
    );
    let covariance = normal.hessian.cholesky()?.inverse();
    let rotations: Vec<DVec3> = residuals.iter().map(|r| r.0).collect();
    let positions: Vec<DVec3> = residuals.iter().map(|r| r.1).collect();
    let widen = correlation_time(&rotations)
        .max(correlation_time(&positions))
        .sqrt();
    let at = |i: usize| deviation(&covariance, i) * widen;
    Some(HandEye {
        sensor_from_camera: m.sensor_from_camera,
        world_from_transmitter: m.world_from_transmitter,
        sensor_sigma: (at(0), at(3)),
        transmitter_sigma: (at(6), at(9)),
        rotation_rms,
        position_rms,
        used,
        second_axis,
    })
}

fn deviation(covariance: &Matrix, i: usize) -> DVec3 {
    let at = |k: usize| covariance[(k, k)].max(0.0).sqrt();
    DVec3::new(at(i), at(i + 1), at(i + 2))
}

/// Returns 1 + 2 Σ ρ(lag), summed until the correlation ρ falls below 0.1: the number of successive
/// pairs that are worth one independent pair.
fn correlation_time(v: &[DVec3]) -> f64 {
    let power: f64 = v.iter().map(|x| x.length_squared()).sum();
    if power <= 0.0 {
        return 1.0;
    }
    let mut time = 1.0;
    for lag in 1..v.len() / 4 {
        let product: f64 = v.iter().zip(&v[lag..]).map(|(a, b)| a.dot(*b)).sum();
        let rho = product / power;
        if rho < 0.1 {
            break;
        }
        time += 2.0 * rho;
    }
    time
}
