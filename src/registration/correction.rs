//! Estimates the tracker's error from markers.
//!
//! An error-state Kalman filter. The state is a rigid correction C with
//! `world_from_camera` = C · tracked; its error is a small rotation θ and a translation p of the
//! camera's position, in world axes about the camera (Solà 2017, "Quaternion kinematics for the
//! error-state Kalman filter", global errors). When the camera moves by d, the same correction
//! translates it by p + θ × d. The tracker drifts with time, and the distortion of an
//! electromagnetic field depends on the position: the covariance grows with time, distance and
//! rotation.

use crate::motion::{difference, moved};
use glam::{DMat3, DVec3};
use penumbra_fiducials::PoseEstimate;
use penumbra_interface::RigidTransform;
use penumbra_numerics::fixed_size::{Matrix, inverse};

/// Standard deviations before the first marker: rotation (radians), position (metres).
const INITIAL_SIGMA: [f64; 2] = [0.2, 0.2];
/// Growth of the variances (rad², m²) per second: drift of 0.02° and 0.2 mm in a second.
const VARIANCE_PER_SECOND: [f64; 2] = [1.2e-7, 4e-8];
/// Growth of the variances per metre of path: 0.5° and 3 mm after 0.3 m.
const VARIANCE_PER_METRE: [f64; 2] = [2.5e-4, 3e-5];
/// Growth of the variances per radian of rotation: 0.3° and 1 mm after a radian.
const VARIANCE_PER_RADIAN: [f64; 2] = [2.7e-5, 1e-6];
/// Standard deviation of the time offset of tracker and picture, seconds. It only matters while the
/// camera moves.
const TIMING_SIGMA_SECONDS: f64 = 0.002;
/// Standard deviations of a marker pose beside the corners' noise, by prints that are not flat and
/// imperfect lens calibration: rotation (radians), position (metres). Small, because errors of
/// rotation and position by corners are correlated, and these are not.
const MARKER_SIGMA: [f64; 2] = [5e-5, 5e-5];
/// Factor of the variances estimated from the scatter of the corners, whose errors are correlated.
const CORNER_CORRELATION: f64 = 4.0;
/// Gate of the squared Mahalanobis distance: χ² of six degrees of freedom at a probability of 1e-5.
const GATE: f64 = 33.1;
/// Number of successive consistent outliers that reset the filter.
const MIN_CONSISTENT_OUTLIERS: u32 = 8;

/// The camera's pose by the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerPose {
    /// `world_from_camera`.
    pub world_from_camera: RigidTransform,
    /// Standard deviations of the noise per axis: metres, radians. Systematic errors are estimated
    /// from markers and not included.
    pub noise: [f64; 2],
}

/// Assessment of a pose by markers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkerAssessment {
    /// The picture shows no markers.
    NoMarkers,
    /// The pose corrects the tracker.
    Accepted,
    /// The pose was rejected as an outlier.
    Rejected,
    /// The pose is consistent with the outliers before it and resets the correction.
    Reset,
}

/// The filter's state.
#[derive(Clone, Debug)]
pub(super) struct Correction {
    /// C: `world_from_tracked_world`.
    corrected_from_tracked: RigidTransform,
    covariance: Matrix<6>,
    /// Covariance of this picture's pose, including the tracker's noise.
    pose_covariance: Matrix<6>,
    /// C of the last outlier, and the number of successive consistent outliers.
    outlier: Option<(RigidTransform, u32)>,
    /// Speed of the tracked camera: metres and radians per second.
    speed: [f64; 2],
}

impl Correction {
    pub const fn new() -> Self {
        let mut covariance = [[0.0; 6]; 6];
        let mut i = 0;
        while i < 6 {
            covariance[i][i] = INITIAL_SIGMA[i / 3] * INITIAL_SIGMA[i / 3];
            i += 1;
        }
        Self {
            corrected_from_tracked: RigidTransform::IDENTITY,
            covariance,
            pose_covariance: covariance,
            outlier: None,
            speed: [0.0; 2],
        }
    }

    /// Returns C · tracked.
    pub fn apply(&self, tracked: RigidTransform) -> RigidTransform {
        self.corrected_from_tracked * tracked
    }

    /// Size of the correction: metres at the camera, radians.
    pub fn size_at(&self, tracked: RigidTransform) -> [f64; 2] {
        let (rotation, translation) = difference(&tracked, &self.apply(tracked));
        [translation.length(), rotation.length()]
    }

