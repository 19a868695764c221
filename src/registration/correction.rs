//! What a tracker is off by, after what markers have said.
//!
//! An error-state Kalman filter. The state is a rigid correction C with
//! `world_from_camera` = C · tracked; its error is a small rotation θ and a shift of the
//! camera's place p, in world axes about the camera (Solà 2017, "Quaternion kinematics for the
//! error-state Kalman filter", global errors). While the camera goes by d the same correction
//! shifts it by p + θ × d. The tracker drifts with time, and an electromagnetic one's field is
//! bent differently elsewhere: the covariance grows with time, way and turn.

use super::{Tracked, difference, matrix, nudged};
use glam::{DMat3, DVec3};
use penumbra_fiducials::PoseEstimate;
use penumbra_interface::RigidTransform;
use penumbra_numerics::fixed_size::{Matrix, inverse};

/// Before any marker was seen: rotation (radians), place (metres).
const UNKNOWN: [f64; 2] = [0.2, 0.2];
/// Growth of the variances a second: drift of 0.02° and 0.2 mm.
const BY_SECOND: [f64; 2] = [1.2e-7, 4e-8];
/// Growth a metre of way: 0.5° and 3 mm after 0.3 m.
const BY_METRE: [f64; 2] = [2.5e-4, 3e-5];
/// Growth a radian of turn: 0.3° and 1 mm after a radian.
const BY_RADIAN: [f64; 2] = [2.7e-5, 1e-6];
/// By so many seconds tracker and picture may be apart: seen only while the camera moves.
const TIMING: f64 = 0.002;
/// What corners say of a pose besides their noise, by prints that are not flat and a lens that
/// is not quite as calibrated: rotation (radians), place (metres). Small, because what corners
/// say of one is tied to what they say of the other, and this is not.
const MARKERS_FLOOR: [f64; 2] = [5e-5, 5e-5];
/// The same errors are in all corners at once: the variances that their scatter tells, times
/// this.
const TOGETHER: f64 = 4.0;
/// χ² of six degrees of freedom that one of a hundred thousand good poses exceeds.
const GATE: f64 = 33.1;
/// So many poses in a row that agree with one another overrule what is known.
const OVERRULING: u32 = 8;

/// What became of a pose by markers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// There was none.
    NothingSeen,
    /// It corrects.
    Taken,
    /// It cannot be by what is known, and corrects nothing.
    Rejected,
    /// So did those before it, all alike: what was known is wrong.
    Overruled,
}

/// The filter.
#[derive(Clone, Debug)]
pub(super) struct Correction {
    /// C: `world_from_tracked_world`.
    corrected_from_tracked: RigidTransform,
    covariance: Matrix<6>,
    /// Of this picture's pose, with the tracker's noise in it.
    of_pose: Matrix<6>,
    /// The last rejected pose's C, and how many in a row agree.
    suspect: Option<(RigidTransform, u32)>,
    /// The tracked camera's speed: metres and radians a second.
    speed: [f64; 2],
}

impl Correction {
    pub const fn new() -> Self {
        let mut covariance = [[0.0; 6]; 6];
        let mut i = 0;
        while i < 6 {
            covariance[i][i] = UNKNOWN[i / 3] * UNKNOWN[i / 3];
            i += 1;
        }
        Self {
            corrected_from_tracked: RigidTransform::IDENTITY,
            covariance,
            of_pose: covariance,
            suspect: None,
            speed: [0.0; 2],
        }
    }

    /// C · tracked.
    pub fn apply(&self, tracked: RigidTransform) -> RigidTransform {
        self.corrected_from_tracked * tracked
    }

    /// Metres at the camera and radians by which it corrects.
    pub fn size_at(&self, tracked: RigidTransform) -> [f64; 2] {
        let (turn, shift) = difference(&tracked, &self.apply(tracked));
        [shift.length(), turn.length()]
    }

    /// Covariance of the last pose that was given (rotation vector, camera's place; world axes).
    pub const fn of_pose(&self) -> &Matrix<6> {
        &self.of_pose
    }

    /// Of the corrected pose, with the tracker's noise.
    fn covariance_with(&self, noise: [f64; 2]) -> Matrix<6> {
        with_diagonal(self.covariance, [noise[1].powi(2), noise[0].powi(2)])
    }

    /// Time goes on, and the tracked camera goes from one place to another.
    pub fn predict(&mut self, (before, now): (RigidTransform, RigidTransform), seconds: f64) {
        let (before, now) = (self.apply(before), self.apply(now));
        let (turn, way) = difference(&before, &now);
        self.speed = [way.length(), turn.length()].map(|v| v / seconds.max(1e-3));
        // p + θ × way.
        let mut jacobian = identity();
        let cross = skew(-way);
        for (i, row) in jacobian[3..].iter_mut().enumerate() {
            for (j, value) in row[..3].iter_mut().enumerate() {
                *value = cross.col(j)[i];
            }
        }
        let grown: [f64; 2] = std::array::from_fn(|k| {
            BY_SECOND[k] * seconds + BY_METRE[k] * way.length() + BY_RADIAN[k] * turn.length()
        });
        let moved = times(&times(&jacobian, &self.covariance), &transposed(&jacobian));
        // Knowledge never gets worse than none.
        let mut grown = with_diagonal(moved, grown);
        let excess = (0..6)
            .map(|i| grown[i][i] / UNKNOWN[i / 3].powi(2))
            .fold(1.0, f64::max);
        grown.iter_mut().flatten().for_each(|v| *v /= excess);
        self.covariance = grown;
    }

