//! Hybrid registration: a 6-DOF tracker measures the camera's pose, and markers in the camera's
//! picture correct the tracker's drift and distortion.
//!
//! `correction` estimates the tracker's error with its uncertainty and rejects outlying marker poses.
//! `rate_limit` moves the displayed pose towards the estimate slowly enough not to be noticed.
//! [`HybridRegistration`] runs both from picture to picture, and continues with one source where the other is
//! missing. `motion` holds the small motions that they share.

mod correction;
mod motion;
mod rate_limit;
mod steadying;

use correction::Correction;
pub use correction::{MarkerAssessment, TrackerPose};
use glam::DVec3;
use penumbra_camera::PinholeCamera;
use penumbra_fiducials::PoseEstimate;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::fixed_size::Matrix;
use rate_limit::{RateLimiter, apart_pixels};
pub use steadying::{SteadiedPose, Steadying, SteadyingInput, SurfaceAt, Surfaces};

/// Pause after which the displayed pose jumps to the estimate, seconds.
const MAX_PAUSE_SECONDS: f64 = 0.5;

/// Standard deviations of a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseSigma {
    /// Position, over all axes, metres.
    pub metres: f64,
    /// Orientation, over all axes, radians.
    pub radians: f64,
    /// Picture of a point at the typical distance, per axis, pixels.
    pub pixels: f64,
}

/// The source of a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PoseOrigin {
    /// The tracker; no marker has corrected it yet.
    Tracker,
    /// The tracker, corrected by markers.
    Corrected {
        /// Time since the last correction, seconds.
        age: f64,
    },
    /// Markers alone.
    Markers,
}

/// The camera's pose by hybrid registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HybridPose {
    /// The pose to render with: `world_from_camera`.
    pub world_from_camera: RigidTransform,
    /// Its source.
    pub source: PoseOrigin,
    /// Its standard deviations; `None` if the tracker has never been compared with markers.
    pub sigma: Option<PoseSigma>,
    /// Remaining distance from the displayed pose to the estimate, pixels at the typical distance.
    pub remaining_pixels: f64,
    /// Size of the correction: metres at the camera, radians.
    pub correction: Option<[f64; 2]>,
    /// Assessment of the picture's markers.
    pub assessment: MarkerAssessment,
}

/// Registers a camera by tracker and markers, picture by picture. Does not allocate.
#[derive(Clone, Debug)]
pub struct HybridRegistration {
    camera: PinholeCamera,
    /// Centre of the objects, world, metres. Errors in pixels refer to its distance.
    middle: DVec3,
    correction: Correction,
    displayed: RateLimiter,
    /// Time of the previous picture.
    last: Option<MonotonicTime>,
    /// The tracker's most recent pose and the time of its picture.
    tracked: Option<(MonotonicTime, RigidTransform)>,
    corrected_at: Option<MonotonicTime>,
}

impl HybridRegistration {
    /// Creates the registration of `camera`. `middle`: centre of the objects, world, metres.
    #[must_use]
    pub const fn new(camera: PinholeCamera, middle: DVec3) -> Self {
        Self {
            camera,
            middle,
            correction: Correction::new(),
            displayed: RateLimiter::new(),
            last: None,
            tracked: None,
            corrected_at: None,
        }
    }

    /// Predicts the camera's pose before the picture's markers are used: it resolves the ambiguity
    /// of a single marker.
    #[must_use]
    pub fn predicted(&self, tracked: Option<RigidTransform>) -> Option<RigidTransform> {
        Some(self.correction.apply(tracked?))
    }