    /// Covariance of the last returned pose (rotation vector, camera's position; world axes).
    pub const fn pose_covariance(&self) -> &Matrix<6> {
        &self.pose_covariance
    }

    /// Covariance of the corrected pose, including the tracker's noise.
    fn covariance_with(&self, noise: [f64; 2]) -> Matrix<6> {
        with_diagonal(self.covariance, [noise[1].powi(2), noise[0].powi(2)])
    }

    /// Propagates the covariance over `seconds` in which the tracked camera moves from one pose to
    /// another.
    pub fn predict(&mut self, (before, now): (RigidTransform, RigidTransform), seconds: f64) {
        let (before, now) = (self.apply(before), self.apply(now));
        let (rotation, translation) = difference(&before, &now);
        let [metres, radians] = [translation.length(), rotation.length()];
        self.speed = [metres, radians].map(|v| v / seconds.max(1e-3));
        // p + θ × d.
        let mut jacobian = identity();
        let cross = skew(-translation);
        for (i, row) in jacobian[3..].iter_mut().enumerate() {
            for (j, value) in row[..3].iter_mut().enumerate() {
                *value = cross.col(j)[i];
            }
        }
        let grown: [f64; 2] = std::array::from_fn(|k| {
            VARIANCE_PER_SECOND[k] * seconds
                + VARIANCE_PER_METRE[k] * metres
                + VARIANCE_PER_RADIAN[k] * radians
        });
        let propagated = times(&times(&jacobian, &self.covariance), &transposed(&jacobian));
        // The covariance never exceeds the initial one.
        let mut grown = with_diagonal(propagated, grown);
        let excess = (0..6)
            .map(|i| grown[i][i] / INITIAL_SIGMA[i / 3].powi(2))
            .fold(1.0, f64::max);
        grown.iter_mut().flatten().for_each(|v| *v /= excess);
        self.covariance = grown;
    }

    /// Returns the pose of a picture without markers.
    pub fn unseen(&mut self, tracked: TrackerPose) -> (RigidTransform, MarkerAssessment) {
        self.pose_covariance = self.covariance_with(tracked.noise);
        (
            self.apply(tracked.world_from_camera),
            MarkerAssessment::NoMarkers,
        )
    }

    /// Updates the correction with the pose by markers, and returns the best pose of this picture.
    /// The tracker's noise is independent between pictures, so it does not enter the correction.
    pub fn update(
        &mut self,
        tracked: TrackerPose,
        seen: &PoseEstimate,
        seconds: f64,
    ) -> (RigidTransform, MarkerAssessment) {
        let expected = self.apply(tracked.world_from_camera);
        let by_markers = seen.camera_from_frame.inverse();
        let (r, t) = difference(&expected, &by_markers);
        let innovation = [r.x, r.y, r.z, t.x, t.y, t.z];
        let markers = self.marker_covariance(&by_markers, seen);
        let prior = self.covariance_with(tracked.noise);
        self.pose_covariance = prior;
        let Some(weight) = inverse(&added(&prior, &markers)) else {
            return (expected, MarkerAssessment::Rejected);
        };
        let weighted = multiplied(&weight, &innovation);
        let distance: f64 = innovation.iter().zip(weighted).map(|(a, b)| a * b).sum();
        if distance.is_nan() || distance > GATE {
            return self.reject(tracked, by_markers, (&markers, seconds), expected);
        }
        self.outlier = None;
        let pose_step = multiplied(&prior, &weighted);
        let correction_step = multiplied(&self.covariance, &weighted);
        let corrected = moved_by(expected, &correction_step);
        self.corrected_from_tracked = corrected * tracked.world_from_camera.inverse();
        self.pose_covariance = reduced(&prior, &weight);
        self.covariance = reduced(&self.covariance, &weight);
        (moved_by(expected, &pose_step), MarkerAssessment::Accepted)
    }