    /// The pose of a picture without markers.
    pub fn unseen(&mut self, tracked: Tracked) -> (RigidTransform, Verdict) {
        self.of_pose = self.covariance_with(tracked.noise);
        (self.apply(tracked.world_from_camera), Verdict::NothingSeen)
    }

    /// Takes the pose by markers, and gives the best pose for this picture: the tracker's
    /// noise is this picture's alone and is not learnt.
    pub fn update(
        &mut self,
        tracked: Tracked,
        seen: &PoseEstimate,
        seconds: f64,
    ) -> (RigidTransform, Verdict) {
        let expected = self.apply(tracked.world_from_camera);
        let marked = seen.camera_from_frame.inverse();
        let (turn, shift) = difference(&expected, &marked);
        let z = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
        let markers = self.noise_of(&marked, seen);
        let noise = tracked.noise;
        let prior = self.covariance_with(noise);
        self.of_pose = prior;
        let Some(weight) = inverse(&added(&prior, &markers)) else {
            return (expected, Verdict::Rejected);
        };
        let weighted = multiplied(&weight, &z);
        let distance: f64 = z.iter().zip(weighted).map(|(a, b)| a * b).sum();
        if distance.is_nan() || distance > GATE {
            return self.doubt(tracked, marked, (&markers, seconds), expected);
        }
        self.suspect = None;
        let best = multiplied(&prior, &weighted);
        let learnt = multiplied(&self.covariance, &weighted);
        let corrected = nudged_by(expected, &learnt);
        self.corrected_from_tracked = corrected * tracked.world_from_camera.inverse();
        self.of_pose = reduced(&prior, &weight);
        self.covariance = reduced(&self.covariance, &weight);
        (nudged_by(expected, &best), Verdict::Taken)
    }

    /// A pose that cannot be. If those after it agree with it, what was known is wrong.
    fn doubt(
        &mut self,
        tracked: Tracked,
        marked: RigidTransform,
        (markers, seconds): (&Matrix<6>, f64),
        expected: RigidTransform,
    ) -> (RigidTransform, Verdict) {
        let tracked = tracked.world_from_camera;
        let implied = marked * tracked.inverse();
        let agrees = self.suspect.is_some_and(|(before, _)| {
            let (turn, shift) = difference(&(before * tracked), &marked);
            let slack = |k: usize| 3.0 * self.speed[1 - k] * seconds * 0.1;
            let within = |off: DVec3, k: usize| {
                let variance: f64 = (3 * k..3 * k + 3).map(|i| markers[i][i]).sum();
                off.length() <= 3.0 * (2.0 * variance).sqrt() + slack(k)
            };
            within(turn, 0) && within(shift, 1)
        });
        let count = self.suspect.filter(|_| agrees).map_or(1, |(_, n)| n + 1);
        if count < OVERRULING {
            self.suspect = Some((implied, count));
            return (expected, Verdict::Rejected);
        }
        *self = Self {
            corrected_from_tracked: implied,
            covariance: *markers,
            of_pose: *markers,
            suspect: None,
            speed: self.speed,
        };
        (marked, Verdict::Overruled)
    }

    /// Covariance of a pose by markers, world axes.
    fn noise_of(&self, marked: &RigidTransform, seen: &PoseEstimate) -> Matrix<6> {
        let [metres, radians] = self.speed.map(|v| v * TIMING);
        let [turn, place] = MARKERS_FLOOR;
        with_diagonal(
            in_world(
                marked,
                &seen.covariance.map(|row| row.map(|v| v * TOGETHER)),
            ),
            [
                turn * turn + radians * radians,
                place * place + metres * metres,
            ],
        )
    }
}

/// P − P W P, symmetric whatever rounding does.
fn reduced(p: &Matrix<6>, weight: &Matrix<6>) -> Matrix<6> {
    let taken = times(&times(p, weight), p);
    std::array::from_fn(|i| std::array::from_fn(|j| p[i][j] - 0.5 * (taken[i][j] + taken[j][i])))
}

fn nudged_by(pose: RigidTransform, by: &[f64; 6]) -> RigidTransform {
    nudged(
        pose,
        DVec3::new(by[0], by[1], by[2]),
        DVec3::new(by[3], by[4], by[5]),
    )
}

/// Covariance of [`PoseEstimate`] (a motion ξ in the camera's frame before `camera_from_world`)
/// as that of `world_from_camera`'s error: its inverse is T⁻¹ exp(−ξ), so θ = −R ω and
/// p = −R v.
pub(super) fn in_world(world_from_camera: &RigidTransform, covariance: &Matrix<6>) -> Matrix<6> {
    turned(matrix(world_from_camera.rotation), covariance)
}

/// The way back of [`in_world`].
pub(super) fn in_camera(world_from_camera: &RigidTransform, covariance: &Matrix<6>) -> Matrix<6> {
    turned(matrix(world_from_camera.rotation.inverse()), covariance)
}

/// Both halves of a covariance in other axes.
fn turned(rotation: DMat3, covariance: &Matrix<6>) -> Matrix<6> {
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

/// With variances added: rotation's, then place's.
fn with_diagonal(mut a: Matrix<6>, [turn, place]: [f64; 2]) -> Matrix<6> {
    for (i, row) in a.iter_mut().enumerate() {
        row[i] += if i < 3 { turn } else { place };
    }
    a
}