    /// Estimates the pose of a picture taken at `at` from the tracker's pose and the pose by the
    /// picture's markers (`camera_from_world`). `None` if both are missing.
    pub fn register(
        &mut self,
        at: MonotonicTime,
        tracked: Option<TrackerPose>,
        seen: Option<&PoseEstimate>,
    ) -> Option<HybridPose> {
        let before = self.last;
        let seconds = self.seconds_since_last(at);
        self.last = Some(at);
        let Some(tracked) = tracked else {
            if seen.is_none() {
                self.displayed = RateLimiter::new();
            }
            return self.by_markers(seen?, seconds);
        };
        let now = tracked.world_from_camera;
        let previous = self.tracked.replace((at, now));
        let (then, from) = previous.unwrap_or((at, now));
        self.correction
            .predict((from, now), at.seconds_since(then).max(0.0));
        let (target, verdict) = match seen {
            Some(seen) => self.correction.update(tracked, seen, seconds),
            None => self.correction.unseen(tracked),
        };
        if matches!(
            verdict,
            MarkerAssessment::Accepted | MarkerAssessment::Reset
        ) {
            self.corrected_at = Some(at);
        }
        let distance = self.distance(&target);
        let motion = if Some(then) == before {
            apart_pixels(&self.camera, from, now, distance)
        } else {
            0.0
        };
        let accepted = seen.filter(|_| verdict != MarkerAssessment::Rejected);
        let by_markers = accepted.map(|s| s.camera_from_frame.inverse());
        let displayed = self.displayed.approach(
            (&self.camera, distance),
            target,
            (Some(tracked.world_from_camera), by_markers),
            (seconds, motion),
        );
        let age = self.corrected_at.map(|then| at.seconds_since(then));
        Some(HybridPose {
            world_from_camera: displayed,
            source: age.map_or(PoseOrigin::Tracker, |age| PoseOrigin::Corrected { age }),
            sigma: age.map(|_| {
                let covariance = self.correction.pose_covariance();
                sigma_of(&self.camera, &target, covariance, self.middle)
            }),
            remaining_pixels: apart_pixels(&self.camera, displayed, target, distance),
            correction: age.map(|_| self.correction.size_at(tracked.world_from_camera)),
            assessment: verdict,
        })
    }

    /// Registers by markers alone.
    fn by_markers(&mut self, seen: &PoseEstimate, seconds: f64) -> Option<HybridPose> {
        let target = seen.camera_from_frame.inverse();
        let distance = self.distance(&target);
        let displayed = self.displayed.approach(
            (&self.camera, distance),
            target,
            (None, Some(target)),
            (seconds, 0.0),
        );
        let covariance = correction::in_world(&target, &seen.covariance);
        Some(HybridPose {
            world_from_camera: displayed,
            source: PoseOrigin::Markers,
            sigma: Some(sigma_of(&self.camera, &target, &covariance, self.middle)),
            remaining_pixels: apart_pixels(&self.camera, displayed, target, distance),
            correction: None,
            assessment: MarkerAssessment::Accepted,
        })
    }

    /// Returns the time since the previous picture. After a long pause or a jump in time the
    /// displayed pose starts again; a jump back also resets the correction.
    fn seconds_since_last(&mut self, at: MonotonicTime) -> f64 {
        let Some(last) = self.last else { return 0.0 };
        let seconds = at.seconds_since(last);
        if !(0.0..MAX_PAUSE_SECONDS).contains(&seconds) {
            self.displayed = RateLimiter::new();
            if seconds < 0.0 {
                self.correction = Correction::new();
                self.tracked = None;
                self.corrected_at = None;
            }
        }
        seconds.max(0.0)
    }

    /// Distance of the objects' centre along the optical axis, metres, limited to 0.1 to 10.
    fn distance(&self, world_from_camera: &RigidTransform) -> f64 {
        let z = world_from_camera.inverse().transform_point(self.middle).z;
        z.clamp(0.1, 10.0)
    }
}

/// Standard deviations of a pose from the covariance of its error (rotation vector and camera's
/// position, world axes).
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
        max_error: 0.0,
    };
    let (radians, metres) = estimate.sigmas();
    // For a point behind the camera: a point at the same distance in front.
    let z = world_from_camera.inverse().transform_point(point).z;
    let ahead = world_from_camera.transform_point(DVec3::new(0.0, 0.0, z.abs().max(0.1)));
    let shown = if z > 0.1 { point } else { ahead };
    PoseSigma {
        metres,
        radians,
        pixels: estimate.sigma_at(camera, shown),
    }
}

#[cfg(test)]
mod tests;
