//! All pairs to the least error, and how sure the result is.

use super::{HandEye, Mounting, PosePair, middle};
use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, NormalEquations, minimise, root_mean_square};

/// A pair departs when it is so many standard deviations off.
const SIGMAS: f64 = 4.0;
/// Departures that are always borne: no tracker is better.
const ALWAYS_GOOD: (f64, f64) = (0.002, 0.001);
/// The median of the length of a normal 3-vector, in σ of a component.
const MEDIAN_LENGTH: f64 = 1.538;

/// Which pairs agree with a mounting, by the spread of all.
pub(super) fn agreeing(pairs: &[PosePair], mounting: &Mounting) -> Vec<bool> {
    let (turn, shift) = scales(pairs.iter(), mounting);
    pairs
        .iter()
        .map(|pair| {
            let (r, p) = mounting.residual(pair);
            r.length() <= (SIGMAS * turn).max(ALWAYS_GOOD.0)
                && p.length() <= (SIGMAS * shift).max(ALWAYS_GOOD.1)
        })
        .collect()
}

/// σ of a component of rotation and position.
fn scales<'a>(pairs: impl Iterator<Item = &'a PosePair> + Clone, m: &Mounting) -> (f64, f64) {
    let turn = middle(pairs.clone().map(|p| m.residual(p).0)) / MEDIAN_LENGTH;
    let shift = middle(pairs.map(|p| m.residual(p).1)) / MEDIAN_LENGTH;
    (turn.max(1e-9), shift.max(1e-9))
}

/// The mounting of least squares over the pairs used, rotations and positions weighed by
/// their own spread.
pub(super) fn refine(pairs: &[PosePair], used: &[bool], start: &Mounting) -> Option<Mounting> {
    let (turn, shift) = scales(kept(pairs, used), start);
    let minimum = minimise(
        *start,
        40,
        |m| Some(linearise(kept(pairs, used), m, turn, shift)),
        moved,
    )?;
    Some(minimum.state)
}

fn kept<'a>(pairs: &'a [PosePair], used: &'a [bool]) -> impl Iterator<Item = &'a PosePair> + Clone {
    pairs
        .iter()
        .zip(used)
        .filter_map(|(p, used)| used.then_some(p))
}

/// Steps: turn of the camera about its own axes, its shift in the sensor's frame, turn of the
/// transmitter about the world's axes, its shift in the world.
fn moved(m: &Mounting, step: &[f64]) -> Mounting {
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
    turn: f64,
    shift: f64,
) -> NormalEquations {
    let mut normal = NormalEquations::new(12);
    let (weight_r, weight_p) = (turn.powi(-2), shift.powi(-2));
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

/// [v]×.
fn cross(v: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, v.z, -v.y),
        DVec3::new(-v.z, 0.0, v.x),
        DVec3::new(v.y, -v.x, 0.0),
    )
}

/// The result with its uncertainty. A tracker's errors are alike from one instant to the
/// next, so that pairs count less than their number: the covariance is widened by the
/// residuals' correlation in time.
pub(super) fn describe(
    pairs: &[PosePair],
    used: Vec<bool>,
    m: &Mounting,
    spread: f64,
) -> Option<HandEye> {
    let residuals: Vec<(DVec3, DVec3)> = kept(pairs, &used).map(|p| m.residual(p)).collect();
    let component = |v: &dyn Fn(&(DVec3, DVec3)) -> DVec3| {
        root_mean_square(residuals.iter().map(|r| v(r).length()))
    };
    let (rotation_rms, position_rms) = (component(&|r| r.0), component(&|r| r.1));
    let share =
        (residuals.len() as f64 * 6.0 / (residuals.len() as f64 * 6.0 - 12.0).max(1.0)).sqrt();
    let sigma = |rms: f64| (share * rms / 3_f64.sqrt()).max(1e-12);
    let normal = linearise(
        kept(pairs, &used),
        m,
        sigma(rotation_rms),
        sigma(position_rms),
    );
    let covariance = normal.hessian.cholesky()?.inverse();
    let turns: Vec<DVec3> = residuals.iter().map(|r| r.0).collect();
    let shifts: Vec<DVec3> = residuals.iter().map(|r| r.1).collect();
    let widen = correlation_time(&turns)
        .max(correlation_time(&shifts))
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
        spread,
    })
}

fn deviation(covariance: &Matrix, i: usize) -> DVec3 {
    let at = |k: usize| covariance[(k, k)].max(0.0).sqrt();
    DVec3::new(at(i), at(i + 1), at(i + 2))
}

/// 1 + 2 Σ ρ(lag), up to where the correlation ρ is lost: so many pairs say as much as one.
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
