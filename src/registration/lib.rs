//! Hybrid registration: a 6-DOF tracker gives the camera's pose, markers in its picture take
//! the tracker's drift and distortion away.
//!
//! `correction` estimates what the tracker is off by, with its uncertainty, and keeps marker
//! poses that cannot be out of it. `following` lets what is drawn follow that estimate no
//! faster than the eye forgives. [`Fusion`] does both from picture to picture, and goes on
//! with whichever of the two sources there is.

mod correction;
mod following;

use correction::Correction;
pub use correction::Verdict;
use following::Following;
pub use following::apart_pixels;
use glam::{DMat3, DQuat, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::PoseEstimate;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::fixed_size::Matrix;

/// Longer without any pose, and what comes next is drawn where it belongs at once, seconds.
const PAUSE: f64 = 0.5;

/// The camera's pose by the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// `world_from_camera`.
    pub world_from_camera: RigidTransform,
    /// Standard deviations of its noise along an axis: metres, radians. Not what it is off by
    /// for longer: that is what markers are for.
    pub noise: [f64; 2],
}

/// Standard deviations of a pose, each over all axes, and of what is drawn by it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseSigma {
    /// Place, metres.
    pub metres: f64,
    /// Direction, radians.
    pub radians: f64,
    /// Of the picture of a point at the typical distance, along an axis, pixels.
    pub pixels: f64,
}

/// What a pose comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Source {
    /// The tracker, and no marker has ever corrected it.
    Tracker,
    /// The tracker, corrected by markers.
    Corrected {
        /// Seconds since markers last did.
        age: f64,
    },
    /// Markers alone.
    Markers,
}

/// The camera's pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fused {
    /// What to draw by: `world_from_camera`.
    pub world_from_camera: RigidTransform,
    /// What it comes from.
    pub source: Source,
    /// How sure it is; `None` where the tracker has never been compared with anything.
    pub sigma: Option<PoseSigma>,
    /// How far what is drawn is still behind what is known, pixels at the typical distance.
    pub behind: f64,
    /// What the tracker is off by: metres at the camera, radians.
    pub correction: Option<[f64; 2]>,
    /// What became of the picture's markers.
    pub verdict: Verdict,
}

/// Fuses, picture by picture. Does not allocate.
#[derive(Clone, Debug)]
pub struct Fusion {
    camera: PinholeCamera,
    /// What the objects stand about, world, metres: pixels are told for its distance.
    middle: DVec3,
    correction: Correction,
    following: Following,
    /// When the picture before was taken.
    last: Option<MonotonicTime>,
    /// The tracker's last word, in whichever picture that was.
    tracked: Option<(MonotonicTime, RigidTransform)>,
    corrected_at: Option<MonotonicTime>,
}

impl Fusion {
    /// For pictures of `camera`; `middle` of what is looked at, world, metres.
    #[must_use]
    pub const fn new(camera: PinholeCamera, middle: DVec3) -> Self {
        Self {
            camera,
            middle,
            correction: Correction::new(),
            following: Following::new(),
            last: None,
            tracked: None,
            corrected_at: None,
        }
    }

    /// Where the camera is by what is known before this picture's markers are looked at: what
    /// tells the two poses of a single marker apart.
    #[must_use]
    pub fn expected(&self, tracked: Option<RigidTransform>) -> Option<RigidTransform> {
        Some(self.correction.apply(tracked?))
    }

    /// The pose at the instant of a picture, by what the tracker says of it and what the
    /// markers in it say (`camera_from_world`). `None` where neither says anything.
    pub fn step(
        &mut self,
        at: MonotonicTime,
        tracked: Option<Tracked>,
        seen: Option<&PoseEstimate>,
    ) -> Option<Fused> {
        let before = self.last;
        let seconds = self.seconds_since_last(at);
        self.last = Some(at);
        let Some(tracked) = tracked else {
            if seen.is_none() {
                self.following = Following::new();
            }
            return self.by_markers(seen?, seconds);
        };
        let now = tracked.world_from_camera;
        let told = self.tracked.replace((at, now));
        let (then, from) = told.unwrap_or((at, now));
        self.correction
            .predict((from, now), at.seconds_since(then).max(0.0));
        let (target, verdict) = match seen {
            Some(seen) => self.correction.update(tracked, seen, seconds),
            None => self.correction.unseen(tracked),
        };
        if matches!(verdict, Verdict::Taken | Verdict::Overruled) {
            self.corrected_at = Some(at);
        }
        let distance = self.distance(&target);
        let motion = if Some(then) == before {
            apart_pixels(&self.camera, from, now, distance)
        } else {
            0.0
        };
        let believed = seen.filter(|_| verdict != Verdict::Rejected);
        let marked = believed.map(|s| s.camera_from_frame.inverse());
        let drawn = self.following.follow(
            (&self.camera, distance),
            target,
            (Some(tracked.world_from_camera), marked),
            (seconds, motion),
        );
        let age = self.corrected_at.map(|then| at.seconds_since(then));
        Some(Fused {
            world_from_camera: drawn,
            source: age.map_or(Source::Tracker, |age| Source::Corrected { age }),
            sigma: age.map(|_| {
                let covariance = self.correction.of_pose();
                sigma_of(&self.camera, &target, covariance, self.middle)
            }),
            behind: apart_pixels(&self.camera, drawn, target, distance),
            correction: age.map(|_| self.correction.size_at(tracked.world_from_camera)),
            verdict,
        })
    }