    /// Rejects an outlier. After enough successive consistent outliers, resets the filter instead.
    fn reject(
        &mut self,
        tracked: TrackerPose,
        by_markers: RigidTransform,
        (markers, seconds): (&Matrix<6>, f64),
        expected: RigidTransform,
    ) -> (RigidTransform, MarkerAssessment) {
        let tracked = tracked.world_from_camera;
        let implied = by_markers * tracked.inverse();
        let is_consistent = self.outlier.is_some_and(|(before, _)| {
            let (rotation, translation) = difference(&(before * tracked), &by_markers);
            let slack = |k: usize| 3.0 * self.speed[1 - k] * seconds * 0.1;
            let within = |error: DVec3, k: usize| {
                let variance: f64 = (3 * k..3 * k + 3).map(|i| markers[i][i]).sum();
                error.length() <= 3.0 * (2.0 * variance).sqrt() + slack(k)
            };
            within(rotation, 0) && within(translation, 1)
        });
        let consistent = self.outlier.filter(|_| is_consistent);
        let count = consistent.map_or(1, |(_, n)| n + 1);
        if count < MIN_CONSISTENT_OUTLIERS {
            self.outlier = Some((implied, count));
            return (expected, MarkerAssessment::Rejected);
        }
        *self = Self {
            corrected_from_tracked: implied,
            covariance: *markers,
            pose_covariance: *markers,
            outlier: None,
            speed: self.speed,
        };
        (by_markers, MarkerAssessment::Reset)
    }

    /// Covariance of a pose by markers, world axes.
    fn marker_covariance(&self, by_markers: &RigidTransform, seen: &PoseEstimate) -> Matrix<6> {
        let [metres, radians] = self.speed.map(|v| v * TIMING_SIGMA_SECONDS);
        let [rotation, position] = MARKER_SIGMA;
        let scatter = seen.covariance;
        let corners = scatter.map(|row| row.map(|v| v * CORNER_CORRELATION));
        with_diagonal(
            in_world(by_markers, &corners),
            [
                rotation * rotation + radians * radians,
                position * position + metres * metres,
            ],
        )
    }
}

/// P − P W P, exactly symmetric.
fn reduced(p: &Matrix<6>, weight: &Matrix<6>) -> Matrix<6> {
    let taken = times(&times(p, weight), p);
    std::array::from_fn(|i| std::array::from_fn(|j| p[i][j] - 0.5 * (taken[i][j] + taken[j][i])))
}

fn moved_by(pose: RigidTransform, by: &[f64; 6]) -> RigidTransform {
    moved(
        pose,
        DVec3::new(by[0], by[1], by[2]),
        DVec3::new(by[3], by[4], by[5]),
    )
}

/// Converts the covariance of a [`PoseEstimate`] (a motion ξ = (ω, v) in the camera's frame, after
/// `camera_from_world`) to that of `world_from_camera`'s error: the inverse pose is T⁻¹ exp(−ξ), so
/// θ = −R ω and p = −R v.
pub(super) fn in_world(world_from_camera: &RigidTransform, covariance: &Matrix<6>) -> Matrix<6> {
    rotated(DMat3::from_quat(world_from_camera.rotation), covariance)
}

/// Inverse of [`in_world`].
pub(super) fn in_camera(world_from_camera: &RigidTransform, covariance: &Matrix<6>) -> Matrix<6> {
    rotated(
        DMat3::from_quat(world_from_camera.rotation.inverse()),
        covariance,
    )
}

/// Rotates the axes of a covariance.
fn rotated(rotation: DMat3, covariance: &Matrix<6>) -> Matrix<6> {
    let mut both = [[0.0; 6]; 6];
    for i in 0..3 {
        for j in 0..3 {
            both[i][j] = rotation.col(j)[i];
            both[3 + i][3 + j] = rotation.col(j)[i];
        }
    }
    times(&times(&both, covariance), &transposed(&both))
}

fn skew(v: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, v.z, -v.y),
        DVec3::new(-v.z, 0.0, v.x),
        DVec3::new(v.y, -v.x, 0.0),
    )
}

fn identity() -> Matrix<6> {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))))
}

fn times(a: &Matrix<6>, b: &Matrix<6>) -> Matrix<6> {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..6).map(|k| a[i][k] * b[k][j]).sum()))
}

fn transposed(a: &Matrix<6>) -> Matrix<6> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn added(a: &Matrix<6>, b: &Matrix<6>) -> Matrix<6> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j]))
}

fn multiplied(a: &Matrix<6>, x: &[f64; 6]) -> [f64; 6] {
    std::array::from_fn(|i| (0..6).map(|k| a[i][k] * x[k]).sum())
}

/// Adds variances of rotation and position to the diagonal.
fn with_diagonal(mut a: Matrix<6>, [rotation, position]: [f64; 2]) -> Matrix<6> {
    for (i, row) in a.iter_mut().enumerate() {
        row[i] += if i < 3 { rotation } else { position };
    }
    a
}