    /// The tracker is silent.
    fn by_markers(&mut self, seen: &PoseEstimate, seconds: f64) -> Option<Fused> {
        let target = seen.camera_from_frame.inverse();
        let distance = self.distance(&target);
        let drawn = self.following.follow(
            (&self.camera, distance),
            target,
            (None, Some(target)),
            (seconds, 0.0),
        );
        let covariance = correction::in_world(&target, &seen.covariance);
        Some(Fused {
            world_from_camera: drawn,
            source: Source::Markers,
            sigma: Some(sigma_of(&self.camera, &target, &covariance, self.middle)),
            behind: apart_pixels(&self.camera, drawn, target, distance),
            correction: None,
            verdict: Verdict::Taken,
        })
    }

    /// A stream that jumps in time, or a long pause, begins anew: what is drawn then need not
    /// go on from anything. What is known of the tracker stays.
    fn seconds_since_last(&mut self, at: MonotonicTime) -> f64 {
        let Some(last) = self.last else { return 0.0 };
        let seconds = at.seconds_since(last);
        if !(0.0..PAUSE).contains(&seconds) {
            self.following = Following::new();
            if seconds < 0.0 {
                self.correction = Correction::new();
                self.tracked = None;
                self.corrected_at = None;
            }
        }
        seconds.max(0.0)
    }

    /// To what is looked at, metres, as far as that is in front.
    fn distance(&self, world_from_camera: &RigidTransform) -> f64 {
        let z = world_from_camera.inverse().transform_point(self.middle).z;
        z.clamp(0.1, 10.0)
    }
}

/// Standard deviations of a pose from the covariance of its error (rotation vector and
/// camera's place, world axes).
fn sigma_of(
    camera: &PinholeCamera,
    world_from_camera: &RigidTransform,
    covariance: &Matrix<6>,
    point: DVec3,
) -> PoseSigma {
    let estimate = PoseEstimate {
        camera_from_frame: world_from_camera.inverse(),
        covariance: correction::in_camera(world_from_camera, covariance),
        rms: 0.0,
        worst: 0.0,
    };
    let (radians, metres) = estimate.sigmas();
    // Behind the camera: of a point as far away before it.
    let z = world_from_camera.inverse().transform_point(point).z;
    let ahead = world_from_camera.transform_point(DVec3::new(0.0, 0.0, z.abs().max(0.1)));
    let shown = if z > 0.1 { point } else { ahead };
    PoseSigma {
        metres,
        radians,
        pixels: estimate.sigma_at(camera, shown),
    }
}

/// R(turn) after `pose`, about the camera's place, which moves by `shift`.
fn nudged(pose: RigidTransform, turn: DVec3, shift: DVec3) -> RigidTransform {
    RigidTransform::new(
        (DQuat::from_scaled_axis(turn) * pose.rotation).normalize(),
        pose.translation + shift,
    )
}

/// The rotation vector and shift with `nudged(from, …) = to`.
fn difference(from: &RigidTransform, to: &RigidTransform) -> (DVec3, DVec3) {
    let turn = to.rotation * from.rotation.inverse();
    let turn = if turn.w < 0.0 { -turn } else { turn };
    (turn.to_scaled_axis(), to.translation - from.translation)
}

/// Rotation matrix of a unit quaternion.
fn matrix(rotation: DQuat) -> DMat3 {
    DMat3::from_quat(rotation)
}

#[cfg(test)]
mod tests;
